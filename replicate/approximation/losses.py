"""The loss of Eq. 1: L1 on vertices plus α times L1 on face normals, positions in millimetres.

`reference_loss` is the equation in plain torch. `FacialLoss` is the same on the CPU in one compiled pass that gives
value and gradient together, since torch's normals and their backward pass alone take longer than the networks.
α depends on the unit of length: the paper's 5 goes with millimetres.
"""

import numpy as np
import torch
from jaxtyping import Float, Int

from replicate.approximation.kernels.loss_kernel import LANES, loss_and_gradient


def unit_normals(
    vertices: Float[torch.Tensor, "b n 3"], faces: Int[torch.Tensor, "f 3"]
) -> Float[torch.Tensor, "b f 3"]:
    """Return each face's unit normal; zero, with no gradient, where a face has no area."""
    a, b, c = (vertices[:, faces[:, k]] for k in range(3))
    cross = torch.linalg.cross(b - a, c - a)
    squared = (cross * cross).sum(-1, keepdim=True)
    empty = squared == 0
    return torch.where(empty, 0.0, cross / torch.where(empty, 1.0, squared).sqrt())


def reference_loss(
    vertices: Float[torch.Tensor, "b n 3"],
    target: Float[torch.Tensor, "b n 3"],
    faces: Int[torch.Tensor, "f 3"],
    normal_weight: float,
    vertex_count: int,
    face_count: int,
) -> Float[torch.Tensor, ""]:
    """Return Eq. 1 of approximated and true vertices (mm), averaged over the batch.

    vertex_count, face_count: n and f of Eq. 1. They are those of all that the networks move even where `vertices` and
    `faces` are the part that a refinement network can change, so that both stages weigh the two terms alike.
    """
    distance = (vertices - target).abs().sum() / vertex_count
    normals = (unit_normals(vertices, faces) - unit_normals(target, faces)).abs().sum() / face_count
    return (distance + normal_weight * normals) / len(vertices)


class FacialLoss:
    """Eq. 1 for one set of faces: compiled on the CPU, `reference_loss` elsewhere.

    neutral: (n, 3) mm. faces: (f, 3), indices into the n vertices. The other arguments as in `reference_loss`.
    Called with offsets Δ and true offsets, both (b, n, 3) mm, it returns the loss, differentiable in Δ.
    """

    def __init__(
        self, neutral: np.ndarray, faces: np.ndarray, normal_weight: float, vertex_count: int, face_count: int
    ):
        self.neutral, self.faces = np.ascontiguousarray(neutral, np.float32), np.ascontiguousarray(faces, np.int32)
        self.normal_weight, self.vertex_count, self.face_count = float(normal_weight), vertex_count, face_count
        self._there = None  # neutral and faces on another device, once one asks

    def __call__(self, offsets: Float[torch.Tensor, "b n 3"], target: Float[torch.Tensor, "b n 3"]) -> torch.Tensor:
        if offsets.device.type == "cpu":
            return _CompiledLoss.apply(offsets, target, self)
        if self._there is None:
            self._there = [torch.from_numpy(array).to(offsets.device) for array in (self.neutral, self.faces)]
        neutral, faces = self._there
        counts = (self.vertex_count, self.face_count)
        return reference_loss(neutral + offsets, neutral + target, faces, self.normal_weight, *counts)


class _CompiledLoss(torch.autograd.Function):
    @staticmethod
    def forward(ctx, offsets, target, loss: FacialLoss):
        b, n, _ = offsets.shape
        value, gradient = 0.0, torch.empty(b, n, 3)
        for start in range(0, b, LANES):
            lanes = min(LANES, b - start)
            posed = [_lanes_last(part[start : start + lanes], loss.neutral) for part in (offsets.detach(), target)]
            part, slope = loss_and_gradient(
                *posed, loss.faces, 1 / (b * loss.vertex_count), loss.normal_weight / (b * loss.face_count)
            )
            value += part
            gradient[start : start + lanes] = torch.from_numpy(slope)[:, :, :lanes].permute(2, 0, 1)
        ctx.save_for_backward(gradient)
        return torch.tensor(value, dtype=torch.float32)

    @staticmethod
    def backward(ctx, upstream):
        (gradient,) = ctx.saved_tensors
        return gradient * upstream, None, None


def _lanes_last(offsets: torch.Tensor, neutral: np.ndarray) -> np.ndarray:
    """Return vertices as (n, 3, LANES), the batch in the lanes; spare lanes stay in the neutral pose."""
    posed = torch.from_numpy(neutral)[:, :, None].repeat(1, 1, LANES)
    posed[:, :, : len(offsets)] += offsets.permute(1, 2, 0)
    return posed.numpy()
