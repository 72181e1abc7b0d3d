"""Approximations at a few vertices: r̃_C(p) of Eq. 7, cheap and differentiable in p, for every method with a model."""

import copy
from collections.abc import Callable
from functools import singledispatch

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn

from replicate.approximation.cnn import MapNetwork
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.base.exceptions import InputError
from replicate.baselines.dense import DenseNetwork
from replicate.baselines.line import Line
from replicate.regional.model import RegionalModel
from replicate.regional.networks import RegionalNetworks

Points = Callable[[Float[torch.Tensor, "b m"]], Float[torch.Tensor, "b c 3"]]


def at_vertices(model: object, vertices: Int[np.ndarray, " c"]) -> Points:
    """Return raw rig parameters (b, m) → offsets (b, c, 3) of some vertices in mm, differentiable in the parameters.

    The weights are frozen. A model of a class that isn't registered here needs a method `at_vertices(vertices)` that
    returns the same; InputError without one.
    """
    points = _at_vertices(model, np.asarray(vertices))
    if isinstance(points, nn.Module):
        points.requires_grad_(False)
    return points


@singledispatch
def _at_vertices(model: object, vertices: np.ndarray) -> Points:
    if not hasattr(model, "at_vertices"):
        raise InputError(f"{type(model).__name__} can't be differentiated: it has no function at_vertices(vertices)")
    return model.at_vertices(vertices)


class SegmentPoints(nn.Module):
    """Some vertices of a segmented model: the networks that move them, each narrowed to them."""

    def __init__(self, model: SegmentedModel, vertices: np.ndarray):
        super().__init__()
        self.count, self.parts = len(vertices), []
        networks = []
        self.register_buffer("scale", model.scale)
        for network, segment, length in zip(model.networks, model.segments, model.lengths, strict=True):
            order = np.argsort(segment.vertices)
            place = order[np.searchsorted(segment.vertices, vertices, sorter=order).clip(max=len(order) - 1)]
            moved = np.flatnonzero(segment.vertices[place] == vertices)
            if len(moved):
                networks.append(narrow(network, place[moved]))
                index = (torch.from_numpy(segment.parameters).long(), torch.from_numpy(moved))
                self.parts.append((*index, length))
        self.networks = nn.ModuleList(networks)

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b c 3"]:
        scaled = params / self.scale
        out = torch.zeros(len(params), self.count, 3, dtype=params.dtype, device=params.device)
        for network, (parameters, moved, length) in zip(self.networks, self.parts, strict=True):
            out = out.index_add(1, moved, network(scaled[:, parameters]) * length)
        return out


_at_vertices.register(SegmentedModel, SegmentPoints)


@_at_vertices.register
def _(model: RefinedModel, vertices: np.ndarray) -> Points:
    coarse, residual = SegmentPoints(model.coarse, vertices), SegmentPoints(model.residual, vertices)
    return Sum(coarse, residual)


class Sum(nn.Module):
    """The sum of two models at the same vertices."""

    def __init__(self, one: nn.Module, other: nn.Module):
        super().__init__()
        self.one, self.other = one, other

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b c 3"]:
        return self.one(params) + self.other(params)


class RegionalPoints(nn.Module):
    """Some vertices of our regional model: the networks that move them, and of each basis the rows that they read."""

    def __init__(self, model: RegionalModel, vertices: np.ndarray):
        super().__init__()
        self.length = model.length
        self.register_buffer("scale", model.scale)
        counts = [len(basis.steps) for basis in model.bases]
        shapes = torch.zeros(sum(counts), len(vertices), 3)
        mean = torch.zeros(len(vertices), 3)
        for basis, first in zip(model.bases, np.cumsum([0, *counts[:-1]]), strict=True):
            members = basis.vertices.numpy()
            for i, vertex in enumerate(vertices):
                if len(place := np.flatnonzero(members == vertex)):
                    rows = slice(int(first), int(first) + len(basis.steps))
                    shapes[rows, i] = basis.components().unflatten(1, (-1, 3))[:, int(place[0])]
                    mean[i] += basis.means()[int(place[0])]
        widths = [network.output.out_features for network in model.network.networks]
        parts = list(zip(model.network.networks, model.network.seen, shapes.split(widths), strict=True))
        parts = [part for part in parts if part[2].any()] or parts[:1]
        networks, seen, kept = zip(*parts, strict=True)
        self.network = copy.deepcopy(RegionalNetworks(networks, [parameters.numpy() for parameters in seen]))
        self.register_buffer("shapes", torch.cat(kept).flatten(1))
        self.register_buffer("mean", mean.flatten())

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b c 3"]:
        coefficients = self.network(params / self.scale) * self.length
        return torch.addmm(self.mean, coefficients, self.shapes).unflatten(1, (-1, 3))


_at_vertices.register(RegionalModel, RegionalPoints)


class Indexed(nn.Module):
    """A network's outputs at some of its vertices, for networks that can't be narrowed."""

    def __init__(self, network: nn.Module, places: np.ndarray):
        super().__init__()
        self.network, self.places = copy.deepcopy(network), torch.from_numpy(places)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return self.network(params)[:, self.places]


@singledispatch
def narrow(network: nn.Module, places: Int[np.ndarray, " k"]) -> nn.Module:
    """Return a network that gives only the offsets of some of its segment's vertices."""
    return Indexed(network, places)


@narrow.register
def _(network: MapNetwork, places: np.ndarray) -> nn.Module:
    twin = copy.deepcopy(network)
    twin.pixels, twin.shares = network.pixels[places].clone(), network.shares[places].clone()
    return twin


@narrow.register
def _(network: DenseNetwork, places: np.ndarray) -> nn.Module:
    twin = copy.deepcopy(network)
    rows = torch.from_numpy((3 * places[:, None] + np.arange(3)).ravel())
    twin.output = nn.Linear(network.output.in_features, len(rows))
    with torch.no_grad():
        twin.output.weight.copy_(network.output.weight[rows])
        twin.output.bias.copy_(network.output.bias[rows])
    return twin


@narrow.register
def _(network: Line, places: np.ndarray) -> nn.Module:
    columns = torch.from_numpy((3 * places[:, None] + np.arange(3)).ravel())
    twin = Line(network.weight.shape[0], len(places))
    twin.weight.copy_(network.weight[:, columns])
    twin.bias.copy_(network.bias[columns])
    return twin
