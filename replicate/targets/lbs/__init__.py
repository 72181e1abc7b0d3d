"""What linear blend skinning is on a face: bones, weights, errors against their number, and where wrinkles go."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from replicate.artefacts import built_rig, drawn_samples, shown_pose
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods import skinned
from replicate.methods.method import Method
from replicate.report.publication import publish_pictures
from replicate.targets.options import OF_A_RUN
from replicate.targets.picture_stage import Picture
from replicate.targets.running import make

ABOUT = "linear blend skinning: bones, weights, errors against their number"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
BONES = (4, 8, 16, 24, 32, 48, 64)  # those of Table 2, and others


@dataclass(frozen=True)
class SkinPicture(Picture):
    """The same, and up to which normal error the colours go."""

    limit_deg: float


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that draws one character's figures, for which skins of more and more bones are fitted."""
    inputs = [built_rig.stage(plan), drawn_samples.stage(plan), shown_pose.stage(plan)]
    inputs += [skinned.stage(plan, bones) for bones in BONES]
    numbers = SkinPicture(plan.character, plan.config.seed, plan.config.evaluation.heatmap_deg)
    return [plan.stage("lbs", draw, numbers, *inputs)]


def draw(context: StageContext) -> None:
    """Measure skins of several numbers of bones on test poses, and draw what they are."""
    from replicate.targets.lbs.skin_pictures import TEST, TRAINING, save_all

    rig, samples = built_rig.load(context.inputs), drawn_samples.load(context.inputs)
    skins = {bones: skinned.load_skin(context.inputs, bones) for bones in BONES}
    count = len(samples.test_params)
    rows = np.sort(context.rng("poses").choice(count, min(TEST, count), replace=False))
    test = rig.mesh.neutral + np.asarray(samples.test_offsets[rows], np.float32)
    training = samples.draw(context.rng("training"), min(TRAINING, len(samples)))
    wrinkle_pose = rig.mesh.neutral + np.asarray(samples.test_offsets[shown_pose.load(context.inputs)], np.float32)
    posed = rig.mesh.neutral + samples.offsets(training)
    with context.progress(len(skins), "LBS", 0) as bar:
        stem = context.out / f"lbs_{context.config.character}"
        save_all(rig, skins, posed, test, wrinkle_pose, context.config.limit_deg, stem, bar)


def run(options: argparse.Namespace) -> None:
    """Draw the figures of every character and publish them."""
    publish_pictures("lbs", make(options, stages))
