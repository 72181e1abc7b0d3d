"""Regions of a face: the nearest control point's, on the skin alone, named from the top to the bottom."""

import numpy as np
from small_face import small_mesh

from replicate.geometry.face_regions import NO_REGION, face_regions


def test_each_mesh_face_of_the_skin_has_the_region_of_the_nearest_control_point():
    mesh = small_mesh()
    skin = np.flatnonzero(mesh.segment == 0)
    height = mesh.neutral[skin, 1]
    points = [skin[height.argmin()], skin[height.argmax()], skin[np.abs(height - 30).argmin()]]
    names, region = face_regions(mesh, np.array(points), ("mouth", "brows", "nose"))
    assert names == ("forehead", "nose", "mouth")
    centres = mesh.neutral[mesh.faces].mean(1)
    distance = np.linalg.norm(centres[:, None] - mesh.neutral[[points[1], points[2], points[0]]], axis=-1)
    own = (mesh.segment[mesh.faces] == 0).all(1)
    np.testing.assert_array_equal(region[own], distance.argmin(1)[own])
    assert set(region[own].tolist()) == {0, 1, 2} and (region[~own] == NO_REGION).all() and (~own).any()


def test_both_eyes_are_one_region_and_other_names_stay():
    mesh = small_mesh()
    names, region = face_regions(mesh, np.array([0, 15, 250]), ("eye_left", "eye_right", "snout"))
    assert sorted(names) == ["eyes", "snout"] and set(region.tolist()) == {NO_REGION, 0, 1}


def test_a_rig_without_marks_has_no_regions():
    names, region = face_regions(small_mesh(), np.zeros(0, np.int32), ())
    assert names == () and (region == NO_REGION).all() and len(region) == len(small_mesh().faces)
