"""Figure 1: the rig and its approximations side by side in one wrinkled pose."""

import argparse
from collections.abc import Sequence

from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.targets.figure_methods import FIGURE01
from replicate.targets.folded_pose import folded_pose_stages, save_folded_pose
from replicate.targets.options import OF_A_RUN
from replicate.targets.running import make

ABOUT = "the rig beside the refined networks, our method and LBS, in one wrinkled pose, with their errors"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's figure; those of the methods, the slow ones, come first."""
    return folded_pose_stages(plan, "figure01", FIGURE01, draw)


def draw(context: StageContext) -> None:
    """Draw the rig beside its approximations (Fig. 1)."""
    from replicate.targets.figure01.side_by_side import figure01

    save_folded_pose(context, figure01)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character, publish it and print its numbers."""
    from replicate.targets.pose_numbers import publish

    publish("figure01", make(options, stages))
