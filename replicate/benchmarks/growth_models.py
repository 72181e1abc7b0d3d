"""Models of any size with weights drawn at random, for times alone: what a network multiplies does not change them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from replicate.approximation import cnn, dense
from replicate.approximation.linear_skip import Line
from replicate.approximation.model import SegmentedModel
from replicate.approximation.regional_model import RegionalModel, StoredBasis
from replicate.approximation.regional_networks import fresh_networks
from replicate.approximation.segments import Segment
from replicate.config import CoarseConfig, DenseConfig
from replicate.geometry.mesh import Mesh
from replicate.methods.regional import RegionalConfig

COARSE, DENSE, LINEAR, OURS = "coarse", "dense", "linear", "regional"
PARAMETERS, SEEN = 256, 100  # of the rig, and by the network of each segment, and of each region
OWN = RegionalConfig()  # of ours
RING = 5.3  # a region of k vertices has about this times √k in the ring about it, as on the teen


@dataclass(frozen=True)
class Face:
    """What is varied; by default about what `teen` has."""

    vertices: int = 11_200
    segments: int = 8
    map_size: int = 32
    components: int = 96


def models_of(face: Face, names: tuple[str, ...]) -> dict[str, SegmentedModel | RegionalModel]:
    """Return the models of a face by method: networks of the usual widths, vertices dealt evenly to all segments.

    The charts' vertices lie anywhere in them, so that a map's pixels are read evenly.
    """
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    parts = np.array_split(np.arange(face.vertices, dtype=np.int32), face.segments)
    segments = [
        Segment(
            f"segment {k}",
            own,
            rng.uniform(size=(len(own), 2)).astype(np.float32),
            _some_parameters(rng),
        )
        for k, own in enumerate(parts)
    ]
    maps = cnn.shape_facts(CoarseConfig(map_size=face.map_size))
    make = {
        COARSE: lambda: _segmented([cnn.make_network(s, maps) for s in segments], segments, face),
        DENSE: lambda: _segmented(
            [dense.make_network(s, dense.shape_facts(DenseConfig())) for s in segments], segments, face
        ),
        LINEAR: lambda: _segmented([_line(s) for s in segments], segments, face),
        OURS: lambda: _regional(face, rng),
    }
    return {name: make[name]() for name in names}


def flat_mesh(vertices: int) -> Mesh:
    """Return a mesh of so many vertices anywhere; nothing here needs its triangles."""
    places = np.random.default_rng(1).normal(size=(vertices, 3)).astype(np.float32)
    faces, uv = np.array([[0, 1, 2]], np.int32), np.zeros((vertices, 2), np.float32)
    return Mesh(places, faces, uv, np.zeros(vertices, np.int32), ("face",))


def _segmented(networks: list, segments: list[Segment], face: Face) -> SegmentedModel:
    scale = np.ones(PARAMETERS, np.float32)
    return SegmentedModel(networks, segments, scale, [1.0] * len(segments), face.vertices)


def _line(segment: Segment) -> Line:
    line = Line(len(segment.parameters), len(segment.vertices))
    line.weight.normal_()
    return line


def _regional(face: Face, rng: np.random.Generator) -> RegionalModel:
    bases = list(_bases(face, rng))
    seen = [_some_parameters(rng) for _ in bases] if OWN.by_region else [np.arange(PARAMETERS)]
    network = fresh_networks(seen, OWN.hidden, [face.components] * len(bases), OWN.gated, OWN.line)
    with torch.no_grad():
        for weight in network.parameters():  # in 16 bits, as trainings leave them
            weight.copy_(weight.half().float())
    return RegionalModel(network, bases, np.ones(PARAMETERS, np.float32), 1.0, face.vertices)


def _some_parameters(rng: np.random.Generator) -> np.ndarray:
    return np.sort(rng.choice(PARAMETERS, SEEN, replace=False)).astype(np.int32)


def _bases(face: Face, rng: np.random.Generator) -> Iterator[StoredBasis]:
    fine = min(OWN.fine, face.components)
    for region in np.array_split(np.arange(face.vertices, dtype=np.int32), OWN.regions):
        beyond = min(round(RING * len(region) ** 0.5), face.vertices - len(region)) if OWN.blend_rings else 0
        own = (region[0] + np.arange(len(region) + beyond, dtype=np.int32)) % face.vertices
        yield StoredBasis(
            torch.from_numpy(own),
            torch.ones(len(own)),
            torch.zeros(len(own), 3, dtype=torch.float16),
            torch.from_numpy(rng.integers(-9999, 9999, (fine, len(own), 3)).astype(np.int16)),
            torch.from_numpy(rng.integers(-99, 99, (face.components - fine, len(own), 3)).astype(np.int8)),
            torch.full((face.components,), 1e-4),
        )
