"""The stand-in face as a page has it: six control points, untrained networks, a tooth, an eyeball and a brow."""

import numpy as np
import torch
from plain_rig import PlainRig
from small_face import M, pose_offsets, small_influence, small_mesh

from data_recipes.controls import Control
from replicate.approximation.gated_network import GatedNetwork
from replicate.approximation.regional_basis import loss_metric, principal_basis
from replicate.approximation.regional_model import RegionalModel, halve, store
from replicate.approximation.rigid import Attachments
from replicate.inverse.control_points import control_points
from replicate.inverse.ik_network import IkModel
from replicate.poser.contents import PosedFace

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


def posed_face():
    """Return a face whose networks and bases are drawn at random."""
    rng, rig = np.random.default_rng(1), PosedRig()
    offsets = pose_offsets(MESH, rng.uniform(-1, 1, (60, M)))
    bases = []
    for k in (0, 1):
        vertices = np.flatnonzero(MESH.segment == k)
        metric = loss_metric(MESH.neutral[vertices], np.zeros((0, 3), int), len(vertices), 1, 0.0)
        bases.append(store(principal_basis(vertices, offsets[:, vertices], metric, 7), 2))
    count = sum(len(basis.steps) for basis in bases)
    network = GatedNetwork(M, (8, 8), count)
    network.start(rng.normal(size=(M + 1, count)), torch.Generator().manual_seed(0))
    halve(network)
    model = RegionalModel(network, bases, np.linspace(0.5, 1, M), 3.0, len(MESH.neutral))
    carriers = np.flatnonzero(MESH.segment == 0)[20:120:10][None]
    attachments = Attachments(np.array([TOOTH]), carriers, np.zeros((1, 10)), np.zeros(1), np.ones((1, 3)))
    influence = small_influence(MESH)
    points = control_points(rig, influence)
    torch.manual_seed(0)
    neutral = MESH.neutral[points.vertices]
    ik = IkModel(points.regions, (16, 16), 0.2, neutral, np.full((6, 2), 3.0), rig.default, np.full(M, 1.5)).eval()
    return PosedFace(rig, model, attachments, ik, influence)
