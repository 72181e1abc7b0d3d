"""Inverse kinematics by iteration: Eq. 8 minimised anew for each configuration, instead of by a network (§4).

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
    """params: (m,). evaluations: how often the approximation and its gradient were asked for."""

    params: np.ndarray
    evaluations: int


def solve(
    positions: Callable[[torch.Tensor], torch.Tensor],
    target: Float[np.ndarray, "c 3"],
    default: Float[np.ndarray, " m"],
    lower: Float[np.ndarray, " m"],
    upper: Float[np.ndarray, " m"],
    ranges: Float[np.ndarray, " m"],
    driven: Int[np.ndarray, " d"],
    axes: int,
    regularisation: float,
    iterations: int = 100,
) -> Solution:
    """Minimise Eq. 8 from the neutral pose by L-BFGS-B within the controls' limits.

    positions: raw rig parameters (b, m) → positions (b, c, 3) of the control points in mm. driven: the parameters that
    may move. axes: how many coordinates of a point count. regularisation: λ_reg in mm.
    """
    goal, start = torch.from_numpy(np.array(target, np.float32)), torch.from_numpy(np.array(default, np.float32))
    index, scale = torch.from_numpy(np.asarray(driven)).long(), torch.from_numpy(ranges[driven].astype(np.float32))

    def loss(moves: np.ndarray) -> tuple[float, np.ndarray]:
        shares = torch.from_numpy(moves.astype(np.float32)).requires_grad_(True)
        params = start.index_add(0, index, shares * scale)
        apart = (positions(params[None])[0] - goal)[:, :axes]
        fit = (apart.square() + SMOOTH_MM**2).sqrt().sum(dim=1).mean()
        size = (shares.square() + SMOOTH_SHARE**2).sqrt().sum()
        value = fit + regularisation * size
        value.backward()
        return float(value.detach()), shares.grad.numpy().astype(np.float64)

    limits = list(zip(*((each - default)[driven] / ranges[driven] for each in (lower, upper)), strict=True))
    options = {"maxiter": iterations}
    result = scipy.optimize.minimize(
        loss, np.zeros(len(driven)), jac=True, method="L-BFGS-B", bounds=limits, options=options
    )
    params = np.array(default, np.float32)
    params[driven] += (result.x * ranges[driven]).astype(np.float32)
    return Solution(params, int(result.nfev))
