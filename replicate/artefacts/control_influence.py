"""The artefact "influence": which control can move which vertex, which decides what each network sees (§3.1)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from data_recipes.recipe_paths import sample_folder
from replicate.artefacts import built_rig, drawn_samples
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext

FILE = "influence.npy"


def stage(plan: Plan) -> Stage:
    """Return the stage that tries every control: a fact about the rig, so at poses of its own draw.

    Of a rig that is known by its samples it is what these samples' folder says, or estimated from them.
    """
    if sample_folder(plan.config.character):
        inputs = (built_rig.stage(plan), drawn_samples.stage(plan))
        return plan.stage("influence", make_estimate, plan.numbers(None), *inputs)
    return plan.stage("influence", make, plan.numbers(plan.config.samples), built_rig.stage(plan))


def make(context: StageContext) -> None:
    """Try every control at several poses (§3.1)."""
    from replicate.approximation.influence import influence, influence_poses
    from replicate.approximation.samples import choose_poses

    rig = built_rig.load(context.inputs)
    training = choose_poses(rig, context.config.section, context.rng)["training"]
    poses = influence_poses(rig, training, context.rng("poses"))
    moves = influence(rig, poses, progress=context.progress)
    np.save(context.out / FILE, moves)
    context.note(poses=len(poses), idle_controls=[rig.controls[k].name for k in np.flatnonzero(~moves.any(0))])


def make_estimate(context: StageContext) -> None:
    """Take what the folder says that every control moves, or estimate it from the training poses (DEVIATIONS D7)."""
    from replicate.approximation.estimated_influence import estimate_influence

    rig, samples = built_rig.load(context.inputs), drawn_samples.load(context.inputs)
    stated = rig.moves is not None
    moves = rig.moves if stated else estimate_influence(samples, rig.default, context.rng("shadows"), context.progress)
    np.save(context.out / FILE, moves)
    context.note(stated=stated, idle_controls=[rig.controls[k].name for k in np.flatnonzero(~moves.any(0))])


def load(inputs: Mapping[str, Path]) -> Bool[np.ndarray, "n m"]:
    """Return which control (m) moves which vertex (n)."""
    return np.load(inputs["influence"] / FILE, allow_pickle=False)
