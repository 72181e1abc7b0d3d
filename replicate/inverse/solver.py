"""Inverse kinematics by iteration: Eq. 6 with the penalty of Eq. 8, minimised anew for each configuration (§4).

The paper rejects it as too slow. Here it tells how much of an error comes from the network, and how much from the
gradient.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float, Float32, Int

from replicate.inverse.control_points import Region

SMOOTH_MM, SMOOTH_SHARE = 0.01, 1e-3  # below these lengths |x| is rounded off, so that it has a derivative everywhere


@dataclass(frozen=True)
class Solution:
    """params: (k, m). evaluations: how often the approximation and its gradient were asked for."""

    params: np.ndarray
    evaluations: int


def solve(
    positions: Callable[[torch.Tensor], torch.Tensor],
    targets: Float[np.ndarray, "k c 3"],
    default: Float[np.ndarray, " m"],
    lower: Float[np.ndarray, " m"],
    upper: Float[np.ndarray, " m"],
    ranges: Float[np.ndarray, " m"],
    driven: Int[np.ndarray, " d"],
    axes: int,
    regularisation: float,
    iterations: int = 150,
) -> Solution:
    """Minimise Eq. 8 from the neutral pose by L-BFGS-B within the controls' limits, for all configurations at once.

    The configurations are independent, so their sum is least where each of them is.

    positions: raw rig parameters (b, m) → positions (b, c, 3) of the control points in mm
    targets: where the control points are wanted, mm
    default: parameters of the neutral pose
    lower, upper: limits of the parameters
    ranges: as of `parameter_ranges`
    driven: indices of the parameters that may move
    axes: how many coordinates of a point are used
    regularisation: λ_reg, mm
    iterations: the most that are made
    """
    # Eq. 8 and its gradient in shares of the parameters' ranges
    goals, start = torch.from_numpy(np.array(targets, np.float32)), torch.from_numpy(np.array(default, np.float32))
    index, scale = torch.from_numpy(np.asarray(driven)).long(), torch.from_numpy(ranges[driven].astype(np.float32))
    shape = len(goals), len(driven)

    def loss(moves: np.ndarray) -> tuple[float, np.ndarray]:
        shares = torch.from_numpy(moves.reshape(shape).astype(np.float32)).requires_grad_(True)
        params = start.expand(shape[0], -1).index_add(1, index, shares * scale)
        apart = (positions(params) - goals)[..., :axes]
        fit = (apart.square() + SMOOTH_MM**2).sqrt().sum(dim=2).mean(dim=1).sum()
        size = (shares.square() + SMOOTH_SHARE**2).sqrt().sum()
        value = fit + regularisation * size
        value.backward()
        return float(value.detach()), shares.grad.numpy().astype(np.float64).ravel()

    # minimised within the limits
    limits = [
        tuple(pair)
        for pair in zip(*((each - default)[driven] / ranges[driven] for each in (lower, upper)), strict=True)
    ]
    options = {"maxiter": iterations, "maxfun": 2 * iterations}
    result = scipy.optimize.minimize(
        loss, np.zeros(shape).ravel(), jac=True, method="L-BFGS-B", bounds=limits * shape[0], options=options
    )
    params = np.tile(np.array(default, np.float32), (shape[0], 1))
    params[:, driven] += (result.x.reshape(shape) * ranges[driven]).astype(np.float32)
    return Solution(params, int(result.nfev))


# How well an approximation's derivative agrees with the rig's: it is all that inverse kinematics sees of the rig (§4).


@dataclass(frozen=True)
class Agreement:
    """How well two derivatives agree. cosine: 1 where they point the same way. size: the ratio of their lengths."""

    cosine: float
    size: float


def jacobians(
    positions: Callable[[torch.Tensor], torch.Tensor], params: Float[np.ndarray, "b m"]
) -> Float32[np.ndarray, "b c 3 m"]:
    """Return ∂V_C/∂p at some poses, mm per unit of each parameter, by reverse differentiation.

    positions: raw rig parameters (b, m) → positions (b, c, 3) of the points in mm.
    """
    rows = []
    for pose in np.asarray(params, np.float32):
        with torch.no_grad():
            shape = positions(torch.from_numpy(pose[None].copy()))[0].shape
        copies = torch.from_numpy(np.tile(pose, (shape.numel(), 1))).requires_grad_(True)  # one for each coordinate
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
