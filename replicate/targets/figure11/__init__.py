"""Figure 11: faces that inverse kinematics poses, the rig beside its approximations, with the control points."""

import argparse
from collections.abc import Sequence

from replicate.artefacts import rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.inverse import ik_stage
from replicate.methods import measurement
from replicate.methods.method import Method
from replicate.methods.method_registry import choose
from replicate.report.publication import publish_pictures
from replicate.targets.figure11.posed_picture import PosedPicture
from replicate.targets.options import OF_A_RUN
from replicate.targets.posing_stage import posing_stage
from replicate.targets.running import make

ABOUT = "faces that inverse kinematics poses for dragged control points: the rig and its approximations"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
ASKS_THE_RIG = "for vertices in the poses that inverse kinematics finds"
SHOWN = ("refined", "dense", "regional")


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's figure; those of the methods, the slow ones, come first."""
    shown = choose(SHOWN, plan.config)
    trained = ik_stage.stage(plan, shown[0])
    settings = PosedPicture(plan.character, tuple(measurement.numbers_of(method, plan.config) for method in shown))
    slow = [stage for method in shown for stage in method.stages(plan)]
    inputs = (*trained.inputs, rigid_segments.stage(plan), *slow, trained)
    return [*slow, trained, posing_stage(plan, "figure11", draw, settings, shown, inputs)]


def draw(context: StageContext) -> None:
    """Draw some configurations of control points, and the faces that they lead to."""
    from replicate.drawing.face_sheet import LARGEST_BYTES
    from replicate.drawing.panels import save_figure
    from replicate.targets.figure11.posed_faces import figure11

    figure, words = figure11(context.config, context.inputs, context.files)
    save_figure(figure, context.out / f"figure11_{context.config.character}.png", words, LARGEST_BYTES)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character, publish it, and execute its notebook, which opens the poser too."""
    publish_pictures("figure11", make(options, stages))
