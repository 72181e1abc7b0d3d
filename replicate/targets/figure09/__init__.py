"""Figure 9: forehead wrinkles of several methods, close up."""

import argparse
from collections.abc import Sequence

from replicate.cli.running import make
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.pose_record import FIGURE09
from replicate.targets.figure09.forehead_wrinkles import figure09
from replicate.targets.pose_numbers import folded_pose_stages, publish, save_folded_pose


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's figure, those of the methods, the slow ones, first."""
    return folded_pose_stages(plan, "figure09", FIGURE09, draw)


def draw(context: StageContext) -> None:
    """Draw the true forehead and several methods' predictions of it (Fig. 9)."""
    save_folded_pose(context, figure09)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character, publish it and print its numbers."""
    publish("figure09", make(options, stages))
