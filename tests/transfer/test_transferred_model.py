"""A model on another mesh: the same offsets at the same places, what maps say between them, shifted charts."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from small_face import M, pose_offsets, small_influence, small_mesh

from replicate.approximation import cnn
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel, square_segments
from replicate.approximation.segments import coarse_segments
from replicate.base.exceptions import InputError
from replicate.config import CoarseConfig, RefinementConfig
from replicate.geometry.mesh import Mesh
from replicate.transfer.remeshing import on_original, remeshed, within_segments
from replicate.transfer.surface_places import nearest_places
from replicate.transfer.transferred_model import read_at, shifted, square_of, transferred, turned

PARAMS = np.random.default_rng(1).uniform(-1, 1, (5, M)).astype(np.float32)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return small_mesh()


@pytest.fixture(scope="module")
def coarse(mesh) -> SegmentedModel:
    """Networks of drawn weights for the face and the neck, not the tooth."""
    return random_model(coarse_segments(mesh, {2}, small_influence(mesh)), mesh, CoarseConfig(map_size=16))


@pytest.fixture(scope="module")
def refined(mesh, coarse) -> RefinedModel:
    """The same, with maps over three squares of the face, two of which overlap."""
    centres = np.array([[0.3, 0.3], [0.42, 0.36], [0.75, 0.8]])
    squares = square_segments(coarse.segments[0], centres, small_influence(mesh), 0.4)
    assert len(squares) == 3
    return RefinedModel(coarse, random_model(squares, mesh, RefinementConfig(map_size=32)))


def random_model(segments, mesh, config) -> SegmentedModel:
    torch.manual_seed(len(segments))
    networks = [cnn.make_network(segment, cnn.shape_facts(config)) for segment in segments]
    lengths = [1.0 + k for k in range(len(segments))]
    return SegmentedModel(networks, segments, np.linspace(0.5, 2, M), lengths, len(mesh.neutral))


def part_of(mesh: Mesh, segments: tuple[int, ...]) -> tuple[Mesh, np.ndarray]:
    """Return some segments of a mesh as a mesh of their own, and its vertices' numbers in the whole."""
    own = np.flatnonzero(np.isin(mesh.segment, segments))
    place = np.full(len(mesh.neutral), -1)
    place[own] = np.arange(len(own))
    faces = place[mesh.faces]
    index = np.searchsorted(segments, mesh.segment[own])
    names = tuple(mesh.segment_names[k] for k in segments)
    return Mesh(mesh.neutral[own], faces[(faces >= 0).all(1)], mesh.uv[own], index, names), own


@pytest.mark.parametrize("segments", [(0, 1), (0,), (1,)])
@pytest.mark.parametrize("name", ["coarse", "refined"])
def test_the_original_mesh_gets_the_models_own_offsets(mesh, name, segments, request):
    model, (part, own) = request.getfixturevalue(name), part_of(mesh, segments)
    offsets = transferred(model, part).offsets(PARAMS)
    assert offsets.shape == (5, len(own), 3) and np.abs(offsets).max() > 1e-3
    np.testing.assert_array_equal(offsets, model.offsets(PARAMS)[:, own])


def test_vertices_in_another_order_get_theirs(mesh, refined):
    part, own = part_of(mesh, (0, 1))
    order = np.random.default_rng(4).permutation(len(own))
    other = Mesh(part.neutral[order], np.argsort(order)[part.faces], part.uv[order], part.segment[order],
                 part.segment_names)  # fmt: skip
    offsets = transferred(refined, other).offsets(PARAMS)
    np.testing.assert_allclose(offsets, refined.offsets(PARAMS)[:, own[order]], atol=1e-6)


def test_a_new_vertex_reads_what_the_map_says_at_its_coordinates(mesh, coarse):
    new = remeshed(mesh, (0, 1), 0.5).mesh
    assert new.segment_names == ("face", "neck") and len(new.neutral) < 0.7 * np.isin(mesh.segment, (0, 1)).sum()
    offsets = transferred(coarse, new).offsets(PARAMS)
    with torch.no_grad():
        scaled = (
            torch.from_numpy(PARAMS[:, coarse.segments[1].parameters]) / coarse.scale[coarse.segments[1].parameters]
        )
        maps = coarse.networks[1].maps(scaled).numpy() * coarse.lengths[1]
    for vertex in np.flatnonzero(new.segment == 1)[:6]:
        column, row = new.uv[vertex] * 15
        c, r = int(min(column, 14)), int(min(row, 14))
        a, b = column - c, row - r
        upper = (1 - a) * maps[:, r, c] + a * maps[:, r, c + 1]
        lower = (1 - a) * maps[:, r + 1, c] + a * maps[:, r + 1, c + 1]
        np.testing.assert_allclose(offsets[:, vertex], (1 - b) * upper + b * lower, atol=1e-5)


def test_a_place_belongs_to_the_square_of_its_nearest_vertex_and_to_none_outside(coarse, refined):
    chart, squares = coarse.segments[0], refined.residual.segments
    own = square_of(chart, squares, chart.uv)
    for number, square in enumerate(squares):
        assert chart.vertices[own == number].tolist() == square.vertices.tolist()
    some = chart.uv[own == 2]
    outside = np.float32([some.max(0) + 0.01, some.min(0) - 0.01, [0.0, 1.0], some.mean(0)])
    assert square_of(chart, squares, outside).tolist() == [-1, -1, -1, 2]


def test_a_model_whose_squares_hold_no_new_vertex_is_the_coarse_one_there(mesh, coarse, refined):
    part, own = part_of(mesh, (1,))
    np.testing.assert_array_equal(transferred(refined, part).offsets(PARAMS), coarse.offsets(PARAMS)[:, own])


