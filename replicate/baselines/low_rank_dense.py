"""A trained dense network in few bytes: its last layer as a low-rank product, by PCA of the layer's outputs.

The output layer W h + b maps w hidden activations to 3k coordinates. The principal components of its outputs over
training poses lie in its range, so that W ≈ A B, where A (3k, r) are the components and B (r, w) gives their
coefficients from the activations: the truncated SVD of W in the metric of the activations. What is cut stays at its
mean; nothing is trained again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import nn
from torch.nn import functional

from replicate.approximation.model import SegmentedModel
from replicate.approximation.segments import Segment
from replicate.base.exceptions import InputError
from replicate.baselines.dense import DenseNetwork
from replicate.regional.basis import RegionalBasis
from replicate.regional.model import StoredBasis, store

FINE = 8  # components of each network in 16 bits: in 8, rounding alone turns normals by a degree
NEGLIGIBLE = 1e-6  # of the first component's length: a shorter one is rounding


@dataclass(frozen=True)
class OutputComponents:
    """The principal components of a layer's outputs W h + b over some poses.

    lengths: (c,), each component's standard deviation, the largest first.
    shapes: (c, d), the components, each of that length.
    readers: (c, w), by which readers · (h − middle) are coefficients of variance 1.
    middle: (w,), the mean activations.
    mean: (d,), the mean outputs.
    """

    lengths: Float64[np.ndarray, " c"]
    shapes: Float64[np.ndarray, "c d"]
    readers: Float64[np.ndarray, "c w"]
    middle: Float64[np.ndarray, " w"]
    mean: Float64[np.ndarray, " d"]


def output_components(
    weight: Float[np.ndarray, "d w"], bias: Float[np.ndarray, " d"], activations: Float[np.ndarray, "b w"]
) -> OutputComponents:
    """Return the principal components of the outputs `weight` h + `bias` over some activations h."""
    weight, activations = weight.astype(np.float64), activations.astype(np.float64)
    middle = activations.mean(0)
    centred = activations - middle
    variances, axes = np.linalg.eigh(centred.T @ centred / len(centred))
    shapes, lengths, _ = np.linalg.svd(weight @ (axes * np.sqrt(np.maximum(variances, 0.0))), full_matrices=False)
    present = lengths > NEGLIGIBLE * lengths.max(initial=0.0)
    shapes, lengths = shapes[:, present].T, lengths[present]
    readers = shapes @ weight / lengths[:, None]
    return OutputComponents(lengths, shapes * lengths[:, None], readers, middle, weight @ middle + bias)


class LowRankNetwork(nn.Module):
    """(b, j) scaled parameters → (b, k, 3) offsets in mm, by weights as they are stored.

    hidden: layers in float16, each followed by a leaky ReLU.
    slope: of the leaky ReLUs.
    inner: (r, w) int8, from activations to coefficients.
    steps: (r,), what each row of `inner` is multiplied by.
    outer: the components and the constant, in mm.
    """

    inner: torch.Tensor
    inner_steps: torch.Tensor

    def __init__(
        self, hidden: Sequence[nn.Linear], slope: float, inner: torch.Tensor, steps: torch.Tensor, outer: StoredBasis
    ):
        super().__init__()
        self.hidden, self.slope, self.outer = nn.ModuleList(hidden), slope, outer
        self.register_buffer("inner", inner)
        self.register_buffer("inner_steps", steps)

    @cached_property
    def _floats(self) -> tuple:
        layers = [(layer.weight.float(), layer.bias.float()) for layer in self.hidden]
        inner = self.inner.float() * self.inner_steps[:, None]
        return layers, inner, self.outer.components(), self.outer.mean.float().flatten()

    def activations(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b w"]:
        """Return the activations of the last hidden layer."""
        x = params
        for weight, bias in self._floats[0]:
            x = functional.leaky_relu(functional.linear(x, weight, bias), self.slope)
        return x

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        _, inner, components, mean = self._floats
        return torch.addmm(mean, self.activations(params) @ inner.T, components).unflatten(1, (-1, 3))

    def size_bytes(self) -> int:
        """Return how many bytes the network takes as it is stored."""
        layers = sum(2 * value.numel() for value in self.hidden.parameters())
        return layers + self.inner.numel() + 4 * self.inner_steps.numel() + self.outer.size_bytes()


def low_rank(
    network: DenseNetwork, segment: Segment, components: OutputComponents, rank: int, length: float
) -> LowRankNetwork:
    """Return a dense network whose last layer is replaced by the first components of its outputs.

    The constant makes up for what rounding does to the mean.

    network: of one segment.
    segment: whose vertices it moves.
    components: of the network's outputs.
    rank: how many of them are kept.
    length: the mm that the network's outputs are multiplied by.
    """
    hidden = [_half(layer) for layer in network.hidden]
    readers = components.readers[:rank]
    largest = np.abs(readers).max(axis=1, initial=0.0)
    steps = np.where(largest > 0, largest, 1.0) / np.iinfo(np.int8).max
    inner = np.rint(readers / steps[:, None])
    shapes = (components.shapes[:rank] * length).reshape(rank, -1, 3)
    outer = store(
        RegionalBasis(segment.vertices, _as_points(components.mean * length), shapes.astype(np.float32)), FINE
    )
    at_middle = (inner * steps[:, None]) @ components.middle
    constant = components.mean * length - at_middle @ outer.components().double().numpy()
    outer.mean.copy_(torch.from_numpy(_as_points(constant)))
    parts = (torch.from_numpy(inner.astype(np.int8)), torch.from_numpy(steps.astype(np.float32)))
    return LowRankNetwork(hidden, network.slope, *parts, outer)


def stored_bytes(widths: Sequence[int], outputs: int, rank: int) -> int:
    """Return the bytes of a `LowRankNetwork` of some rank. widths: of its inputs and hidden layers. outputs: 3k."""
    layers = sum(2 * (a * b + b) for a, b in pairwise(widths))
    fine = min(rank, FINE)
    return layers + rank * (widths[-1] + 4) + rank * (outputs + 4) + fine * outputs + 2 * outputs


def choose_ranks(
    networks: Sequence[DenseNetwork], components: Sequence[OutputComponents], lengths: Sequence[float], size_mb: float
) -> list[int]:
    """Return how many components each network keeps, so that all networks take at most `size_mb` of 10⁶ bytes.

    The components of all networks are taken by their variance a coordinate in mm², the largest first, until there is no
    room for the next. Raises InputError where the networks have no room even without components.
    """
    widths = [(n.hidden[0].in_features, *(layer.out_features for layer in n.hidden)) for n in networks]
    outputs, ranks = [network.output.out_features for network in networks], [0] * len(networks)
    used, room = sum(stored_bytes(w, d, 0) for w, d in zip(widths, outputs, strict=True)), size_mb * 1e6
    if used > room:
        raise InputError(
            f"a dense network without its last layer takes {used / 1e6:.2f} MB, where the refined model has "
            f"{size_mb:.2f}: make the first widths of dense.hidden smaller."
        )
    queue = sorted(
        (-((part * length) ** 2) / outputs[k], k)
        for k, (of_network, length) in enumerate(zip(components, lengths, strict=True))
        for part in of_network.lengths
    )
    for _, k in queue:
        more = stored_bytes(widths[k], outputs[k], ranks[k] + 1) - stored_bytes(widths[k], outputs[k], ranks[k])
        if used + more > room:
            break
        ranks[k], used = ranks[k] + 1, used + more
    return ranks


def compact(model: SegmentedModel, params: Float[np.ndarray, "b m"], size_mb: float) -> SegmentedModel:
    """Return a trained dense model in at most `size_mb`, made of `LowRankNetwork`s.

    params: raw rig parameters of the training poses whose outputs the principal components are of.
    """
    scaled = torch.from_numpy(np.array(params, np.float32)) / model.scale
    components = []
    for network, segment in zip(model.networks, model.segments, strict=True):
        x = scaled[:, torch.from_numpy(segment.parameters).long()]
        with torch.no_grad():
            for layer in network.hidden:
                x = functional.leaky_relu(layer(x), network.slope)
            weight, bias = network.output.weight.numpy(), network.output.bias.numpy()
            components.append(output_components(weight, bias, x.numpy()))
    ranks = choose_ranks(list(model.networks), components, model.lengths, size_mb)
    parts = zip(model.networks, model.segments, components, ranks, model.lengths, strict=True)
    networks = [low_rank(*part) for part in parts]
    return SegmentedModel(networks, model.segments, model.scale, [1.0] * len(networks), model.vertex_count)


def empty_network(segment: Segment, facts: dict) -> LowRankNetwork:
    """Return a network without weights, for `model.load_model`; facts: hidden, leaky_slope, ranks by segment."""
    widths, rank, k = (len(segment.parameters), *facts["hidden"]), facts["ranks"][segment.name], len(segment.vertices)
    hidden = [nn.Linear(a, b).half() for a, b in pairwise(widths)]
    fine = min(rank, FINE)
    outer = StoredBasis(
        torch.zeros(k, dtype=torch.int32),
        torch.ones(k),
        torch.zeros(k, 3, dtype=torch.float16),
        torch.zeros(fine, k, 3, dtype=torch.int16),
        torch.zeros(rank - fine, k, 3, dtype=torch.int8),
        torch.zeros(rank),
    )
    inner = torch.zeros(rank, widths[-1], dtype=torch.int8)
    return LowRankNetwork(hidden, facts["leaky_slope"], inner, torch.zeros(rank), outer)


def size_mb(model: SegmentedModel) -> float:
    """Return the size of a model of `LowRankNetwork`s as it is stored, in MB of 10⁶ bytes."""
    return sum(network.size_bytes() for network in model.networks) / 1e6


def _half(layer: nn.Linear) -> nn.Linear:
    copy = nn.Linear(layer.in_features, layer.out_features).half()
    with torch.no_grad():
        copy.weight.copy_(layer.weight)
        copy.bias.copy_(layer.bias)
    return copy


def _as_points(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, 3).astype(np.float32)
