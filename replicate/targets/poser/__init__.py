"""A page to pose a face in (§5.3.1): one HTML file a character, which opens in a browser from disk."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

from replicate.artefacts import built_rig, control_influence, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine import paths
from replicate.engine.stage import Stage, StageContext
from replicate.inverse import ik_stage
from replicate.methods import regional
from replicate.methods.method import Method
from replicate.report.publication import publish_files
from replicate.targets.options import OF_A_RUN
from replicate.targets.running import make

ABOUT = "a page to pose a face in with the mouse: one HTML file that opens in a browser from disk"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
LARGEST_MB = 12  # of a page that opens at once


@dataclass(frozen=True)
class PageSettings:
    """Whose page it is, the profile of its networks, and the seed that its poses to check are drawn with."""

    character: str
    profile: str
    seed: int


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's page; those that train, the slow ones, come first."""
    from replicate.poser.page import SOURCES

    slow = [regional.stage(plan), ik_stage.stage(plan, regional.METHOD)]
    inputs = (*(module.stage(plan) for module in (built_rig, rigid_segments, control_influence)), *slow)
    settings = PageSettings(plan.character, plan.config.profile, plan.config.seed)
    return [*slow, plan.stage("poser", write, settings, *inputs, files=SOURCES)]


def write(context: StageContext) -> None:
    """Write the page."""
    from replicate.poser.check_poses import check_contents
    from replicate.poser.contents import PosedFace, face_contents
    from replicate.poser.display_parts import display_contents
    from replicate.poser.page import page

    rig, settings = built_rig.load(context.inputs), context.config
    face = PosedFace(
        rig,
        regional.load_model(context.inputs),
        rigid_segments.load(context.inputs),
        ik_stage.load(context.inputs, regional.METHOD.name),
        control_influence.load(context.inputs),
    )
    header, arrays = {}, {}
    for words, values in (
        face_contents(face),
        check_contents(face, context.rng("checks")),
        display_contents(rig, context.progress),
    ):
        header |= words
        arrays |= values
    made_by = f"make poser CHARACTERS={settings.character} PROFILE={settings.profile}"
    text = page(header, arrays, f"{made_by}, seed {settings.seed}")
    (context.out / f"poser_{settings.character}.html").write_text(text, encoding="utf-8")
    context.note(size_mb=len(text.encode()) / 1e6)


def run(options: argparse.Namespace) -> None:
    """Write the page of every character and publish it."""
    folder, files = publish_files("poser", make(options, stages))
    for name in (name for own in files.values() for name in own):
        size = (folder / name).stat().st_size / 1e6
        advice = (
            "" if size <= LARGEST_MB else f"; above {LARGEST_MB} MB it opens slowly: fewer components make it smaller"
        )
        print(f"written to {paths.display_path(folder / name)} ({size:.1f} MB): open it in a browser{advice}")
