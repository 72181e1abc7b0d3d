"""A model of every kind on the stand-in face, its weights drawn at random: what is written out need not be any good."""

from dataclasses import replace

import numpy as np
import torch
from posed_face import posed_face, regional_model
from small_face import M, pose_offsets, small_influence, small_mesh

from replicate.approximation import cnn
from replicate.approximation.model import SegmentedModel, fresh_model
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.segments import Segment, coarse_segments, make_segment
from replicate.baselines import dense
from replicate.baselines.line import CoefficientsBesideLine, add_line, line_model
from replicate.baselines.ridge import ProductShapes
from replicate.baselines.skinning.bone_network import BoneNetwork
from replicate.baselines.skinning.ssdr import Skin
from replicate.config import CoarseConfig, DenseConfig
from replicate.methods import pca

MESH = small_mesh()
SCALE = np.linspace(0.5, 1.5, M).astype(np.float32)
SEGMENTS = coarse_segments(MESH, {2}, small_influence(MESH))
TARGETS = pose_offsets(MESH, np.random.default_rng(7).uniform(-1, 1, (8, M)))


def coarse_model(size=16):
    config = replace(CoarseConfig(), map_size=size, hidden=(32, 128))
    networks = [cnn.make_network(segment, cnn.shape_facts(config)) for segment in SEGMENTS]
    return fresh_model(networks, SEGMENTS, SCALE, TARGETS, config, 1)


def refined_model():
    near = np.flatnonzero((MESH.segment == 0) & (np.abs(MESH.uv - 0.4).max(1) < 0.3))
    segment = make_segment("face_1", near, MESH.uv[near], small_influence(MESH))
    config = replace(CoarseConfig(), map_size=32, hidden=(32, 128))
    networks = [cnn.make_network(segment, cnn.shape_facts(config))]
    return RefinedModel(coarse_model(), fresh_model(networks, [segment], SCALE, TARGETS, config, 2))


def dense_model():
    config = DenseConfig(hidden=(16, 16))
    networks = [dense.make_network(segment, dense.shape_facts(config)) for segment in SEGMENTS]
    return fresh_model(networks, SEGMENTS, SCALE, TARGETS, config, 3)


def morph_model():
    torch.manual_seed(8)
    shape = {"hidden": [16, 16], "leaky_slope": 0.2, "shapes": 5}
    networks = [dense.make_network(segment, shape) for segment in SEGMENTS]
    return SegmentedModel(networks, SEGMENTS, SCALE, [2.0] * len(SEGMENTS), len(MESH.neutral))


def linear_model():
    rng = np.random.default_rng(1)
    weights = [rng.normal(size=(len(s.parameters) + 1, 3 * len(s.vertices))).astype(np.float32) for s in SEGMENTS]
    return line_model(SEGMENTS, weights, SCALE, len(MESH.neutral))


def products_model():
    torch.manual_seed(9)
    vertices = np.arange(len(MESH.neutral), dtype=np.int32)
    segment = Segment("mesh", vertices, np.zeros((len(vertices), 2), np.float32), np.arange(M, dtype=np.int32))
    network = ProductShapes(torch.linspace(-0.2, 0.2, M), 5, len(vertices))
    return SegmentedModel([network], [segment], SCALE, [1.0], len(vertices))


def whole_face(make):
    """Return a model of one network for all that deforms, in the span of a random basis."""
    vertices = np.flatnonzero(MESH.segment < 2).astype(np.int32)
    segment = Segment("deformable", vertices, np.zeros((len(vertices), 2), np.float32), np.arange(M, dtype=np.int32))
    torch.manual_seed(4)
    network = make(M, torch.randn(7, 3 * len(vertices)), torch.randn(3 * len(vertices)), (16, 8), 0.2)
    return SegmentedModel([network], [segment], SCALE, [1.0], len(MESH.neutral))


def driven_model():
    rng, vertices = np.random.default_rng(5), np.arange(len(MESH.neutral), dtype=np.int32)
    weights = rng.uniform(size=(len(vertices), 2)).astype(np.float32)
    bones = rng.integers(3, size=weights.shape).astype(np.int32)
    skin = Skin(MESH.neutral, bones, weights / weights.sum(1, keepdims=True), 3)
    torch.manual_seed(6)
    network = BoneNetwork(M, skin, (16, 8), 0.2)
    segment = Segment("skin", vertices, np.zeros((len(vertices), 2), np.float32), np.arange(M, dtype=np.int32))
    return SegmentedModel([network], [segment], SCALE, [1.0], len(MESH.neutral))


MODELS = {
    "coarse": coarse_model,
    "refined": refined_model,
    "dense": dense_model,
    "morph": morph_model,
    "linear": linear_model,
    "coarse beside a line": lambda: add_line(coarse_model(), linear_model()),
    "products": products_model,
    "PCA": lambda: whole_face(pca.make_network),
    "PCA beside a line": lambda: whole_face(CoefficientsBesideLine),
    "driven": driven_model,
    "regional": lambda: posed_face().model,
    "regional, all shapes in 16 bits": lambda: regional_model((7, 7)),  # as of regions of few shapes
    "regional, a region's shapes in 16 bits": lambda: regional_model((7, 2)),
    "regional, all shapes in 8 bits": lambda: regional_model((0, 0)),
}
