"""Write pages to pose a face in (§5.3.1): an HTML file for each character and method, which a browser opens."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.cli.options import methods
from replicate.cli.running import make, plan_with_trained
from replicate.config import Config
from replicate.drawing.panels import save_figure
from replicate.engine.stage import Stage, StageContext, stage_function
from replicate.inverse import ik_stage
from replicate.methods import artefacts, regional
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference
from replicate.methods.trained import TrainedPlan, origin
from replicate.poser.pack import EVALUATED, SOURCES
from replicate.report.publication import publish_files

if TYPE_CHECKING:
    from replicate.poser.contents import PosedFace

LARGEST_MB = 12  # larger pages open slowly


@dataclass(frozen=True)
class PageSettings:
    """The settings of a character's pages.

    profile: of the networks
    seed: of the networks, and of the poses that a page is checked in
    models: (method, "module:function" of its model) for each page
    pictured: whether a browser draws pictures
    origin: where the models come from, if not from this run
    """

    character: str
    profile: str
    seed: int
    models: tuple[tuple[str, str], ...]
    pictured: bool
    origin: str = ""


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's pages, those that train first; a page can't evaluate every method."""
    from replicate.poser.browser_pictures import browser

    shown = [method for method in methods if method.name in EVALUATED] or [regional.METHOD]
    slow = [stage for method in shown for stage in (*method.stages(plan), ik_stage.stage(plan, method))]
    shared = (stage(plan) for stage in (artefacts.rig_stage, artefacts.rigid_stage, artefacts.influence_stage))
    inputs = {stage.title: stage for stage in (*shared, *slow)}.values()
    models = tuple((method.name, reference(method.model)) for method in shown)
    pictured = browser() is not None and not isinstance(plan, TrainedPlan)  # a page that is there at once has none
    settings = PageSettings(plan.character, plan.config.profile, plan.config.seed, models, pictured, origin(plan))
    functions = ",".join([reference(write), *(model for _, model in models)])  # the models' sources count too
    return [*slow, plan.stage("poser", functions, settings, *inputs, files=SOURCES)]


def write(context: StageContext) -> None:
    """Write the pages of one character, and pictures of the first one in a browser."""
    from replicate.poser.browser_pictures import browser, strip

    faces = [write_page(context, method, model) for method, model in context.config.models]
    if context.config.pictured and (program := browser()):
        drawn = strip(*faces[0], program)
        if drawn:
            save_figure(drawn[0], context.out / f"poser_{context.config.character}.png", drawn[1])


def write_page(context: StageContext, method: str, model: str) -> "tuple[PosedFace, Path]":
    """Write the page of one method; return its face and its file. model: "module:function" that reads the model."""
    from replicate.poser.contents import as_on_page
    from replicate.poser.face_page import face_page
    from replicate.poser.notebook import read_face

    settings = context.config
    face = read_face(context.inputs, as_on_page(stage_function(model)(context.inputs)), method)
    option = "" if method == regional.METHOD.name else f" METHODS={method}"
    made_by = f"make poser CHARACTERS={settings.character}{option} PROFILE={settings.profile}"
    text = face_page(face, context.rng("checks"), context.progress, f"{made_by}, seed {settings.seed}{settings.origin}")
    ending = "" if method == regional.METHOD.name else f"_{method}"
    file = context.out / f"poser_{settings.character}{ending}.html"
    file.write_text(text, encoding="utf-8")
    return face, file


def run(options: argparse.Namespace) -> None:
    """Write the pages of every character and publish them."""
    results = make(options, lambda plan: stages(plan, chosen(options, plan.config)), partial(plan_of, options))
    folder, files = publish_files("poser", results)
    for name in (name for names in files.values() for name in names if not name.endswith(".json")):
        if name.endswith(".png"):
            print(f"written to {paths.display_path(folder / name)}: the page in a browser, while points are dragged")
            continue
        size = (folder / name).stat().st_size / 1e6
        advice = (
            "" if size <= LARGEST_MB else f"; above {LARGEST_MB} MB it opens slowly: fewer components make it smaller"
        )
        print(f"written to {paths.display_path(folder / name)} ({size:.1f} MB): open it in a browser{advice}")


def plan_of(options: argparse.Namespace, config: Config) -> Plan:
    """Return a character's plan, where it can be with the models that come with the repository."""
    shown = chosen(options, config)
    networks = [name for method in shown for name in (method.name, ik_stage.stage_name(method.name))]
    return plan_with_trained(options, config, shown, [*networks, "rigid", "influence"])


def chosen(options: argparse.Namespace, config: Config) -> Sequence[Method]:
    """Return the chosen methods. Raises InputError for one that a page can't evaluate."""
    shown = methods(options, config)
    for method in shown:
        if method.name not in EVALUATED:
            raise InputError(f"method {method.name!r} has no page to pose in; {', '.join(EVALUATED)} have one")
    return shown
