"""The stand-in face as a page has it: six control points, untrained networks, a tooth, an eyeball and a brow."""

import numpy as np
import torch
from plain_rig import PlainRig
from small_face import M, pose_offsets, small_influence, small_mesh

from data_recipes.controls import Control
from replicate.approximation.cnn import MapNetwork
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel, square_segments
from replicate.approximation.rigid import Attachments
from replicate.approximation.segments import make_segment
from replicate.inverse.control_points import control_points
from replicate.inverse.ik_network import IkModel
from replicate.poser.contents import PosedFace, as_on_page
from replicate.regional.basis import loss_metric, principal_basis
from replicate.regional.model import RegionalModel, blended, halve, store
from replicate.regional.networks import fresh_networks

MESH = small_mesh()
TOOTH, EYE_CENTRE, GAZE = 2, np.array([30.0, 40.0, 5.0]), 10


def turned(angle):
    """Return the matrix of row vectors that turns x towards y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


class PosedRig(PlainRig):
    name, mesh = "small", MESH
    controls = tuple(Control(f"c{i}", -1.0, 0.0, 2.0, "mouth" if i < 8 else "neck") for i in range(M))
    lower, default, upper = (np.full(M, value, np.float32) for value in (-1, 0, 2))
    control_points = np.array([40, 100, 170, 220, 290, 310])
    control_point_regions = ("face",) * 4 + ("neck",) * 2

    def __call__(self, params):
        return (MESH.neutral + pose_offsets(MESH, np.atleast_2d(params)).reshape(*np.shape(params)[:-1], -1, 3)).astype(
            np.float32
        )

    def pose_props(self, params):
        """A ball that turns half a radian a unit of the gaze and shifts with it, and a brow that stays."""
        rng = np.random.default_rng(0)
        ball = rng.normal(size=(40, 3))
        ball = 6 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
        posed = ball @ turned(0.5 * params[GAZE]) + EYE_CENTRE + [0, params[GAZE], 0]
        faces = np.arange(39).reshape(13, 3)  # the last vertex is in none
        brow = MESH.neutral[[0, 1, 16]] + [0, 0, 1]
        colours = np.full((40, 3), 200, np.uint8)
        return [("eye_white_left", posed, faces, colours), ("brow_left", brow, faces[:1], (90, 60, 30))]


def coarse_model(size=32, channels=16):
    """Return a CNN of two charts whose networks are drawn at random."""
    torch.manual_seed(3)
    segments = [
        make_segment(name, np.flatnonzero(MESH.segment == k), MESH.uv[MESH.segment == k], small_influence(MESH))
        for k, name in enumerate(("first", "second"))
    ]
    networks = [MapNetwork(len(s.parameters), s.uv, size, channels, (20, 64 * 5), 0.2) for s in segments]
    return SegmentedModel(networks, segments, np.linspace(0.5, 1, M), [3.0, 2.0], len(MESH.neutral))


def refined_model():
    """Return a CNN of two charts with a larger map for a part of the first one."""
    coarse = coarse_model()
    (square,) = square_segments(coarse.segments[0], np.array([[0.5, 0.5]]), small_influence(MESH), 0.5)
    network = MapNetwork(len(square.parameters), square.uv, 64, 16, (20, 64 * 5), 0.2)
    residual = SegmentedModel([network], [square], np.linspace(0.5, 1, M), [1.5], len(MESH.neutral))
    return RefinedModel(coarse, residual)


def regional_model(fine=(2, 2)):
    """Return our method's model with bases of two regions and a network that is drawn at random.

    fine: how many of each region's seven shapes are stored in 16 bits.
    """
    rng = np.random.default_rng(1)
    offsets = pose_offsets(MESH, rng.uniform(-1, 1, (60, M)))
    bases = []
    for k in (0, 1):
        vertices, others = np.flatnonzero(MESH.segment == k), np.flatnonzero(MESH.segment == 1 - k)[:9]
        metric = loss_metric(MESH.neutral[vertices], np.zeros((0, 3), int), len(vertices), 1, 0.0)
        basis = store(principal_basis(vertices, offsets[:, vertices], metric, 7), fine[k])
        weights = np.where(np.arange(len(vertices) + 9) < len(vertices), 0.75, 0.25)
        coefficients = rng.normal(size=(60, len(basis.steps)))
        bases.append(blended(basis, np.concatenate([vertices, others]), weights, coefficients, offsets[:, others]))
    counts = [len(basis.steps) for basis in bases]
    network = fresh_networks([np.arange(0, M, 2), np.arange(1, M)], (8, 8), counts, gated=True, line=True)
    for part in network.networks:
        inputs, outputs = part.layers[0].in_features, part.output.out_features
        part.start(rng.normal(size=(inputs + 1, outputs)), torch.Generator().manual_seed(0))
        part.bound(np.array([[-0.5], [0.25]]) * np.ones(inputs))
        part.limit(rng.uniform(-0.2, 0.2, (9, inputs)))
    halve(network)
    return RegionalModel(network, bases, np.linspace(0.5, 1, M), 3.0, len(MESH.neutral))


def posed_face(model=None):
    """Return a face whose networks are drawn at random; model: its approximation, as ours where there is none."""
    rig = PosedRig()
    carriers = np.flatnonzero(MESH.segment == 0)[20:120:10][None]
    attachments = Attachments(np.array([TOOTH]), carriers, np.zeros((1, 10)), np.zeros(1), np.ones((1, 3)))
    influence = small_influence(MESH)
    points = control_points(rig, influence)
    torch.manual_seed(0)
    neutral = MESH.neutral[points.vertices]
    ik = IkModel(points.regions, (16, 16), 0.2, neutral, np.full((6, 2), 3.0), rig.default, np.full(M, 1.5)).eval()
    return PosedFace(rig, as_on_page(model or regional_model()), attachments, ik, influence)
