"""Figure 5: poses of the training data, and strips of the clips behind them."""

import argparse
from collections.abc import Sequence

from replicate.artefacts import built_rig, drawn_samples
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.report.cast import cast
from replicate.report.publication import publish_pictures
from replicate.targets.options import OF_A_RUN
from replicate.targets.picture_stage import Picture
from replicate.targets.running import make

ABOUT = "poses of the training data, a strip of frames for each kind of clip, and the controls behind them"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
CHARACTERS = cast


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that draws one character's figure."""
    inputs = (built_rig.stage(plan), drawn_samples.stage(plan))
    return [plan.stage("figure05", draw, Picture(plan.character, plan.config.seed), *inputs)]


def draw(context: StageContext) -> None:
    """Draw some training poses, and a strip of each kind of clip (Fig. 5)."""
    from replicate.targets.figure05.training_poses import choose, save_clips, save_poses

    rig, samples = built_rig.load(context.inputs), drawn_samples.load(context.inputs)
    choice = choose(len(samples), context.rng("poses"))
    stem = context.out / f"figure05_{context.config.character}"
    save_poses(rig, samples.params[choice], choice, stem)
    if rig.clips:
        save_clips(rig, stem.with_name(f"{stem.name}_clips"))


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character and publish it."""
    publish_pictures("figure05", make(options, stages))