def test_the_model_itself_stays_as_it_was(mesh, coarse):
    before = coarse.offsets(PARAMS)
    twin = read_at(coarse.networks[0], np.float32([[0.5, 0.5]]))
    with torch.no_grad():
        twin.output.bias += 1
    np.testing.assert_array_equal(coarse.offsets(PARAMS), before)


def test_a_segment_without_a_map_and_a_model_without_maps_are_refused(mesh, coarse):
    with pytest.raises(InputError, match="no map of segment 'tooth'; it has maps of face, neck"):
        transferred(coarse, mesh)
    with pytest.raises(InputError, match="expected a coarse or a refined one, which has maps, got a dict"):
        transferred({}, mesh)


def test_every_new_vertex_lies_on_the_triangle_that_it_is_carried_by(mesh):
    new = remeshed(mesh, (0, 1), 0.25)
    np.testing.assert_array_equal(new.places.mix(mesh.neutral), new.mesh.neutral)
    np.testing.assert_allclose(new.places.mix(mesh.uv), new.mesh.uv, atol=1e-6)
    assert (mesh.segment[new.places.corners] == new.mesh.segment[:, None]).all()
    assert (new.places.shares >= 0).all() and (new.places.shares.max(1) < 0.99).mean() > 0.3, "many are new places"
    truth = new.places.mix(mesh.neutral + pose_offsets(mesh, PARAMS))
    assert np.abs(truth - new.mesh.neutral).max() > 1


def test_the_pose_that_is_decimated_says_where_vertices_are_kept(mesh):
    """A bump that only the pose has keeps the vertices around it; the new mesh is the neutral pose's all the same."""
    bump = mesh.neutral + 0
    away = np.linalg.norm(mesh.uv - [0.7, 0.3], axis=1)
    bump[:, 2] += np.where(mesh.segment == 0, 12 * np.exp(-((away / 0.08) ** 2)), 0).astype(np.float32)
    near = []
    for shape in (mesh.neutral, bump):
        new = remeshed(mesh, (0, 1), 0.25, shape)
        np.testing.assert_array_equal(new.places.mix(mesh.neutral), new.mesh.neutral)
        own = new.mesh.uv[new.mesh.segment == 0]
        near.append((np.linalg.norm(own - [0.7, 0.3], axis=1) < 0.12).sum())
    assert near[1] > 1.5 * near[0]


def test_new_meshes_are_read_as_they_were_written(mesh, tmp_path):
    new = remeshed(mesh, (0,), 0.5)
    new.save(tmp_path / "half.npz")
    again = type(new).load(tmp_path / "half.npz")
    for name in ("neutral", "faces", "uv", "segment"):
        np.testing.assert_array_equal(getattr(again.mesh, name), getattr(new.mesh, name))
    np.testing.assert_array_equal(again.places.shares, new.places.shares)
    np.testing.assert_array_equal(again.places.corners, new.places.corners)


def test_vertices_of_no_triangle_and_triangles_without_area_are_left_out(mesh):
    part, own = part_of(mesh, (1,))
    vertices = np.concatenate([part.neutral, part.neutral[:1] + np.float32([0, 0, 9])])
    faces = np.concatenate([part.faces, np.int32([[0, 1, len(part.neutral)]])])  # it falls onto its own first corner
    new = on_original(
        mesh, faces, within_segments(vertices, nearest_places(vertices, mesh.neutral, own[part.faces]), mesh)
    )
    np.testing.assert_array_equal(new.mesh.faces, part.faces)
    np.testing.assert_allclose(new.mesh.neutral, part.neutral, atol=1e-5)


@pytest.mark.parametrize("share", [0.0, 1.0, -2.0])
def test_a_share_of_all_or_no_vertices_is_refused(mesh, share):
    with pytest.raises(InputError, match="expected a number above 0 and below 1"):
        remeshed(mesh, (0,), share)


def test_charts_are_shifted_as_far_as_is_asked_and_turned_about_their_middle(mesh):
    inner = replace(mesh, uv=0.25 + 0.5 * mesh.uv)
    moves = shifted(inner, 0.1, np.random.default_rng(0)).uv - inner.uv
    np.testing.assert_allclose(np.linalg.norm(moves, axis=1), 0.1, rtol=1e-4)
    assert len(np.unique(moves.round(4), axis=0)) == 3, "a direction a segment"
    around = turned(inner, 90.0, np.random.default_rng(0)).uv - 0.5
    sign = np.sign(around[1, 0] * (inner.uv[1, 1] - 0.5))
    expected = sign * (inner.uv - 0.5)[:, ::-1] * [1, -1]
    np.testing.assert_allclose(around[mesh.segment == 0], expected[mesh.segment == 0], atol=1e-6)
    far = shifted(mesh, 3.0, np.random.default_rng(0)).uv
    assert far.min() >= 0 and far.max() <= 1


def test_the_farther_a_chart_is_shifted_or_turned_the_larger_the_errors(mesh, coarse):
    new = remeshed(mesh, (0, 1), 0.5).mesh
    exact = transferred(coarse, new).offsets(PARAMS)

    def error(other):
        return np.linalg.norm(transferred(coarse, other).offsets(PARAMS) - exact, axis=-1).mean()

    shifts = [error(shifted(new, pixels / 15, np.random.default_rng(0))) for pixels in (0.0, 0.5, 1.0, 2.0)]
    turns = [error(turned(new, degrees, np.random.default_rng(0))) for degrees in (0.0, 1.0, 5.0)]
    for errors in (shifts, turns):
        assert errors[0] < 1e-6 and all(b > 1.3 * a for a, b in pairwise(errors[1:]))
