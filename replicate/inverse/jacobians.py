"""How well an approximation's derivative agrees with the rig's: inverse kinematics sees the rig through it alone (§4).

The paper could not ask, since its rigs have no derivative.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32

from replicate.inverse.control_points import Region


@dataclass(frozen=True)
class Agreement:
    """Of two derivatives of the same points. cosine: 1 where they point the same way. size: the length of one over that
    of the other.
    """

    cosine: float
    size: float


def jacobians(
    positions: Callable[[torch.Tensor], torch.Tensor], params: Float[np.ndarray, "b m"]
) -> Float32[np.ndarray, "b c 3 m"]:
    """Return ∂V_C/∂p at some poses, mm per unit of each parameter, by reverse differentiation.

    positions: raw rig parameters (b, m) → positions (b, c, 3) of the points in mm.
    """
    rows = []
    for one in np.asarray(params, np.float32):
        with torch.no_grad():
            shape = positions(torch.from_numpy(one[None].copy()))[0].shape
        copies = torch.from_numpy(np.tile(one, (shape.numel(), 1))).requires_grad_(True)  # one for each coordinate
        positions(copies).flatten(1).diagonal().sum().backward()
        rows.append(copies.grad.view(*shape, -1).numpy())
    return np.stack(rows)


def agreement(
    approximate: Float[np.ndarray, "b c 3 m"], exact: Float[np.ndarray, "b c 3 m"], ranges: Float[np.ndarray, " m"]
) -> Agreement:
    """Return the mean over poses of how well derivatives agree, each parameter weighed by its range.

    ranges: of the parameters, so that a derivative says by how many mm a parameter's whole range would move a point.
    """
    one, other = ((each * ranges).reshape(len(each), -1).astype(np.float64) for each in (approximate, exact))
    lengths = [np.maximum(np.linalg.norm(each, axis=1), 1e-12) for each in (one, other)]
    cosine = (one * other).sum(axis=1) / (lengths[0] * lengths[1])
    return Agreement(float(cosine.mean()), float((lengths[0] / lengths[1]).mean()))


def agreement_by_region(
    approximate: Float[np.ndarray, "b c 3 m"],
    exact: Float[np.ndarray, "b c 3 m"],
    ranges: Float[np.ndarray, " m"],
    regions: Sequence[Region],
) -> dict[str, Agreement]:
    """Return the agreement at each region's points, by the region's name, and at all points, as ""."""
    parts = {region.name: region.points for region in regions}
    every = {"": agreement(approximate, exact, ranges)}
    return every | {name: agreement(approximate[:, points], exact[:, points], ranges) for name, points in parts.items()}
