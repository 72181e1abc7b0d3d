"""A stand-in character for the network tests: two grid charts and a stiff one, 12 parameters, bumps and a wrinkle."""

import zlib

import numpy as np

from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.samples import SampleSet
from replicate.approximation.segments import coarse_segments
from replicate.approximation.training import train_segments
from replicate.base.progress import progress
from replicate.geometry.mesh import Mesh

SIDES = (16, 9, 2)
M = 12


def small_mesh() -> Mesh:
    neutral, faces, uv, segment, first = [], [], [], [], 0
    for k, side in enumerate(SIDES):
        v, u = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side), indexing="ij")
        u, v = u.ravel(), v.ravel()
        neutral.append(np.stack([60 * u, 60 * v, 8 * np.cos(3 * u) + 80 * k], axis=1))
        a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel() + first
        faces += [np.stack([a, a + 1, a + side + 1], 1), np.stack([a, a + side + 1, a + side], 1)]
        uv.append(np.stack([u, v], axis=1))
        segment.append(np.full(side**2, k))
        first += side**2
    return Mesh(
        np.concatenate(neutral).astype(np.float32),
        np.concatenate(faces).astype(np.int32),
        np.concatenate(uv).astype(np.float32),
        np.concatenate(segment).astype(np.int32),
        ("face", "neck", "tooth"),
    )


def pose_offsets(mesh: Mesh, params: np.ndarray) -> np.ndarray:
    """Move the face by parameters 0–7, the neck by 6–9; 10 and 11 move nothing; 0 also wrinkles the face sharply."""
    params, rng = np.asarray(params), np.random.default_rng(5)
    offsets = np.zeros((len(params), len(mesh.neutral), 3))
    for j in range(10):
        centre, direction = rng.uniform(0.2, 0.8, 2), rng.normal(size=3) * 4
        bump = np.exp(-((mesh.uv - centre) ** 2).sum(1) / 0.05)
        bump *= ((mesh.segment == 0) & (j < 8)) | ((mesh.segment == 1) & (j >= 6))
        offsets += np.tanh(params[:, j])[:, None, None] * bump[:, None] * direction
    near = np.exp(-((mesh.uv - [0.3, 0.7]) ** 2).sum(1) / 0.01) * (mesh.segment == 0)
    ridge = near * np.cos(np.arange(len(near)) * np.pi)
    offsets[:, :, 2] += np.maximum(params[:, :1], 0) * ridge
    return offsets.astype(np.float32)


def small_influence(mesh: Mesh) -> np.ndarray:
    influence = np.zeros((len(mesh.neutral), M), bool)
    influence[mesh.segment == 0, :8] = True
    influence[mesh.segment == 1, 6:10] = True
    return influence


class SmallSamples(SampleSet):
    """Samples that are not quantised, and drawn without balance."""

    def draw_for_step(self, seed, stream, step, batch, draws="balanced"):
        return np.random.default_rng([seed, zlib.crc32(stream.encode()), step]).integers(len(self.params), size=batch)


def small_samples(mesh: Mesh, count: int = 200) -> SmallSamples:
    rng = np.random.default_rng(2)
    training, fresh = (rng.uniform(-1, 1, (n, M)).astype(np.float32) for n in (count, 24))
    return exact_samples(training, pose_offsets(mesh, training), fresh, pose_offsets(mesh, fresh))


def exact_samples(params, offsets, validation_params, validation_offsets) -> SmallSamples:
    steps, bins = np.ones(len(params), np.float32), np.zeros(len(params), np.int16)
    validation = (validation_params, validation_offsets)
    return SmallSamples(params, offsets, steps, bins, *validation, *validation, {})


def train_small(method, config, scratch, seed: int = 0, samples: SmallSamples | None = None):
    """Train a small model as `method`, the module cnn or dense, makes its networks; return (mesh, model, log)."""
    mesh = small_mesh()
    segments = coarse_segments(mesh, {2}, small_influence(mesh))
    networks = [method.make_network(segment, method.shape_facts(config)) for segment in segments]
    samples = samples or small_samples(mesh)
    scale = parameter_scale(samples.params)
    model, log = train_segments(mesh, segments, networks, samples, config, scratch, progress, "small", seed, scale)
    return mesh, model, log
