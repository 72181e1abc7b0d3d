"""The regional method's training step on coefficients, as ours is, and on meshes, as one would write it first."""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import nn

from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.regional_model import RegionalModel, regional_loss
from replicate.approximation.supervision import Supervision
from replicate.benchmarks.plain_networks import PlainLoss
from replicate.methods import regional

STREAM = "bench"  # of the batches that are drawn


class OnMeshes(nn.Module):
    """Raw rig parameters (b, m) → offsets (b, v, 3), mm, of some vertices: what a loss of meshes needs."""

    def __init__(self, model: RegionalModel, vertices: Int[np.ndarray, " v"]):
        super().__init__()
        self.network, self.scale, self.moved = model.network, model.scale, model.moved
        order = np.argsort(model.vertices)
        self.order = torch.from_numpy(order[np.searchsorted(model.vertices, vertices, sorter=order)])

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b v 3"]:
        return self.moved(self.network(params / self.scale))[:, self.order]


class OnCoefficients(nn.Module):
    """Raw rig parameters (b, m) → coefficients (b, d) over the network's unit of length."""

    def __init__(self, model: RegionalModel):
        super().__init__()
        self.network, self.scale = model.network, model.scale

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b d"]:
        return self.network(params / self.scale)


def fresh_regional(
    supervision: Supervision,
    influence: Bool[np.ndarray, "n m"],
    section: regional.RegionalConfig,
    seed: int,
    progress: Callable,
) -> tuple[RegionalModel, Float[np.ndarray, "s d"]]:
    """Return the method's model with random weights, and all training samples' coefficients over its length."""
    samples = supervision.samples
    bases, _, coefficients = regional.stored_bases(supervision, section, progress)
    length = float(np.sqrt(np.mean(np.square(coefficients), dtype=np.float64))) or 1.0
    network = regional.untrained_networks(bases, influence, section)
    generator = torch.Generator().manual_seed(seed)
    for part in network.networks:
        part.start(np.zeros((part.layers[0].in_features + 1, part.output.out_features)), generator)
    model = RegionalModel(network, bases, parameter_scale(samples.params), length, len(supervision.mesh.neutral))
    return model, coefficients / np.float32(length)


def regional_ways(
    model: RegionalModel, supervision: Supervision, plain: str, loss: str, ours: str
) -> dict[str, tuple[nn.Module, Callable]]:
    """Return the ways to train it, by the names that are given: on meshes by either loss, and on coefficients.

    A target is a pair: true offsets (b, v, 3) in mm, and coefficients (b, d).
    """
    counts = [len(basis.steps) for basis in model.bases]
    membership = torch.from_numpy(np.eye(len(counts), dtype=np.float32)[np.repeat(np.arange(len(counts)), counts)])
    on_meshes, of_meshes = OnMeshes(model, supervision.vertices), PlainLoss(supervision.loss)
    return {
        plain: (on_meshes, lambda offsets, target: of_meshes(offsets, target[0])),
        loss: (on_meshes, lambda offsets, target: supervision.loss(offsets, target[0])),
        ours: (OnCoefficients(model), lambda found, target: regional_loss(found - target[1], membership)),
    }


def regional_batches(
    supervision: Supervision,
    coefficients: Float[np.ndarray, "s d"],
    section: regional.RegionalConfig,
    seed: int,
    rounds: int,
) -> list[tuple[torch.Tensor, tuple[torch.Tensor, torch.Tensor]]]:
    """Return batches of raw rig parameters (b, m) and targets, as `regional_ways` needs them."""
    batches = []
    for turn in range(rounds):
        rows = supervision.samples.draw_for_step(seed, STREAM, turn, section.training.batch, section.training.draws)
        params, offsets = supervision.batch(seed, STREAM, turn, section.training)
        batches.append((params, (offsets, torch.from_numpy(np.ascontiguousarray(coefficients[rows])))))
    return batches
