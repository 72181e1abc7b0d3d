"""Figure 13: the networks move meshes of another topology through texture coordinates, beside the truth.

ONTO names other characters, whose faces the networks move as well.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

from replicate.artefacts import built_rig, drawn_samples, rigid_segments, shown_pose
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods import coarse, refined
from replicate.methods.method import Method
from replicate.targets.figure13 import moved_meshes, new_meshes, other_faces
from replicate.targets.options import OF_A_RUN, others
from replicate.targets.running import make

ABOUT = "the networks move meshes of another topology through texture coordinates, beside the truth"
WRITES = "results/runs/<profile>/"
OPTIONS = (*OF_A_RUN, "onto")
FILE = "figure13.csv"


@dataclass(frozen=True)
class TransferPicture:
    """Whose figure is drawn, as results of which profile, and which other characters' faces are moved."""

    character: str
    profile: str
    onto: tuple[str, ...] = ()


def stages(plan: Plan, methods: Sequence[Method] = (), onto: Sequence[str] = ()) -> list[Stage]:
    """Return the stages of one character's figure; those that train, the slow ones, come first.

    onto: other characters, by name or recipe, whose faces are moved.
    """
    moved = moved_meshes.stage(plan)
    modules = (built_rig, drawn_samples, rigid_segments, shown_pose, new_meshes)
    inputs = [*(module.stage(plan) for module in modules), moved]
    moved_faces = other_faces.stages(plan, onto)
    settings = TransferPicture(plan.character, plan.config.profile, tuple(moved_faces))
    networks = [coarse.stage(plan), refined.stage(plan)]
    inputs += moved_faces.values()
    return [*networks, moved, *moved_faces.values(), plan.stage("figure13", draw, settings, *inputs)]


def draw(context: StageContext) -> None:
    """Draw the new meshes in one pose, and write the errors of every way to move them (Fig. 13)."""
    from replicate.drawing.panels import save_figure
    from replicate.report.results import write_results
    from replicate.targets.figure13.other_sheet import sheet_of_others
    from replicate.targets.figure13.transfer_rows import rows_of
    from replicate.targets.figure13.transfer_sheet import figure13, shown_meshes

    character, inputs = context.config.character, context.inputs
    means = moved_meshes.load_means(inputs)
    folders = {other: inputs[f"onto_{other}"] for other in context.config.onto}
    of_others = [mean for folder in folders.values() for mean in other_faces.load_means(folder)]
    write_results(context.out / FILE, rows_of(character, context.config.profile, inputs, [*means, *of_others]))
    figure, words = figure13(character, shown_meshes(inputs), means)
    save_figure(figure, context.out / f"figure13_{character}.png", words)
    if folders:
        figure, words = sheet_of_others(character, inputs, folders)
        save_figure(figure, context.out / f"figure13_{character}_onto.png", words)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character, publish its rows and pictures, and print its numbers."""
    from replicate.engine.paths import display_path
    from replicate.report.publication import results_folder
    from replicate.report.row_publication import publish_rows
    from replicate.report.tables import as_text
    from replicate.targets.figure13.transfer_tables import tables13

    def own_stages(plan: Plan) -> list[Stage]:
        return stages(plan, onto=others(options, plan))

    for table in tables13(publish_rows("figure13", make(options, own_stages))):
        print(as_text(table))
    folder = display_path(results_folder(options.profile))
    print(f"written to {folder}: {FILE}, its pictures, manifest.json, and figure13.ipynb to read them in")
