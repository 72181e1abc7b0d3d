"""The edge metric against sums over edges, and both steps of SSDR in it."""

from dataclasses import replace

import numpy as np
import pytest
from skinned_sheets import grid_faces, sheet, wrinkled_sheet

from replicate.baselines.skinning.alternation import Problem, dense, improve_weights, step
from replicate.baselines.skinning.compression import colour, compress, diffuse, edge_metric
from replicate.baselines.skinning.ssdr import fit
from replicate.baselines.skinning.starts import start


def edges_of(faces):
    return sorted({tuple(sorted((int(f[a]), int(f[b])))) for f in faces for a, b in ((0, 1), (1, 2), (2, 0))})


def test_the_metric_is_squared_distance_plus_squared_tilt_of_every_edge():
    neutral, _, faces = wrinkled_sheet()
    rest = neutral.astype(float)
    residual = np.random.default_rng(0).normal(size=rest.shape)
    squared_lengths = {e: ((rest[e[0]] - rest[e[1]]) ** 2).sum() for e in edges_of(faces)}
    h2 = np.median(list(squared_lengths.values()))
    tilt = sum(((residual[a] - residual[b]) ** 2).sum() * h2 / (q + h2 / 16) for (a, b), q in squared_lengths.items())
    for coherence in (0.0, 0.3):
        matrix = edge_metric(rest, faces, coherence).matrix
        energy = float((residual * (matrix @ residual)).sum())
        assert energy == pytest.approx((residual**2).sum() + coherence * tilt)


def test_no_two_vertices_of_a_colour_share_an_edge_and_every_vertex_has_one():
    neutral, _, faces = wrinkled_sheet()
    metric = edge_metric(neutral.astype(float), faces, 0.1)
    assert sorted(np.concatenate(metric.colours)) == list(range(len(neutral)))
    of = np.empty(len(neutral), int)
    for number, members in enumerate(metric.colours):
        of[members] = number
    assert all(of[a] != of[b] for a, b in edges_of(faces))
    assert len(colour(metric.edges)) <= 8


def test_a_mesh_without_faces_is_measured_by_distance_alone():
    metric = edge_metric(sheet(4).astype(float), np.zeros((0, 3), int), 0.5)
    np.testing.assert_array_equal(metric.matrix.toarray(), np.eye(16))
    np.testing.assert_allclose(diffuse(metric.edges, np.eye(16), 30.0), np.eye(16))


def test_diffusion_keeps_sums_and_spreads_along_edges_only():
    faces = np.concatenate([grid_faces(4), grid_faces(4) + 16])
    metric = edge_metric(np.concatenate([sheet(4), sheet(4)]).astype(float), faces, 0.1)
    labels = np.eye(2)[np.repeat([0, 1, 1], [5, 11, 16])]
    spread = diffuse(metric.edges, labels, 5.0)
    np.testing.assert_allclose(spread.sum(1), 1)
    np.testing.assert_allclose(spread[:16].sum(0), labels[:16].sum(0))
    np.testing.assert_allclose(spread[16:], labels[16:])
    assert 0.01 < spread[15, 0] < spread[0, 0] < 0.99


@pytest.mark.parametrize("coherence", [0.0, 0.1, 2.0])
def test_both_steps_lower_the_energy_of_the_metric(coherence):
    neutral, poses, faces = wrinkled_sheet()
    data = compress(neutral, poses, np.random.default_rng(0))
    metric = edge_metric(data.points[:, :3], faces, coherence)
    problem = Problem(data, metric)

    def energy(motion, index, weights):
        predicted = np.einsum("fkbp,np,nb->fkn", motion, data.points, dense(index, weights, 4))
        residual = predicted.reshape(-1, len(neutral)) - data.basis @ data.coefficients
        return float(np.sum(residual.T * (metric.matrix @ residual.T)))

    state = start(problem, 4, 3)
    before = energy(state.motion, state.bone_index, state.weights)
    for _ in range(6):
        index, weights, _ = improve_weights(problem, state.motion, state.bone_index, state.weights, False)
        half = energy(state.motion, index, weights)
        assert half <= before * (1 + 1e-9)
        after = step(problem, state)
        if after.motion is not state.motion:
            assert energy(after.motion, after.bone_index, after.weights) == pytest.approx(after.energy, rel=1e-6)
        assert after.energy <= state.energy
        state, before = after, energy(after.motion, after.bone_index, after.weights)
    assert before < 0.9 * energy(*(lambda s: (s.motion, s.bone_index, s.weights))(start(problem, 4, 3)))


def test_coherence_trades_distance_for_less_tilt():
    neutral, poses, faces = wrinkled_sheet()
    data = compress(neutral, poses, np.random.default_rng(0))
    plain, coherent = (edge_metric(data.points[:, :3], faces, c) for c in (0.0, 1.0))
    state = start(
        Problem(data, plain), 4, 4
    )  # as many influences as bones: the weight problem is convex, its minima are global
    parts = []
    for metric in (plain, coherent):
        index, weights = state.bone_index, state.weights
        for _ in range(30):
            index, weights, _ = improve_weights(Problem(data, metric), state.motion, index, weights, False)
        predicted = np.einsum("fkbp,np,nb->fkn", state.motion, data.points, dense(index, weights, 4))
        residual = (predicted.reshape(-1, len(neutral)) - data.basis @ data.coefficients).T
        distance = np.sum(residual**2)
        parts.append((distance, np.sum(residual * (coherent.matrix @ residual)) - distance))
    assert parts[0][0] < parts[1][0]
    assert parts[1][1] < 0.995 * parts[0][1]
    assert sum(parts[1]) < sum(parts[0])


def test_the_order_of_faces_does_not_matter():
    neutral, poses, faces = wrinkled_sheet()
    rng = np.random.default_rng(0)
    vertex = rng.permutation(len(neutral))
    back = np.argsort(vertex).astype(np.int32)
    plain = fit(neutral, poses, 4, np.random.default_rng(0), iterations=5, faces=faces)
    mixed = fit(
        neutral[vertex], poses[:, vertex], 4, np.random.default_rng(0), iterations=5, faces=back[rng.permutation(faces)]
    )
    np.testing.assert_array_equal(mixed.weights, plain.weights[vertex])


def test_an_extrapolation_that_does_harm_is_taken_back():
    neutral, poses, faces = wrinkled_sheet()
    data = compress(neutral, poses, np.random.default_rng(0))
    problem = Problem(data, edge_metric(data.points[:, :3], faces, 0.1))
    state = start(problem, 4, 3)
    for _ in range(3):
        state = step(problem, state)
    far = state.motion + 3 * np.random.default_rng(1).normal(size=state.motion.shape)
    after = step(problem, replace(state, before=far, beta=0.9))
    assert after.beta == 0 and after.energy == state.energy and after.iteration == state.iteration + 1
    np.testing.assert_array_equal(after.motion, state.motion)
    np.testing.assert_array_equal(after.weights, state.weights)
