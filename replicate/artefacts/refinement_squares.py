"""The artefact "selection": the squares of the charts that a refinement is for (§3.3)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.artefacts import built_rig, control_influence, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext

if TYPE_CHECKING:
    import replicate.approximation.segments

FILE, ERROR_FILE = "segments.npz", "map_error.npy"


@dataclass(frozen=True)
class SquareNumbers:
    """What decides where a refinement is needed: of the refinement's section, and the coarse maps' size."""

    poses: int
    square: float
    clusters_max: int
    coarse_map_size: int


def stage(plan: Plan) -> Stage:
    """Return the stage that chooses the squares."""
    where = plan.config.refinement
    numbers = SquareNumbers(where.poses, where.square, where.clusters_max, plan.config.coarse.map_size)
    modules = (built_rig, drawn_samples, control_influence, rigid_segments)
    return plan.stage("selection", make, plan.numbers(numbers), *(module.stage(plan) for module in modules))


def make(context: StageContext) -> None:
    """Choose the squares by what the coarse maps lose (Eq. 2), as many as the elbow says (§3.3)."""
    from replicate.approximation.refinement import map_error, select
    from replicate.approximation.segments import save_segments

    numbers, mesh = context.config.section, built_rig.load_mesh(context.inputs)
    samples, segments = drawn_samples.load(context.inputs), rigid_segments.load_coarse_segments(context.inputs, mesh)
    poses = samples.draw(context.rng("poses"), min(numbers.poses, len(samples)))
    errors = map_error(segments, samples.offsets(poses), numbers.coarse_map_size)
    influence, seed = control_influence.load(context.inputs), context.config.seed
    squares, elbow = select(segments, errors, influence, numbers.square, numbers.clusters_max, seed)
    save_segments(squares, context.out / FILE)
    np.save(context.out / ERROR_FILE, errors)
    sizes = {square.name: len(square.vertices) for square in squares}
    context.note(segments=sizes, clusters=elbow.clusters, inertia=list(elbow.inertia), even=list(elbow.even))


def load(inputs: Mapping[str, Path]) -> "tuple[replicate.approximation.segments.Segment, ...]":
    """Return the refinement segments."""
    from replicate.approximation.segments import load_segments

    return load_segments(inputs["selection"] / FILE)


def load_map_error(inputs: Mapping[str, Path]) -> Float[np.ndarray, " n"]:
    """Return e_i of Eq. 2 in mm²."""
    return np.load(inputs["selection"] / ERROR_FILE, allow_pickle=False)
