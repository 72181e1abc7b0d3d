"""Figure 11: faces that inverse kinematics poses, the rig beside its approximations, with the control points."""

import argparse
from collections.abc import Sequence

from data_recipes.recipe_paths import drags_file
from replicate.artefacts import rigid_segments
from replicate.artefacts.plan import Plan, reference
from replicate.engine.stage import Stage, StageContext
from replicate.inverse import ik_stage
from replicate.methods import measurement
from replicate.methods.method import Method
from replicate.methods.method_registry import choose
from replicate.methods.prediction import reading
from replicate.report.publication import publish_pictures
from replicate.targets.figure11.posed_picture import PosedPicture
from replicate.targets.options import OF_A_RUN
from replicate.targets.running import make

ABOUT = "faces that inverse kinematics poses for dragged control points: the rig and its approximations"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
SHOWN = ("refined", "dense", "regional")


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's figure; those of the methods, the slow ones, come first."""
    shown = choose(SHOWN, plan.config)
    trained = ik_stage.stage(plan, shown[0])
    settings = PosedPicture(plan.character, tuple(measurement.numbers_of(method, plan.config) for method in shown))
    slow = [stage for method in shown for stage in method.stages(plan)]
    inputs = {stage.title: stage for stage in (*trained.inputs, rigid_segments.stage(plan), *slow, trained)}
    readers = [source for method in shown for source in reading(method, plan.config).sources]
    functions = ", ".join(dict.fromkeys(map(reference, (draw, *readers))))
    drags = drags_file(plan.config.character)
    files = (drags,) if drags.is_file() else ()
    return [*slow, trained, plan.stage("figure11", functions, settings, *inputs.values(), files=files)]


def draw(context: StageContext) -> None:
    """Draw some configurations of control points, and the faces that they lead to."""
    from replicate.drawing.face_sheet import LARGEST_BYTES
    from replicate.drawing.panels import save_figure
    from replicate.targets.figure11.posed_faces import figure11

    figure, words = figure11(context.config, context.inputs, context.files)
    save_figure(figure, context.out / f"figure11_{context.config.character}.png", words, LARGEST_BYTES)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character and publish it."""
    publish_pictures("figure11", make(options, stages), notebook=False)
