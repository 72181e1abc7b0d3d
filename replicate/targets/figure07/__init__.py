"""Figure 7: the mesh segments in colours."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

from replicate.artefacts import built_rig, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.config import RigidConfig
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.report.cast import cast
from replicate.report.publication import publish_pictures
from replicate.targets.options import OF_A_RUN
from replicate.targets.picture_stage import Picture
from replicate.targets.running import make

ABOUT = "the mesh segments in colours, into the open mouth too, and how rigidly each moves"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
CHARACTERS = cast


@dataclass(frozen=True)
class RigidPicture(Picture):
    """The same, and what decides which segments are rigid."""

    rigid: RigidConfig


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that draws one character's figure."""
    inputs = (built_rig.stage(plan), drawn_samples.stage(plan), rigid_segments.stage(plan))
    numbers = RigidPicture(plan.character, plan.config.seed, plan.config.rigid)
    return [plan.stage("figure07", draw, numbers, *inputs)]


def draw(context: StageContext) -> None:
    """Draw the mesh segments in colours (Fig. 7), and how far each is from moving rigidly."""
    from replicate.targets.figure07.mesh_segments import save_segments_figure
    from replicate.targets.figure07.rigid_errors import save_rigid_errors

    numbers, rig = context.config, built_rig.load(context.inputs)
    rigid = rigid_segments.load(context.inputs).segment.tolist()
    errors = rigid_segments.mean_errors(context.inputs, numbers.rigid, numbers.seed)
    stem = context.out / f"figure07_{numbers.character}"
    save_segments_figure(rig, rigid, errors, stem)
    save_rigid_errors(rig.mesh, errors, rigid, numbers.rigid.tau_mm, stem)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character and publish it."""
    publish_pictures("figure07", make(options, stages))
