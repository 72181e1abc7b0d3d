"""Inverse kinematics by iteration: Eq. 6 with the penalty of Eq. 8, minimised anew for each configuration (§4).

The paper turns it down for its speed. Here it says how much of an error is the network's, and how much the gradient's.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float, Int

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

    The configurations have nothing in common, so that the sum over them is least where each is; a batch costs little
    more than one. positions: raw rig parameters (b, m) → positions (b, c, 3) of the control points in mm. driven: the
    parameters that may move. axes: how many coordinates of a point count. regularisation: λ_reg in mm.
    """
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
