"""What networks are trained and validated on: batches of samples, and Eq. 1 over their part of the mesh."""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float, Int

from replicate.approximation.losses import FacialLoss
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.samples import SampleSet
from replicate.approximation.segments import faces_touching, faces_within
from replicate.config import TrainingConfig
from replicate.geometry.mesh import Mesh

STATISTICS = 512  # training samples, spread over the set, that output lengths are taken from


class Supervision:
    """Eq. 1 on `vertices`, in that order, against training samples drawn as §3.5 says.

    movable: (v,) the vertices that some network moves; its size, and the number of faces within, are Eq. 1's n and f.
    trainable: (k,) the vertices that the network in training can change, all of `movable` by default. Only faces that
    touch one of those are in the loss; the rest of Eq. 1 is a constant. `vertices` are the corners of those faces.
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
        """Return a function from a predictor of offsets to its mean errors (mm, degrees) on the validation poses.

        base: a fixed predictor, evaluated once, that the predictor adds to.
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
