"""Figure 10: normal errors on the faces of every method, in the pose with most wrinkles, a median and the worst one."""

import argparse
from collections.abc import Sequence

from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.targets.options import OF_A_RUN, methods
from replicate.targets.running import make
from replicate.targets.shown_records import load_records, picture_settings, record_stages

ABOUT = "normal errors as colours on the face: the pose with most wrinkles, the median pose and the worst one"
WRITES = "results/runs/<profile>/"
OPTIONS = (*OF_A_RUN, "methods")


def stages(plan: Plan, methods: Sequence[Method]) -> list[Stage]:
    """Return the stages of one character's figure; those of the methods, the slow ones, come first."""
    shown = [method for method in methods if method.in_figures]
    return record_stages(plan, shown, "figure10", draw, picture_settings(plan, shown))


def draw(context: StageContext) -> None:
    """Draw the normal errors of every method in each of the poses, and once more close up on the forehead (Fig. 10)."""
    from replicate.drawing.face_sheet import LARGEST_BYTES
    from replicate.drawing.panels import save_figure
    from replicate.report.pose_record import FOLDED
    from replicate.targets.figure10.error_faces import figure10, picture_name
    from replicate.targets.pose_numbers import save_rows

    records = load_records(context.config.character, context.inputs)
    save_rows(context, records)
    for record in records.values():
        for camera in ("front", "forehead") if record.choice == FOLDED else ("front",):
            figure, words = figure10(record, context.config.limit_deg, camera)
            save_figure(figure, context.out / f"{picture_name(record, camera)}.png", words, LARGEST_BYTES)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character, publish it and print its numbers."""
    from replicate.targets.pose_numbers import publish

    publish("figure10", make(options, lambda plan: stages(plan, methods(options, plan.config))))
