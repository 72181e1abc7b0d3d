"""Landmarks and curves name what they say: right order up the face, pairs that mirror, curves along edges."""

from itertools import pairwise

import heads
import numpy as np
import pytest


@pytest.fixture(params=heads.NAMES)
def head(request):
    return heads.head(request.param)


def test_there_are_twenty_to_thirty_landmarks_at_as_many_places(head):
    assert 20 <= len(head.landmarks) <= 30
    if head.recipe.name != "tiny":
        assert len(set(head.landmarks.values())) == len(head.landmarks)


def test_landmarks_stand_in_order_up_the_face(head):
    lips = ("lip_lower_bottom", "lip_lower_mid", "lip_upper_mid", "lip_upper_top")
    order = ("chin", *lips, "nose_tip", "glabella", "forehead")
    heights = [head.vertices[head.landmarks[name], 1] for name in order]
    assert np.all(np.diff(heights) > 0)
    for name in order:
        assert head.vertices[head.landmarks[name], 0] == 0
    face = np.flatnonzero(head.part == head.part_names.index("face"))
    assert head.landmarks["nose_tip"] == face[head.vertices[face, 2].argmax()]


def test_paired_landmarks_mirror_and_the_left_ones_lie_to_the_left(head):
    for name, left in head.landmarks.items():
        if name.endswith("_left"):
            assert head.mirror[left] == head.landmarks[name.replace("_left", "_right")]
            assert head.vertices[left, 0] > 0


def test_lids_and_eye_corners_surround_the_eye(head):
    point = {name: head.vertices[index] - head.eyes["left"].centre for name, index in head.landmarks.items()}
    assert point["eye_inner_left"][0] < 0 < point["eye_outer_left"][0]
    assert point["lid_lower_left"][1] < 0 < point["lid_upper_left"][1]
    assert point["brow_inner_left"][0] < point["brow_mid_left"][0] < point["brow_outer_left"][0]
    assert point["brow_mid_left"][1] > point["lid_upper_left"][1]


def test_curves_run_along_edges(head):
    edges = np.sort(np.concatenate([head.quads[:, [i, (i + 1) % 4]] for i in range(4)]), 1)
    edges = set(map(tuple, edges.tolist()))
    for name, curve in head.curves.items():
        missing = [pair for pair in pairwise(curve.tolist()) if tuple(sorted(pair)) not in edges]
        gaps = int(name == "midline" or name.startswith("nasolabial"))  # at the lips; above the mouth's rings
        assert len(missing) <= gaps, name


def test_lip_curves_meet_at_the_corners_and_part_between(head):
    for outer, inner in (("lip_upper", "seam_upper"), ("lip_lower", "seam_lower")):
        assert len(head.curves[outer]) == len(head.curves[inner])
    upper, lower = head.curves["seam_upper"], head.curves["seam_lower"]
    assert upper[0] == lower[0] and upper[-1] == lower[-1]
    gap = head.vertices[upper, 1] - head.vertices[lower, 1]
    assert gap[0] == gap[-1] == 0 and gap[1:-1].min() > 0
