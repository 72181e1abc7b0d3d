"""Where the refinement looks (Eq. 2, k-means, elbow, squares) and that its residual improves the coarse model."""

import numpy as np
import pytest
from small_face import pose_offsets, small_influence, small_mesh, small_samples, train_small

from replicate.approximation import cnn, refinement
from replicate.approximation.segments import coarse_segments
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.config import CoarseConfig, RefinementConfig, TrainingConfig


@pytest.fixture(scope="module")
def face():
    mesh = small_mesh()
    return mesh, coarse_segments(mesh, {2}, small_influence(mesh))


def test_map_error_is_the_mean_squared_loss_of_sharp_detail_only(face):
    mesh, segments = face
    params = np.zeros((4, 12), np.float32)
    params[0, 0] = 1  # one pose of four wrinkles
    errors = refinement.map_error(segments, pose_offsets(mesh, params), 8)
    assert np.linalg.norm(mesh.uv[errors.argmax()] - [0.3, 0.7]) < 0.1
    assert 0.02 < errors.max() < 1
    assert not errors[mesh.segment != 0].any()
    twice = refinement.map_error(segments, 2 * pose_offsets(mesh, params), 8)
    np.testing.assert_allclose(twice, 4 * errors, rtol=1e-6)
    again = refinement.map_error(segments, pose_offsets(mesh, np.tile(params, (3, 1))), 8)
    np.testing.assert_allclose(again, errors, rtol=1e-5, atol=1e-9)  # a mean over poses


def test_an_affine_deformation_has_no_map_error(face):
    mesh, segments = face
    affine = np.stack([mesh.uv[:, 0], mesh.uv[:, 1] * 2, mesh.uv.sum(1)], axis=1)[None]
    assert refinement.map_error(segments, affine, 8).max() < 1e-12


def test_the_elbow_is_where_the_curve_stops_to_fall_faster_than_that_of_an_even_error():
    inertia, even = [0.9, 0.5, 0.12, 0.10, 0.085, 0.075, 0.067], [0.8, 0.6, 0.45, 0.36, 0.29, 0.24, 0.2]
    assert refinement.elbow(inertia, even) == 3
    for most in (3, 4, 5, 6):  # wherever the curves are cut off
        assert refinement.elbow(inertia[:most], even[:most]) == 3
    assert refinement.elbow([0.5, 0.0], [0.7, 0.5]) == 2  # nothing is left


@pytest.mark.parametrize("most", (5, 8, 12))
def test_an_even_error_has_no_elbow_beyond_one_cluster_and_spots_have_theirs_for_any_limit(most):
    uv = np.random.default_rng(0).uniform(0, 1, (1500, 2))
    _, even = refinement.clusters([uv], [np.full(1500, 0.3)], most, seed=0)
    assert even.clusters == 1
    np.testing.assert_allclose(even.inertia, even.even)
    _, spots = refinement.clusters([uv], [three_spots(uv)[0]], most, seed=0)
    assert spots.clusters == 3


def three_spots(uv):
    spots = np.array([[0.15, 0.15], [0.8, 0.2], [0.4, 0.85]])
    return np.exp(-((uv[:, None] - spots) ** 2).sum(2) / 0.002).sum(1), spots


def test_three_spots_of_error_are_found_where_they_are():
    rng = np.random.default_rng(0)
    uv = rng.uniform(0, 1, (3000, 2))
    weight, spots = three_spots(uv)
    (centres, other), elbow = refinement.clusters([uv, uv], [weight, 0 * weight], 10, seed=0)
    assert elbow.clusters == 3 and len(other) == 0
    distance = np.linalg.norm(centres[:, None] - spots, axis=2)
    assert sorted(distance.argmin(1)) == [0, 1, 2] and distance.min(1).max() < 0.02
    assert all(a >= b for a, b in zip(elbow.inertia, elbow.inertia[1:], strict=False))


def test_segments_are_disjoint_squares_that_fill_their_maps(face):
    mesh, segments = face
    errors = np.where(mesh.segment == 0, three_spots(mesh.uv)[0], 0)
    squares, _ = refinement.select(segments, errors, small_influence(mesh), 0.25, 10)
    vertices = np.concatenate([segment.vertices for segment in squares])
    assert len(squares) >= 2 and len(set(vertices)) == len(vertices)
    assert (mesh.segment[vertices] == 0).all()
    centres, _ = refinement.clusters([mesh.uv[segments[0].vertices]], [errors[segments[0].vertices]], 10, 0)
    apart = np.abs(mesh.uv[segments[0].vertices][:, None] - centres[0]).max(2).min(1)
    np.testing.assert_array_equal(np.sort(vertices), segments[0].vertices[apart <= 0.125])  # all that lie in a square
    for segment in squares:
        assert np.ptp(mesh.uv[segment.vertices], axis=0).max() <= 0.25 + 1e-6
        np.testing.assert_allclose([segment.uv.min(0), segment.uv.max(0)], [[0, 0], [1, 1]])
        np.testing.assert_array_equal(segment.parameters, range(8))


def test_a_chart_with_few_places_gets_no_more_clusters_than_those(face):
    mesh, segments = face
    errors = np.zeros(len(mesh.neutral))
    errors[segments[0].vertices[:3]] = 1.0
    _, elbow = refinement.select(segments, errors, small_influence(mesh), 0.9, 10)
    assert len(elbow.inertia) == 3


def test_what_cannot_be_refined_is_said_in_one_sentence(face):
    mesh, segments = face
    with pytest.raises(InputError, match="nothing to refine"):
        refinement.select(segments, np.zeros(len(mesh.neutral)), small_influence(mesh), 0.25, 10)
    errors = np.ones(len(mesh.neutral))
    with pytest.raises(InputError, match=r"refinement\.square is 0\.01: no such square"):
        refinement.select(segments, errors, small_influence(mesh), 0.01, 10)


def test_refinement_lowers_both_errors_and_moves_only_its_vertices(face, tmp_path):
    mesh, segments = face
    samples = small_samples(mesh)
    training = TrainingConfig("one_cycle", steps=200, peak_rate=5e-3)
    config = CoarseConfig(map_size=16, training=training)
    _, coarse, before = train_small(cnn, config, tmp_path / "coarse")
    errors = refinement.map_error(segments, samples.offsets(np.arange(20)), 8)
    config = RefinementConfig(map_size=32, square=0.5, training=training)
    squares, _ = refinement.select(segments, errors, small_influence(mesh), config.square, config.clusters_max)
    refined, after = refinement.train_refined(mesh, coarse, squares, samples, config, tmp_path / "refined", progress, 0)
    assert after[-1]["mm"] < before[-1]["mm"] and after[-1]["degrees"] < before[-1]["degrees"]
    params = samples.validation_params
    vertices = np.flatnonzero(np.abs(refined.offsets(params) - coarse.offsets(params)).max((0, 2)))
    np.testing.assert_array_equal(vertices, np.sort(np.concatenate([segment.vertices for segment in squares])))
    cnn.save(refined.residual, tmp_path, config)
    copy = refinement.load_refined(tmp_path, coarse)
    np.testing.assert_array_equal(copy.offsets(params), refined.offsets(params))
