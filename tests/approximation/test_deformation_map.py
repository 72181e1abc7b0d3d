"""Maps against closed forms: affine functions, hand-made pixels, and what fits exactly."""

import numpy as np
import pytest
import torch
from small_face import pose_offsets, small_influence, small_mesh

from replicate.approximation.deformation_map import Floor, bilinear, polyharmonic_map, sample, sampling_matrix
from replicate.approximation.segments import coarse_segments

PLACES = np.random.default_rng(0).uniform(0, 1, (50, 2)).astype(np.float32)
CORNERS = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 1.0]], np.float32)


def affine_map(size):
    v, u = np.meshgrid(np.linspace(0, 1, size), np.linspace(0, 1, size), indexing="ij")
    return torch.tensor(np.stack([2 * u - 3 * v + 1, v, u], axis=-1)[None], dtype=torch.float32)


@pytest.mark.parametrize("size", [8, 32])
def test_an_affine_map_is_read_exactly_everywhere(size):
    uv = np.concatenate([PLACES, CORNERS])
    grid = bilinear(uv, size)
    values = sample(affine_map(size), torch.from_numpy(grid.pixels), torch.from_numpy(grid.weights))[0]
    expected = np.stack([2 * uv[:, 0] - 3 * uv[:, 1] + 1, uv[:, 1], uv[:, 0]], axis=1)
    np.testing.assert_allclose(values, expected, atol=1e-6)


def test_a_vertex_between_four_pixels_reads_their_weighted_mean():
    grid = bilinear(np.array([[0.25 / 7, 1.5 / 7]], np.float32), 8)  # column 0.25, row 1.5
    pixels = torch.zeros(1, 8, 8, 1)
    pixels[0, 1, 0], pixels[0, 1, 1], pixels[0, 2, 0], pixels[0, 2, 1] = 1, 10, 100, 1000
    sample_value = sample(pixels, torch.from_numpy(grid.pixels), torch.from_numpy(grid.weights))
    assert sample_value.item() == pytest.approx(0.375 * 1 + 0.125 * 10 + 0.375 * 100 + 0.125 * 1000)


def test_polyharmonic_interpolation_passes_through_affine_data_and_averages_coincident_vertices():
    values = PLACES @ np.array([[2.0, 0], [-3, 1]]) + [1, 0]
    pixels = polyharmonic_map(PLACES, values, 8)
    np.testing.assert_allclose(pixels[2, 5], [2 * 5 / 7 - 3 * 2 / 7 + 1, 2 / 7], atol=1e-8)
    places = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [1, 1]], np.float32)
    pixels = polyharmonic_map(places, np.array([[0.0], [1], [1], [2], [4]]), 8)
    assert pixels[7, 7, 0] == pytest.approx(3)
    assert pixels[0, 7, 0] == pytest.approx(1)


def test_polyharmonic_interpolation_of_one_bump_is_the_spline_through_it():
    x = np.linspace(0, 1, 5)
    places = np.stack(np.meshgrid(x, x), -1).reshape(-1, 2)
    values = np.zeros((25, 1))
    values[12] = 1
    pixels = polyharmonic_map(places, values, 5)[:, :, 0]
    np.testing.assert_allclose(pixels.ravel(), values[:, 0], atol=1e-8)
    halfway = polyharmonic_map(places, values, 9)[4, 3, 0]
    assert 0.3 < halfway < 0.9


def test_what_a_map_can_hold_has_no_floor_and_sharp_detail_has_one():
    mesh = small_mesh()
    segments = coarse_segments(mesh, {2}, small_influence(mesh))
    smooth = np.stack([mesh.uv[:, 0], mesh.uv[:, 1], 1 - mesh.uv[:, 0]], axis=1)[None] * (mesh.segment < 2)[:, None]
    floor = Floor(segments, 8)(smooth.astype(np.float32))
    np.testing.assert_allclose(floor, smooth, atol=1e-4)
    params = np.eye(12, dtype=np.float32)[:2]
    truth = pose_offsets(mesh, params)
    eight, sixteen = (Floor(segments, size)(truth) for size in (8, 16))
    assert np.abs(eight - truth)[0].max() > 0.2  # parameter 0 wrinkles vertices closer than a pixel of 8×8
    assert np.abs(sixteen - truth).max() < 1e-2  # 16×16 vertices at 16×16 pixels
    refined = Floor(segments, 8, segments[:1], 16)(truth)
    assert np.abs(refined - truth)[:, mesh.segment == 0].max() < 1e-2
    np.testing.assert_array_equal(refined[:, mesh.segment == 1], eight[:, mesh.segment == 1])


def test_the_projection_is_the_least_squares_solution():
    mesh = small_mesh()
    segments = coarse_segments(mesh, {2}, small_influence(mesh))
    truth = pose_offsets(mesh, np.ones((1, 12), np.float32))
    face = segments[0]
    matrix = sampling_matrix(bilinear(face.uv, 8)).toarray()
    best = matrix @ np.linalg.lstsq(matrix, truth[0, face.vertices].astype(np.float64), rcond=None)[0]
    floor = Floor(segments, 8)(truth)
    np.testing.assert_allclose(floor[0, face.vertices], best, atol=1e-4)
    assert not floor[:, mesh.segment == 2].any()
