"""Figure 7: the mesh segments in colours."""

import argparse
from collections.abc import Sequence

from replicate.artefacts import built_rig, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.report.cast import cast
from replicate.report.publication import publish_pictures
from replicate.targets.options import OF_A_RUN
from replicate.targets.picture_stage import Picture
from replicate.targets.running import make

ABOUT = "the mesh segments in colours, into the open mouth too, and their numbers"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
CHARACTERS = cast


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that draws one character's figure."""
    inputs = (built_rig.stage(plan), rigid_segments.stage(plan))
    return [plan.stage("figure07", draw, Picture(plan.character, plan.config.seed), *inputs)]


def draw(context: StageContext) -> None:
    """Draw the mesh segments in colours (Fig. 7)."""
    from replicate.targets.figure07.mesh_segments import save_segments_figure

    rigid = rigid_segments.load(context.inputs).segment.tolist()
    save_segments_figure(built_rig.load(context.inputs), rigid, context.out / f"figure07_{context.config.character}")


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character and publish it."""
    publish_pictures("figure07", make(options, stages))
