"""Surface operators: exact on planes, where gradients, areas and harmonic functions are known."""

import numpy as np
import scipy.sparse as sp
from plane import plane

from data_recipes.deformers.surface_operators import (
    adjacency,
    face_gradients,
    geodesic,
    harmonic,
    padded_neighbours,
    padded_rows,
    smooth_values,
    stiffness,
    submesh,
    vertex_areas,
    vertex_normals,
)


def test_hat_gradients_reproduce_a_linear_function():
    vertices, faces = plane()
    slope = np.array([0.7, -1.3, 0.0])
    gradients, area = face_gradients(vertices, faces)
    slopes = np.einsum("fkd,fk->fd", gradients, (vertices @ slope)[faces])
    np.testing.assert_allclose(slopes, np.tile(slope, (len(faces), 1)), atol=1e-12)
    np.testing.assert_allclose(area.sum(), 20.0)
    np.testing.assert_allclose(vertex_areas(vertices, faces).sum(), 20.0)


def test_the_stiffness_gives_the_dirichlet_energy_of_a_linear_function():
    vertices, faces = plane()
    f = vertices @ np.array([2.0, 1.0, 0.0])
    k = stiffness(vertices, faces)
    np.testing.assert_allclose(f @ (k @ f), 5.0 * 20.0)
    np.testing.assert_allclose(k @ np.ones(len(f)), 0, atol=1e-12)


def test_harmonic_values_on_a_strip_are_linear_between_their_ends():
    graph = adjacency(np.array([[i, i + 1, i + 2] for i in range(1)]), 3)
    chain = np.zeros((7, 7))
    for i in range(5):
        chain[i, i + 1] = chain[i + 1, i] = 1
    assert graph.nnz == 6
    values = harmonic(sp.csr_matrix(chain), np.array([0, 5]), np.array([0.0, 1.0]))
    np.testing.assert_allclose(values[:6], np.arange(6) / 5, atol=1e-6)
    assert values[6] == 0  # an island


def test_geodesics_add_up_edge_lengths_and_stop_at_their_limit():
    vertices, faces = plane(jitter=0.0)
    distance = geodesic(vertices, adjacency(faces, len(vertices)), np.array([0]), limit_mm=3.0)
    assert distance[2] == 2.0
    assert np.isinf(distance[-1])


def test_padded_neighbours_average_and_pad_with_the_vertex_itself():
    _, faces = plane()
    graph = adjacency(faces, 30)
    index, weight = padded_neighbours(graph, 8)
    values = np.random.default_rng(0).normal(size=30)
    np.testing.assert_allclose(
        (values[index] * weight).sum(1), graph @ values / np.asarray(graph.sum(1)).ravel(), rtol=1e-5
    )
    assert (index[0][weight[0] == 0] == 0).all()


def test_smoothing_keeps_constants_and_what_is_held():
    _, faces = plane()
    graph = adjacency(faces, 30)
    np.testing.assert_allclose(smooth_values(np.full(30, 2.0), graph, 4), 2.0)
    values = np.zeros(30)
    values[12] = 1
    anchors = np.zeros(30, bool)
    anchors[12] = True
    assert smooth_values(values, graph, 4)[12] < 1
    assert smooth_values(values, graph, 4, anchors)[12] == 1


def test_submesh_renumbers_the_faces_inside():
    _, faces = plane()
    local, inside = submesh(faces, np.array([0, 1, 6, 5]), 30)
    assert len(local) == 2
    np.testing.assert_array_equal(np.array([0, 1, 6, 5])[local], faces[inside])


def test_normals_of_a_plane_face_forward():
    vertices, faces = plane()
    np.testing.assert_allclose(vertex_normals(vertices, faces), np.tile([0, 0, 1.0], (30, 1)))


def test_padded_rows_are_the_matrix():
    generator = np.random.default_rng(2)
    matrix = generator.normal(size=(6, 9)) * (generator.uniform(size=(6, 9)) < 0.4)
    matrix[2] = 0
    padded = padded_rows(sp.csr_matrix(matrix))
    values = generator.normal(size=9)
    np.testing.assert_allclose((padded["weights"] * values[padded["slots"]]).sum(axis=0), matrix @ values, atol=1e-6)
    assert len(padded["slots"]) == (matrix != 0).sum(axis=1).max()
