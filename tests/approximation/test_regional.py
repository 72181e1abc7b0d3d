"""The pieces of the regional model: bases in the metric of the loss, rounding on the mesh, the gated network."""

import numpy as np
import torch
from small_face import small_mesh

from replicate.approximation import regional_model
from replicate.approximation.gated_network import GatedNetwork
from replicate.approximation.regional_basis import (
    apply_metric,
    loss_metric,
    principal_basis,
    projection,
    split_regions,
)

GENERATOR = np.random.default_rng(4)


def patch():
    """A segment of the stand-in mesh: its vertices, its faces in its own numbering, and some smooth offsets of it."""
    mesh = small_mesh()
    vertices = np.flatnonzero(mesh.segment == 0)
    place = np.full(len(mesh.neutral), -1)
    place[vertices] = np.arange(len(vertices))
    faces = place[mesh.faces]
    faces = faces[(faces >= 0).all(axis=1)]
    x = mesh.neutral[vertices]
    waves = np.sin(x @ GENERATOR.normal(size=(3, 6)) / np.ptp(x, axis=0).max() * 5)
    offsets = np.einsum("sc,kc,cd->skd", GENERATOR.normal(size=(40, 6)), waves, GENERATOR.normal(size=(6, 3)))
    return vertices, faces, x, offsets.astype(np.float32)


def test_regions_are_all_points_once_and_of_like_size():
    points = GENERATOR.normal(size=(103, 3)) * (5, 1, 1)
    regions = split_regions(points, 8)
    assert sorted(np.concatenate(regions).tolist()) == list(range(103))
    assert {len(region) for region in regions} <= {12, 13}
    widths = [np.ptp(points[region, 0]) for region in regions]
    assert max(widths) < 0.7 * np.ptp(points[:, 0])


def test_the_metric_is_the_positions_and_the_edges_of_the_loss():
    neutral = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]])
    metric = loss_metric(neutral, np.array([[0, 1, 2]]), 10, 4, 5.0)
    x = np.array([1.0, 0, 0])
    expected = 1 / 10 + 25 / 4 * (1 / 4 + 1 / 4)  # two edges of length 2 end at the first vertex
    np.testing.assert_allclose(x @ (metric @ x), expected)
    np.testing.assert_allclose(np.ones(3) @ (metric @ np.ones(3)), 3 / 10)  # a shift turns no normal


def test_components_are_orthonormal_in_the_metric_and_hold_what_has_their_rank():
    vertices, faces, x, offsets = patch()
    metric = loss_metric(x, faces, len(x), len(faces), 5.0)
    basis = principal_basis(vertices, offsets, metric, 12)
    assert len(basis.components) == 6
    flat = basis.components.reshape(6, -1)
    products = flat @ apply_metric(metric, basis.components).reshape(6, -1).T
    np.testing.assert_allclose(products, np.eye(6), atol=1e-3)
    coefficients = (offsets - basis.mean).reshape(len(offsets), -1) @ projection(basis, metric)
    back = (coefficients @ flat).reshape(offsets.shape) + basis.mean
    np.testing.assert_allclose(back, offsets, atol=1e-3 * np.abs(offsets).max())


def test_a_projection_is_the_nearest_in_the_metric_whatever_the_components_lengths():
    vertices, faces, x, offsets = patch()
    metric = loss_metric(x, faces, len(x), len(faces), 5.0)
    basis = principal_basis(vertices, offsets, metric, 3)
    stretched = type(basis)(vertices, basis.mean, basis.components * np.float32([[[2]], [[0.1]], [[7]]]))
    onto = projection(stretched, metric)
    centred = (offsets - basis.mean).reshape(len(offsets), -1)
    left = centred - (centred @ onto) @ stretched.components.reshape(3, -1)
    weighed = apply_metric(metric, basis.components).reshape(3, -1)
    assert np.abs(left @ weighed.T).max() < 1e-3 * np.abs(centred @ weighed.T).max()


def test_a_stored_basis_is_within_half_a_step_and_takes_a_byte_or_two_a_number():
    vertices, faces, x, offsets = patch()
    metric = loss_metric(x, faces, len(x), len(faces), 5.0)
    basis = principal_basis(vertices, offsets, metric, 6)
    stored = regional_model.store(basis, 2)
    numbers = basis.components[0].size
    assert stored.size_bytes() == 2 * 2 * numbers + 4 * numbers + 2 * numbers + 4 * 6
    error = np.abs(stored.components().numpy().reshape(basis.components.shape) - basis.components).max(axis=(1, 2))
    largest = np.abs(basis.components).max(axis=(1, 2))
    assert (error[:2] <= 0.51 * largest[:2] / 32767).all() and (error[2:] <= 0.51 * largest[2:] / 127).all()
    assert (error[2:] > 0.3 * largest[2:] / 127).all()


def test_a_fresh_network_is_its_line_but_for_a_little():
    network = GatedNetwork(5, (16, 16), 7)
    line = GENERATOR.normal(size=(6, 7))
    network.start(line, torch.Generator().manual_seed(0))
    params = GENERATOR.uniform(-1, 1, (9, 5))
    straight = params @ line[:-1] + line[-1]
    given = network(torch.from_numpy(params).float()).detach().numpy()
    assert 0 < np.abs(given - straight).max() < 0.05
    assert network.multiplications() == 5 * 32 + 16 * 32 + 16 * 7 + 5 * 7


def test_beyond_what_training_saw_the_line_goes_on_alone():
    network = GatedNetwork(5, (16, 16), 7)
    line = GENERATOR.normal(size=(6, 7))
    network.start(line, torch.Generator().manual_seed(0))
    seen = GENERATOR.uniform(-0.6, 0.9, (30, 5))
    network.bound(seen)
    edge = np.where(GENERATOR.random((4, 5)) < 0.5, seen.min(0), seen.max(0)).astype(np.float16).astype(np.float32)
    far = edge * GENERATOR.uniform(1, 9, (4, 5)).astype(np.float32)
    at_edge, beyond = (network(torch.from_numpy(params)).detach().numpy() for params in (edge, far))
    np.testing.assert_allclose(beyond - at_edge, (far - edge) @ line[:-1], atol=1e-4)
    inside = torch.from_numpy(seen[:2]).float()
    with torch.no_grad():
        network.highest.fill_(100)
        before, _ = network(inside), network.highest.copy_(torch.from_numpy(seen.max(0)))
        np.testing.assert_allclose(network(inside).numpy(), before.numpy(), atol=1e-6)


def test_without_products_and_line_it_is_a_perceptron_of_the_same_widths():
    network = GatedNetwork(5, (16, 16), 7, gated=False, line=False)
    network.start(np.zeros((6, 7)), torch.Generator().manual_seed(0))
    assert network.multiplications() == 5 * 16 + 16 * 16 + 16 * 7
    assert network(torch.zeros(2, 5)).shape == (2, 7)


def test_the_loss_is_the_sum_of_the_regions_lengths():
    error = torch.tensor([[3.0, 4.0, 0.0], [0.0, 0.0, 2.0]])
    membership = torch.tensor([[1.0, 0], [1, 0], [0, 1]])
    assert abs(float(regional_model.regional_loss(error, membership)) - 3.5) < 1e-4
