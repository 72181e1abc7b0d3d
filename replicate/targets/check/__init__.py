"""Look at faces before anything is trained: controls, segments, seams, units and poses, and what is amiss with them."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from replicate.base.exceptions import InputError
from replicate.base.paths import display_path
from replicate.cli.running import make
from replicate.drawing.panels import save_figure
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.publication import CharacterResult, by_character, publish_pictures, results_folder
from replicate.rig_study.first_look import MEANINGLESS, WORSE, load_face, look, unit_in_words, warnings
from replicate.targets.check.shown import (
    in_lines,
    poses_figure,
    reach_chart,
    read_findings,
    write_findings,
)

NAME = "check"


@dataclass(frozen=True)
class CheckSettings:
    """The settings of the stage: the character's name, how its unit is known, and the size of the coarse maps."""

    character: str
    unit: str
    map_size: int


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that looks at one character."""
    rig = artefacts.rig_stage(plan)
    others = (artefacts.samples_stage, artefacts.influence_stage, artefacts.rigid_stage)
    recipe = cast(artefacts.Character, rig.config).recipe
    settings = CheckSettings(plan.character, unit_in_words(recipe), plan.config.coarse.map_size)
    return [plan.stage(NAME, write_check, settings, rig, *(stage(plan) for stage in others))]


def write_check(context: StageContext) -> None:
    """Write a character's findings and its pictures."""
    settings = context.config
    face = load_face(context.inputs, settings.unit, settings.map_size)
    findings, stem = look(face), context.out / f"{NAME}_{settings.character}"
    write_findings(stem.with_name(f"{stem.name}.csv"), settings.character, findings)
    pictures = {
        "": poses_figure(face, settings.character),
        "_reach": reach_chart(findings, settings.character),
    }
    for what, (figure, words) in pictures.items():
        save_figure(figure, stem.with_name(f"{stem.name}{what}.png"), words)
    context.note(**{verdict: sum(each.verdict == verdict for each in findings) for verdict in (WORSE, MEANINGLESS)})


def run(options: argparse.Namespace) -> None:
    """Look at every character, publish what is seen, and print it in a few lines.

    Raises InputError, after all is written, for the first thing that makes results meaningless.
    """
    publish(make(options, stages))


def publish(results: Sequence[CharacterResult]) -> None:
    """Write the findings of some characters to the profile's folder, with pictures and a notebook, and print them.

    Raises InputError for what makes results meaningless.
    """
    publish_pictures(NAME, results)
    folder, amiss = results_folder(results[0].config.profile), {}
    for character in by_character(results):
        file = folder / f"{NAME}_{character}.csv"
        findings = read_findings(file)
        print("", *in_lines(character, findings, display_path(file)), sep="\n")
        said = [each.sentence for each in warnings(findings) if each.verdict == MEANINGLESS]
        amiss |= {character: said[0]} if said else {}
    for character, sentence in amiss.items():
        raise InputError(f"{character}: results would be meaningless: {sentence}")
