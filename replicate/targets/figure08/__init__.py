"""Figure 8: the refinement segments in colours."""

import argparse
from collections.abc import Sequence

from replicate.artefacts import built_rig, refinement_squares
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.report.cast import cast
from replicate.report.publication import publish_pictures
from replicate.targets.options import OF_A_RUN
from replicate.targets.picture_stage import Picture
from replicate.targets.running import make

ABOUT = "the refinement segments in colours, and their share of the maps' error"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
CHARACTERS = cast


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that draws one character's figure."""
    inputs = (built_rig.stage(plan), refinement_squares.stage(plan))
    return [plan.stage("figure08", draw, Picture(plan.character, plan.config.seed), *inputs)]


def draw(context: StageContext) -> None:
    """Draw the refinement segments in colours, what is unused in grey (Fig. 8)."""
    from replicate.targets.figure08.refinement_segments import save_refinement_figure

    squares, errors = refinement_squares.load(context.inputs), refinement_squares.load_map_error(context.inputs)
    stem = context.out / f"figure08_{context.config.character}"
    save_refinement_figure(built_rig.load(context.inputs), squares, errors, stem)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character and publish it."""
    publish_pictures("figure08", make(options, stages))
