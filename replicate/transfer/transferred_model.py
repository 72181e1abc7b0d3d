"""A trained model on a mesh of another topology: its maps, read at the new mesh's texture coordinates (§6, Fig. 13).

The networks and the rig parameters stay as they are. Only U_k of Δ_k = g(I_k; U_k) changes (§3.1), so that no vertex of
the new mesh needs a counterpart on the old one.
"""

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import singledispatch

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from replicate.approximation.cnn import MapNetwork
from replicate.approximation.deformation_map import bilinear
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.segments import Segment
from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh


@singledispatch
def transferred(model: object, mesh: Mesh) -> SegmentedModel | RefinedModel:
    """Return a coarse or refined model whose `.offsets(params)` are (b, k, 3) mm, for the k vertices of a new mesh.

    mesh: the new one; its texture coordinates lie in the charts of the model's segments, whose names its segments have.
    It may have only some of them, as in Fig. 13. Raises InputError for a segment that the model has no map of.
    """
    raise InputError(f"model: expected a coarse or a refined one, which has maps, got a {type(model).__name__}.")


@transferred.register
def _coarse(model: SegmentedModel, mesh: Mesh) -> SegmentedModel:
    index = {segment.name: k for k, segment in enumerate(model.segments)}
    _check_names(mesh, index)
    members = [(index[name], np.flatnonzero(mesh.segment == k)) for k, name in enumerate(mesh.segment_names)]
    return _moved(model, [(k, vertices, mesh.uv[vertices]) for k, vertices in members], len(mesh.neutral))


@transferred.register
def _refined(model: RefinedModel, mesh: Mesh) -> SegmentedModel | RefinedModel:
    coarse, residual = transferred(model.coarse, mesh), model.residual
    charts = {segment.name: segment for segment in model.coarse.segments}
    parts = []
    for k, name in enumerate(mesh.segment_names):
        vertices, chart = np.flatnonzero(mesh.segment == k), charts[name]
        owner = square_of(chart, residual.segments, mesh.uv[vertices])
        for square in np.unique(owner[owner >= 0]):
            chosen = vertices[owner == square]
            low, size = square_extent(chart, residual.segments[square])
            parts.append((int(square), chosen, (mesh.uv[chosen] - low) / size))
    return RefinedModel(coarse, _moved(residual, parts, len(mesh.neutral))) if parts else coarse


def read_at(network: MapNetwork, uv: Float[np.ndarray, "k 2"]) -> MapNetwork:
    """Return a copy of the network whose map is read at other texture coordinates."""
    twin, grid = copy.deepcopy(network), bilinear(uv, network.map_size)
    device = network.pixels.device
    twin.register_buffer("pixels", torch.from_numpy(grid.pixels).to(device), persistent=False)
    twin.register_buffer("shares", torch.from_numpy(grid.weights).to(device), persistent=False)
    return twin


def square_of(chart: Segment, squares: Sequence[Segment], uv: Float[np.ndarray, "k 2"]) -> Int[np.ndarray, " k"]:
    """Return the index of the refinement segment that each place of a chart belongs to, −1 for none (§3.3).

    chart: a coarse segment. squares: all refinement segments, those of other charts among them. A place belongs to a
    square if it lies in it, and the original vertex nearest in the chart belongs to it too: squares may overlap.
    """
    owner_of_vertex = np.full(len(chart.vertices), -1)
    for k, square in enumerate(squares):
        owner_of_vertex[np.isin(chart.vertices, square.vertices)] = k
    owner = owner_of_vertex[cKDTree(chart.uv).query(uv)[1]]
    for k in np.unique(owner[owner >= 0]):
        low, size = square_extent(chart, squares[k])
        stretched = (uv - low) / size
        owner[(owner == k) & ((stretched < 0) | (stretched > 1)).any(1)] = -1
    return owner


def square_extent(chart: Segment, square: Segment) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Return a refinement segment's lower corner and size in its chart, from which its coordinates were stretched."""
    uv = chart.uv[np.isin(chart.vertices, square.vertices)]
    size = np.ptp(uv, axis=0)
    return uv.min(0), np.where(size > 0, size, 1).astype(uv.dtype)


def _moved(model: SegmentedModel, parts: Sequence[tuple[int, np.ndarray, np.ndarray]], count: int) -> SegmentedModel:
    """Return the model of some segments on a new mesh; parts: (segment, new vertices, their coordinates in its map)."""
    segments, networks, lengths = [], [], []
    for k, vertices, uv in parts:
        old = model.segments[k]
        segments.append(Segment(old.name, vertices.astype(np.int32), np.ascontiguousarray(uv), old.parameters))
        networks.append(read_at(model.networks[k], uv))
        lengths.append(model.lengths[k])
    return SegmentedModel(networks, segments, model.scale.cpu(), lengths, count).to(model.scale.device)


def _check_names(mesh: Mesh, known: dict[str, int]) -> None:
    unknown = [name for name in mesh.segment_names if name not in known]
    if unknown:
        raise InputError(f"mesh: the model has no map of segment {unknown[0]!r}; it has maps of {', '.join(known)}.")


# Misplaced texture coordinates: how well the charts of two meshes have to be aligned (§6).


def shifted(mesh: Mesh, shift: float, rng: np.random.Generator) -> Mesh:
    """Return the mesh with each segment's texture coordinates shifted in a random direction.

    shift: by how much, in widths of a chart; a pixel of a map of `size` pixels is 1 / (size − 1).
    """
    angles = rng.uniform(0, 2 * np.pi, len(mesh.segment_names))
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return _with_uv(mesh, mesh.uv + shift * directions[mesh.segment])


def turned(mesh: Mesh, angle_deg: float, rng: np.random.Generator) -> Mesh:
    """Return the mesh with each segment's texture coordinates turned about the middle of its chart, either way round.

    The middle is that of the coordinates' extent.
    """
    signs = rng.choice([-1.0, 1.0], len(mesh.segment_names))
    uv = mesh.uv.astype(np.float64)
    for k, sign in enumerate(signs):
        members = mesh.segment == k
        middle = (uv[members].min(0) + uv[members].max(0)) / 2
        angle = np.radians(sign * angle_deg)
        rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        uv[members] = (uv[members] - middle) @ rotation + middle
    return _with_uv(mesh, uv)


def _with_uv(mesh: Mesh, uv: np.ndarray) -> Mesh:
    return replace(mesh, uv=np.clip(uv, 0, 1).astype(np.float32))
