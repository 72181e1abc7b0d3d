"""Another face in the charts of the original's: alignment by landmarks, lips that stay apart, and offsets to scale."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from plain_rig import PlainRig
from small_face import M, pose_offsets, small_influence, small_mesh

from replicate.approximation import cnn
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel, square_segments
from replicate.approximation.segments import coarse_segments
from replicate.base.exceptions import InputError
from replicate.config import CoarseConfig, RefinementConfig
from replicate.geometry.mesh import Mesh
from replicate.transfer.landmark_alignment import (
    Marks,
    aligned,
    face_of,
    shared_marks,
    size_ratio,
    spline_through,
    upper_over_lower,
)
from replicate.transfer.new_mesh_poses import WAYS, SourcePoses, ways_onto

SMALL = small_mesh()
SPREAD = np.array([0, 7, 15, 34, 60, 100, 118, 150, 199, 240, 247, 255])  # of the face's 256 vertices
TWICE = replace(SMALL, neutral=2 * SMALL.neutral)
SPREAD_MARKS = Marks(tuple(map(str, SPREAD)), SPREAD, SPREAD)


def lips(side: int) -> Mesh:
    """A square of 40 mm with a slit of 1 mm along y = 0, which a triangle at each end bridges; `side` points a row.

    Triangles of the upper half come first; the two charts are the left and the right half.
    """
    rows = np.concatenate([np.linspace(0.5, 20, side), -np.linspace(0.5, 20, side)])
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-20, 20, side), rows))
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    upper = np.concatenate([np.stack([a, a + 1, a + side + 1], 1), np.stack([a, a + side + 1, a + side], 1)])
    lower = upper[:, ::-1] + side**2
    bridges = [[0, side**2, side**2 + 1], [side - 1, side**2 + side - 2, side**2 + side - 1]]
    faces = np.concatenate([upper, lower, bridges])
    neutral = np.stack([x, y, 30 - (x**2 + y**2) / 40], axis=1)
    uv = np.stack([x / 40 + 0.5, y / 40 + 0.5], axis=1)
    return Mesh(neutral, faces, uv, (x > 0).astype(np.int32), ("face_1", "face_2"))


def marks_on(mesh: Mesh) -> dict[str, int]:
    side = round((len(mesh.neutral) / 2) ** 0.5)
    middle, half = side // 2, side**2
    corners = {"a": side * (side - 1), "b": half - 1, "c": half + side * (side - 1), "d": 2 * half - 1, "e": 0}
    return corners | {"f": side - 1, "lip_upper": middle, "lip_lower": half + middle}


def marks_of(source: Mesh, target: Mesh) -> Marks:
    ours, theirs = marks_on(source), marks_on(target)
    return Marks(tuple(ours), np.array(list(ours.values())), np.array(list(theirs.values())))


def test_the_spline_takes_landmarks_to_landmarks_and_bends_nothing_that_is_affine():
    rng = np.random.default_rng(0)
    source, target, points = rng.normal(size=(20, 3)), rng.normal(size=(20, 3)), rng.normal(size=(5, 3))
    np.testing.assert_allclose(spline_through(source, target)(source), target, atol=1e-9)
    matrix, shift = rng.normal(size=(3, 3)), rng.normal(size=3)
    bend = spline_through(source, source @ matrix + shift)
    np.testing.assert_allclose(bend(points), points @ matrix + shift, atol=1e-8)
    assert size_ratio(source, 1.25 * source + shift) == pytest.approx(1.25)


def test_a_finer_and_larger_face_has_the_charts_of_the_same_places():
    source, finer = lips(11), lips(21)
    larger = replace(finer, neutral=1.5 * finer.neutral + np.float32([0, 100, 0]))
    face = aligned(source, larger, marks_of(source, larger))
    np.testing.assert_array_equal(face.new.mesh.neutral, larger.neutral[face.vertices])
    assert face.scale == pytest.approx(1.5) and len(face.vertices) == len(larger.neutral)
    assert face.new.mesh.segment_names == ("face_1", "face_2") and len(face.counterpart) == len(face.new.mesh.faces)
    inside = (np.abs(finer.neutral[:, 0] - 2) > 2.1)[face.vertices]  # but for the row of triangles between the charts
    np.testing.assert_allclose(face.new.mesh.uv[inside], finer.uv[face.vertices][inside], atol=0.02)


def test_what_lies_beside_the_seam_stays_on_its_own_lip():
    source, finer = lips(11), lips(21)
    lower_is = finer.neutral[:, 1] < 0
    lower_is[len(lower_is) // 2 :] = True
    moved = finer.neutral + np.where(lower_is, 1.2, -1.2)[:, None] * np.float32([0, 1, 0])  # each onto the other lip
    moved[list(marks_on(finer).values())] = finer.neutral[list(marks_on(finer).values())]
    target = replace(finer, neutral=moved.astype(np.float32))
    face = aligned(source, target, marks_of(source, target))
    corners = face.new.places.corners
    on_lower = (corners >= len(source.neutral) // 2).all(1)
    middle = np.abs(target.neutral[face.vertices, 0]) < 10
    np.testing.assert_array_equal(on_lower[middle], lower_is[face.vertices][middle])


def test_ways_over_the_skin_go_round_a_slit():
    mesh = lips(11)
    apart = upper_over_lower(mesh.neutral, face_of(mesh), marks_on(mesh))
    upper, lower = (marks_on(mesh)[f"lip_{side}"] for side in ("upper", "lower"))
    assert apart[upper] > 35 and apart[lower] < -35
    np.testing.assert_array_equal(upper_over_lower(mesh.neutral, face_of(mesh), {"chin": 3}), 0)


def drawn_model(segments, config) -> SegmentedModel:
    """Return networks of drawn weights."""
    networks = [cnn.make_network(segment, cnn.shape_facts(config)) for segment in segments]
    return SegmentedModel(networks, segments, np.ones(M), [60.0] * len(segments), len(SMALL.neutral))


def test_every_way_moves_a_face_of_twice_the_size_twice_as_far():
    torch.manual_seed(0)
    segments = coarse_segments(SMALL, {2}, small_influence(SMALL))
    model = drawn_model(segments, CoarseConfig(map_size=16))
    squares = square_segments(segments[0], np.array([[0.3, 0.7]]), small_influence(SMALL), 0.4)
    refined = RefinedModel(model, drawn_model(squares, RefinementConfig(map_size=32)))
    params = np.random.default_rng(0).uniform(-1, 1, (3, M)).astype(np.float32)
    poses = SourcePoses(params, SMALL.neutral + pose_offsets(SMALL, params), SMALL.neutral + model.offsets(params))
    face = aligned(SMALL, TWICE, SPREAD_MARKS)
    ways = ways_onto(SMALL, face, model, refined)
    assert set(ways) == set(WAYS) and face.scale == pytest.approx(2)
    for name, followed in (("deformation_transfer", poses.truth), ("coarse", poses.predicted)):
        np.testing.assert_allclose(ways[name](poses), 2 * followed[:, face.vertices], atol=2e-3)
    np.testing.assert_allclose(ways["coarse_carried"](poses), ways["coarse"](poses), atol=2e-3)
    own = 2 * (SMALL.neutral + refined.offsets(params))[:, face.vertices]
    np.testing.assert_allclose(ways["refined"](poses), own, atol=2e-3)
    assert np.abs(ways["coarse"](poses) - ways["neutral"](poses)).max() > 0.1


class Named(PlainRig):
    """A rig of which only its landmarks and control points are asked."""

    def __init__(self, name: str, names: tuple[str, ...], points: tuple[str, ...]):
        self.name, self.landmark_names, self.control_point_names = name, names, points
        self.landmarks, self.control_points = np.arange(len(names)), np.arange(len(points)) + 100


def test_marks_are_those_that_both_name_and_too_few_are_refused():
    letters = tuple("abcdefgh")
    marks = shared_marks(Named("teen", letters, ("tip",)), Named("woman", letters[2:] + letters[:2], ("tip", "toe")))
    assert marks.names == (*letters, "tip") and marks.target[0] == 6 and marks.source[-1] == 100
    with pytest.raises(InputError, match="have 2 landmarks of the same names: at least 8 are needed"):
        shared_marks(Named("teen", letters, ()), Named("woman", ("a", "h", "x"), ()))


def test_a_mesh_without_a_face_is_refused():
    with pytest.raises(InputError, match="expected at least one whose name begins with 'face', got"):
        face_of(replace(SMALL, segment_names=("skin", "neck", "tooth")))
