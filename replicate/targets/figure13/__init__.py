"""Figure 13: the networks move meshes of another topology through texture coordinates, beside the truth.

With ONTO they move the faces of other characters, too.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

from replicate.base.paths import display_path
from replicate.cli.options import others
from replicate.cli.running import make
from replicate.drawing.panels import save_figure
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts, coarse, refined
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.publication import publish_rows, results_folder
from replicate.report.results import write_results
from replicate.report.tables import as_text
from replicate.targets.figure13 import moved as figure13_moved
from replicate.targets.figure13.moved import rows_of

FILE = "figure13.csv"


@dataclass(frozen=True)
class TransferPicture:
    """The character and profile of the figure, and the other characters whose faces are moved."""

    character: str
    profile: str
    onto: tuple[str, ...] = ()


def stages(plan: Plan, methods: Sequence[Method] = (), onto: Sequence[str] = ()) -> list[Stage]:
    """Return the stages of one character's figure, the slow ones that train first.

    onto: other characters, by name or recipe, whose faces are moved.
    """
    moved = figure13_moved.moved_stage(plan)
    modules = (
        artefacts.rig_stage,
        artefacts.samples_stage,
        artefacts.rigid_stage,
        artefacts.shown_pose_stage,
        figure13_moved.meshes_stage,
    )
    inputs = [*(stage(plan) for stage in modules), moved]
    moved_faces = figure13_moved.other_stages(plan, onto)
    settings = TransferPicture(plan.character, plan.config.profile, tuple(moved_faces))
    networks = [coarse.stage(plan), refined.stage(plan)]
    inputs += moved_faces.values()
    return [*networks, moved, *moved_faces.values(), plan.stage("figure13", draw, settings, *inputs)]


def draw(context: StageContext) -> None:
    """Draw the new meshes in one pose, and write the errors of every way to move them (Fig. 13)."""
    from replicate.targets.figure13.shown import figure13, sheet_of_others, shown_meshes

    character, inputs = context.config.character, context.inputs
    means = figure13_moved.load_means(inputs)
    folders = {other: inputs[f"onto_{other}"] for other in context.config.onto}
    of_others = [mean for folder in folders.values() for mean in figure13_moved.load_other_means(folder)]
    write_results(context.out / FILE, rows_of(character, context.config.profile, inputs, [*means, *of_others]))
    figure, words = figure13(character, shown_meshes(inputs), means)
    save_figure(figure, context.out / f"figure13_{character}.png", words)
    if folders:
        figure, words = sheet_of_others(character, inputs, folders)
        save_figure(figure, context.out / f"figure13_{character}_onto.png", words)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character, publish its rows and pictures, and print its numbers."""
    from replicate.targets.figure13.shown import tables13

    results = make(options, lambda plan: stages(plan, onto=others(options, plan)))
    for table in tables13(publish_rows("figure13", results)):
        print(as_text(table))
    folder = display_path(results_folder(options.profile))
    print(f"written to {folder}: {FILE}, its pictures, manifest.json, and figure13.ipynb to read them in")
