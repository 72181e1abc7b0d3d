"""The pieces of the regional model: bases in the metric of the loss, rounding on the mesh, the gated network."""

import numpy as np
import pytest
import torch
from posed_face import regional_model
from small_face import small_mesh

from replicate.regional import model
from replicate.regional.basis import (
    apply_metric,
    blend_weights,
    loss_metric,
    principal_basis,
    projection,
    split_regions,
)
from replicate.regional.networks import GatedNetwork
from replicate.targets.trained_models import with_fewer_shapes

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
    stored = model.store(basis, 2)
    numbers = basis.components[0].size
    assert stored.size_bytes() == 2 * 2 * numbers + 4 * numbers + 2 * numbers + 4 * 6
    error = np.abs(stored.components().numpy().reshape(basis.components.shape) - basis.components).max(axis=(1, 2))
    largest = np.abs(basis.components).max(axis=(1, 2))
    assert (error[:2] <= 0.51 * largest[:2] / 32767).all() and (error[2:] <= 0.51 * largest[2:] / 127).all()
    assert (error[2:] > 0.3 * largest[2:] / 127).all()


def test_a_weight_fades_over_the_rings_about_a_border_and_all_of_a_vertex_are_one():
    columns, rows = 12, 3
    corners = np.arange(columns * rows).reshape(rows, columns)
    quads = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    left, right = corners[:, :6].ravel(), corners[:, 6:].ravel()
    for rings, fading in ((0, []), (1, [0.75, 0.25]), (2, [0.875, 0.625, 0.375, 0.125])):
        (vertices, weights), other = blend_weights([left, right], faces, columns * rows + 2, rings)
        assert vertices[: len(left)].tolist() == left.tolist()
        share = np.zeros((2, columns * rows))
        share[0, vertices], share[1, other[0]] = weights, other[1]
        np.testing.assert_allclose(share.sum(0), 1)
        middle = share[0].reshape(rows, columns)[1]
        np.testing.assert_allclose(middle, [1] * (6 - rings) + fading + [0] * (6 - rings), err_msg=str(rings))


def test_regions_that_meet_in_a_corner_share_its_vertices_and_a_still_vertex_is_in_none():
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [4, 5, 0]])
    found = blend_weights([np.array([0, 1]), np.array([2]), np.array([3])], faces, 6, 1)
    assert [vertices.tolist() for vertices, _ in found] == [[0, 1, 2, 3], [2, 0, 1, 3], [3, 0, 2]]
    share = np.zeros(6)
    for vertices, weights in found:
        share[vertices] += weights
    np.testing.assert_allclose(share, [1, 1, 1, 1, 0, 0])
    np.testing.assert_allclose([weights[list(v).index(0)] for v, weights in found], [0.6, 0.2, 0.2])


def test_beyond_its_region_a_basis_goes_on_as_the_mesh_does_whatever_the_bits_hold():
    vertices, faces, x, offsets = patch()
    own, beyond = vertices[:-9], vertices[-9:]
    offsets = np.concatenate([offsets[:, :-9], 5 * offsets[:, -9:]], axis=1)  # more than the bits of the region hold
    metric = loss_metric(x[:-9], faces[(faces < len(own)).all(1)], len(x), len(faces), 5.0)
    basis = principal_basis(own, offsets[:, :-9], metric, 6)
    coefficients = (offsets[:, :-9] - basis.mean).reshape(len(offsets), -1) @ projection(basis, metric)
    order, weights = np.concatenate([own, beyond]), np.linspace(0.1, 1, len(vertices))
    stored = model.blended(model.store(basis, 6), order, weights, coefficients, offsets[:, -9:])
    assert stored.vertices.tolist() == order.tolist() and stored.fine.shape[1] == len(vertices)
    given = (coefficients @ stored.components().numpy()).reshape(offsets.shape) + stored.means().numpy()
    np.testing.assert_allclose(given, weights[:, None] * offsets, atol=2e-3 * np.abs(offsets).max())
    assert int(stored.fine[:, len(own) :].abs().max()) == 32767 and float(stored.weights.max()) > 1


def test_a_vertex_of_several_regions_is_the_sum_of_its_rows():
    members = [np.array([7, 3, 5]), np.array([3, 9]), np.array([9, 3, 1])]
    vertices, layers = model.coverings(members)
    assert [len(layer) for layer in layers] == [5, 2, 1] and vertices[:2].tolist() == [3, 9]
    rows, values = np.concatenate(members), GENERATOR.normal(size=8)
    found = np.zeros(5)
    for layer in layers:
        np.testing.assert_array_equal(rows[layer], vertices[: len(layer)])
        found[: len(layer)] += values[layer]
    np.testing.assert_allclose(found, [values[rows == vertex].sum() for vertex in vertices])
    alone, layers = model.coverings([np.array([4, 2]), np.array([9, 0])])
    assert alone.tolist() == [4, 2, 9, 0] and layers[0].tolist() == [0, 1, 2, 3], "nothing is moved about"


