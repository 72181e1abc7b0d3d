"""The loss of Eq. 1: L1 on vertices plus α times L1 on face normals, positions in millimetres.

`reference_loss` is the equation in plain torch. On the CPU, `FacialLoss` computes value and gradient in one compiled
pass, since torch's normals and their backward pass alone would take longer than the networks. α depends on the unit of
length: the paper's 5 is for millimetres.
"""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float, Int

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.samples import SampleSet
from replicate.approximation.segments import faces_touching, faces_within
from replicate.config import TrainingConfig
from replicate.geometry.mesh import Mesh
from replicate.kernels.loss_kernel import LANES, loss_and_gradient


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
    """Return Eq. 1 of approximated and true vertices, averaged over the batch.

    vertices, target: in mm.
    faces: indices into the n vertices.
    normal_weight: α.
    vertex_count, face_count: n and f of Eq. 1, those of everything that the networks move, even if `vertices` and
        `faces` are only what a refinement network can change; so both stages weigh the two terms alike.
    """
    distance = (vertices - target).abs().sum() / vertex_count
    normals = (unit_normals(vertices, faces) - unit_normals(target, faces)).abs().sum() / face_count
    return (distance + normal_weight * normals) / len(vertices)


class FacialLoss:
    """Eq. 1 for one set of faces: compiled on the CPU, `reference_loss` on other devices.

    neutral: (n, 3) mm. The other arguments are those of `reference_loss`.

    A call with offsets Δ and true offsets, both (b, n, 3) mm, returns the loss, differentiable in Δ.
    """

    def __init__(
        self, neutral: np.ndarray, faces: np.ndarray, normal_weight: float, vertex_count: int, face_count: int
    ):
        self.neutral, self.faces = np.ascontiguousarray(neutral, np.float32), np.ascontiguousarray(faces, np.int32)
        self.normal_weight, self.vertex_count, self.face_count = float(normal_weight), vertex_count, face_count
        self._on_device = None  # neutral and faces on another device, from the first call on

    def __call__(self, offsets: Float[torch.Tensor, "b n 3"], target: Float[torch.Tensor, "b n 3"]) -> torch.Tensor:
        if offsets.device.type == "cpu":
            return _CompiledLoss.apply(offsets, target, self)
        if self._on_device is None:
            self._on_device = [torch.from_numpy(array).to(offsets.device) for array in (self.neutral, self.faces)]
        neutral, faces = self._on_device
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


# What networks are trained and validated on: batches of samples, and Eq. 1 over their part of the mesh.

STATISTICS = 512  # training samples, spread over the set, that decide the output's unit


class Supervision:
    """Eq. 1 against training samples, drawn as in §3.5.

    movable: (v,) the vertices that any network moves; v, and the number of faces among them, are n and f of Eq. 1.
    normal_weight: α.
    trainable: (k,) the vertices that the network in training can change; all of `movable` by default.

    The loss is taken on `vertices`, in that order: the corners of all faces that touch a trainable vertex. The rest of
    Eq. 1 is constant.
    """

    def __init__(
        self,
        mesh: Mesh,
        samples: SampleSet,
        movable: Int[np.ndarray, " v"],
        normal_weight: float,
        device: torch.device,
        trainable: Int[np.ndarray, " k"] | None = None,
    ):
        self.mesh, self.samples, self.device, self.movable = mesh, samples, device, movable
        n = len(mesh.neutral)
        within = movable[faces_within(mesh.faces, movable, n)]  # (f, 3)
        self.faces = within
        self.vertices = movable
        if trainable is not None:
            near = within[faces_touching(within, trainable, n)]
            self.vertices = np.union1d(near, trainable)
            within = near
        corners = faces_within(within, self.vertices, n)
        self.loss = FacialLoss(mesh.neutral[self.vertices], corners, normal_weight, len(movable), len(self.faces))

    def batch(self, seed: int, stream: str, step: int, config: TrainingConfig) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the raw rig parameters (b, m) and true offsets (b, v, 3), mm, of one step."""
        indices = self.samples.draw_for_step(seed, stream, step, config.batch, config.draws)
        params = np.asarray(self.samples.params[indices], np.float32)
        return self._tensor(params), self._tensor(self.samples.vertices_subset(indices, self.vertices))

    def _tensor(self, array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, np.float32)).to(self.device)

    def validation(
        self, base: Callable[[np.ndarray], np.ndarray] | None = None
    ) -> Callable[[Callable[[np.ndarray], np.ndarray]], tuple[float, float]]:
        """Return a function: predictor of offsets → its mean errors (mm, degrees) on the validation poses.

        base: a fixed predictor that the other adds to; evaluated once.
        """
        params = np.asarray(self.samples.validation_params)
        truth = self.mesh.neutral + np.asarray(self.samples.validation_offsets)
        start = self.mesh.neutral + (base(params) if base else np.float32(0))

        def measure(predict: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
            posed = start + predict(params)
            distance = vertex_error(posed[:, self.movable], truth[:, self.movable]).mean(dtype=np.float64)
            return float(distance), float(np.nanmean(normal_error(posed, truth, self.faces), dtype=np.float64))

        return measure

    def statistics(self) -> tuple[np.ndarray, Float[np.ndarray, "s n 3"]]:
        """Return parameters and true offsets of some training samples, spread over the set."""
        rows = spread(len(self.samples.params), STATISTICS)
        return np.asarray(self.samples.params[rows]), self.samples.offsets(rows)


def spread(count: int, most: int) -> Int[np.ndarray, " k"]:
    """Return up to `most` indices, evenly spaced over range(count)."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)
