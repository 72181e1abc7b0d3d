"""The control points of inverse kinematics, region by region, and the rig parameters that each region drives (§4.1)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from data_recipes.rig import Rig
from replicate.base.exceptions import InputError
from replicate.base.schema import Checked, number
from replicate.config import TrainingConfig

IMAGE_PLANE, SPACE = 2, 3  # how many coordinates of a point are used: x and y as a camera along z sees them, or all


@dataclass(frozen=True)
class Region:
    """A part of the face that has one network: C_j and R_j of §4.1.

    name: as the rig has it. points: indices into the control points. parameters: indices into p, of those that can move
    one of the points.
    """

    name: str
    points: Int[np.ndarray, " k"]
    parameters: Int[np.ndarray, " r"]


@dataclass(frozen=True)
class ControlPoints:
    """What a user drags. vertices: (c,) of the mesh; names: one each; regions: in the order of their first points."""

    vertices: Int[np.ndarray, " c"]
    names: tuple[str, ...]
    regions: tuple[Region, ...]

    def driven(self) -> Int[np.ndarray, " d"]:
        """Return the parameters that any region drives, in order."""
        return np.unique(np.concatenate([region.parameters for region in self.regions]))


def control_points(rig: Rig, influence: Bool[np.ndarray, "n m"], may_stand_still: bool = False) -> ControlPoints:
    """Return a rig's control points by region.

    influence: which control moves which vertex
    may_stand_still: leave out a region whose points nothing moves, if there are others

    Raises InputError for a rig without control points, and for a region whose points nothing moves.
    """
    if not len(rig.control_points):
        raise InputError(f"rig '{rig.name}': it has no control points; inverse kinematics needs at least one.")
    vertices = np.asarray(rig.control_points, np.int64)
    names = rig.control_point_names or tuple(f"point_{i + 1:02d}" for i in range(len(vertices)))
    regions = []
    for name in dict.fromkeys(rig.control_point_regions):
        points = np.array([i for i, region in enumerate(rig.control_point_regions) if region == name])
        parameters = np.flatnonzero(influence[vertices[points]].any(axis=0))
        if not len(parameters) and may_stand_still and influence[vertices].any():
            continue
        if not len(parameters):
            raise InputError(f"rig '{rig.name}': no control moves a control point of the region {name!r}.")
        regions.append(Region(name, points, parameters))
    return ControlPoints(vertices, tuple(names), tuple(regions))


def targets_of_drags(
    neutral: Float[np.ndarray, "c 3"], names: Sequence[str], drags: Sequence[tuple[str, Sequence[float]]]
) -> Float32[np.ndarray, "c 3"]:
    """Return control points with some of them moved: (name, (x, y) or (x, y, z) in mm) each.

    Raises InputError for an unknown control point, and for a move that is not finite.
    """
    targets = np.array(neutral, np.float32)
    for name, move in drags:
        if name not in names:
            raise InputError(f"there is no control point {name!r}; there are {', '.join(names)}")
        if not np.isfinite(move).all():
            raise InputError(f"control point {name!r}: expected a move of finite lengths in mm, got {tuple(move)}")
        targets[list(names).index(name), : len(move)] += np.asarray(move, np.float32)
    return targets


# The settings of inverse kinematics: the IK networks and their training (§4.2).

STEPS = {"quick": 200, "laptop": 4_000, "paper": 70_000}
TRAINING = {
    "paper": TrainingConfig(),
    "laptop": TrainingConfig("one_cycle", STEPS["laptop"], 16, "uniform", peak_rate=2e-3, largest_gradient=1.0),
}


@dataclass(frozen=True)
class InverseConfig(Checked):
    """How the IK networks are trained (§4.2).

    hidden: widths of the hidden layers
    leaky_slope: of their leaky ReLU
    axes: "xy" for points in the image plane (§5.3.1), "xyz" in space
    noise_mm: δ, each coordinate of a control point moves by U(−δ, δ)
    regularisation: λ_reg of Eq. 8, in mm; the paper names no value
    training: steps, batches and rates
    """

    hidden: tuple[int, ...] = number((256, 256), 1, 65_536)
    leaky_slope: float = number(0.2, 0.0, 1.0)
    axes: Literal["xy", "xyz"] = "xy"
    noise_mm: float = number(4.5, 0.0, 1e3)
    regularisation: float = number(0.02, 0.0, 1e6)
    training: TrainingConfig = TRAINING["laptop"]

    @property
    def coordinates(self) -> int:
        """How many coordinates of a control point are used."""
        return IMAGE_PLANE if self.axes == "xy" else SPACE


def default_section(profile: str) -> InverseConfig:
    """Return the section `[inverse]` of a profile's configuration."""
    training = TRAINING.get(profile, TRAINING["laptop"])
    return InverseConfig(training=replace(training, steps=STEPS[profile]))