def test_a_fresh_network_is_its_line_but_for_a_little():
    network = GatedNetwork(5, (16, 16), 7)
    line = GENERATOR.normal(size=(6, 7))
    network.start(line, torch.Generator().manual_seed(0))
    params = GENERATOR.uniform(-1, 1, (9, 5))
    straight = params @ line[:-1] + line[-1]
    given = network(torch.from_numpy(params).float()).detach().numpy()
    assert 0 < np.abs(given - straight).max() < 0.05
    assert network.multiplications() == 5 * 32 + 16 * 32 + 16 * 7 + 5 * 7


def started(**fields):
    """Return a network, samples that set its bounds, and its line."""
    network, line = GatedNetwork(5, (16, 16), 7, **fields), GENERATOR.normal(size=(6, 7))
    network.start(line, torch.Generator().manual_seed(0))
    seen = GENERATOR.uniform(-0.6, 0.9, (30, 5))
    network.bound(seen)
    return network, seen, line


def test_beyond_what_training_saw_the_line_goes_on_alone():
    network, seen, line = started()
    edge = np.where(GENERATOR.random((4, 5)) < 0.5, seen.min(0), seen.max(0)).astype(np.float16).astype(np.float32)
    far = edge * GENERATOR.uniform(1, 9, (4, 5)).astype(np.float32)
    at_edge, beyond = (network(torch.from_numpy(params)).detach().numpy() for params in (edge, far))
    np.testing.assert_allclose(beyond - at_edge, (far - edge) @ line[:-1], atol=1e-4)
    inside = torch.from_numpy(seen[:2]).float()
    with torch.no_grad():
        network.highest.fill_(100)
        before, _ = network(inside), network.highest.copy_(torch.from_numpy(seen.max(0)))
        np.testing.assert_allclose(network(inside).numpy(), before.numpy(), atol=1e-6)


@pytest.mark.parametrize("gated", [True, False])
def test_layers_give_no_more_than_they_gave_in_training_where_many_parameters_are_large_at_once(gated):
    network, seen, _ = started(gated=gated)
    with torch.no_grad():
        for layer in network.layers:
            layer.weight.mul_(5)
        inside, corners = torch.from_numpy(seen).float(), torch.from_numpy(np.sign(GENERATOR.normal(size=(40, 5))))
        corners = torch.where(corners > 0, network.highest, network.lowest)
        before, wild = network(inside), network(corners)
        network.limit(seen)
        np.testing.assert_allclose(network(inside), before, atol=2e-2 * float(before.abs().max()))
        tops = []
        network.layers[1].register_forward_pre_hook(lambda _, given: tops.append(given[0].amax(dim=0)))
        tame = network(corners)
    assert (tops[0] <= network.most_0).all() and network.most_0.isfinite().all()
    assert (tame - wild).abs().max() > 1e-2, "without limits they give more"
    assert network.is_limited and network.state_dict()["least_1"].isfinite().all()


def test_without_products_and_line_it_is_a_perceptron_of_the_same_widths():
    network = GatedNetwork(5, (16, 16), 7, gated=False, line=False)
    network.start(np.zeros((6, 7)), torch.Generator().manual_seed(0))
    assert network.multiplications() == 5 * 16 + 16 * 16 + 16 * 7
    assert network(torch.zeros(2, 5)).shape == (2, 7)


def test_the_loss_is_the_sum_of_the_regions_lengths():
    error = torch.tensor([[3.0, 4.0, 0.0], [0.0, 0.0, 2.0]])
    membership = torch.tensor([[1.0, 0], [1, 0], [0, 1]])
    assert abs(float(model.regional_loss(error, membership)) - 3.5) < 1e-4


def test_at_rest_nothing_moves_whatever_means_a_file_has():
    free = regional_model(fine=(2, 5))
    rest = GENERATOR.uniform(-1, 1, len(free.scale)).astype(np.float32)
    params = (rest * free.scale.numpy())[None]
    assert np.abs(free.offsets(params)).max() > 0.01
    held = model.RegionalModel(free.network, free.bases, free.scale.numpy(), free.length, free.vertex_count, rest)
    assert np.abs(held.offsets(params)).max() < 1e-5


@pytest.mark.parametrize("count", [1, 4, 99])
def test_a_model_with_fewer_shapes_moves_as_if_the_others_were_flat(count):
    whole = regional_model(fine=(2, 5))
    params = GENERATOR.uniform(-1, 1, (5, len(whole.scale))).astype(np.float32)
    fewer = with_fewer_shapes(whole, count)
    assert [len(basis.steps) for basis in fewer.bases] == [min(count, len(basis.steps)) for basis in whole.bases]
    assert (fewer.size_mb() < whole.size_mb()) == (count < 7)
    for basis in whole.bases:
        basis.steps[count:] = 0
    flat = model.RegionalModel(whole.network, whole.bases, whole.scale.numpy(), whole.length, whole.vertex_count)
    np.testing.assert_allclose(fewer.offsets(params), flat.offsets(params), atol=1e-5)
