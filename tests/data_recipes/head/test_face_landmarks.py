"""The landmarks of performance capture: 54 places on the skin of every head, each where its name says."""

from functools import cache

import numpy as np
import pytest
import rigs
from plain_rig import PlainRig
from small_facekit import write_facekit

from data_recipes.catalogue import FACE_LANDMARKS, build_rig, character_parts, with_face_landmarks
from data_recipes.head.face_landmarks import OUTER, landmark_vertices
from data_recipes.head.neutral_head import build_head
from data_recipes.landmark_set import region_of_landmark
from data_recipes.rig import Rig

NAMES = tuple(FACE_LANDMARKS)


@cache
def head_of(character):
    return build_head(character_parts(character)[0])


def test_the_set_is_the_68_without_the_outline_of_the_jaw():
    assert len(NAMES) == 54 and list(FACE_LANDMARKS.values()) == [7, 8, 9, *range(17, 68)]
    regions = [region_of_landmark(name) for name in NAMES]
    counts = {region: regions.count(region) for region in dict.fromkeys(regions)}
    assert counts == {"jaw": 3, "brows": 10, "nose": 9, "eye_right": 6, "eye_left": 6, "mouth": 20}


@pytest.mark.parametrize("character", ["tiny", "toon", "dragon"])
def test_landmarks_lie_on_the_skin_and_mirror_each_other(character):
    head = head_of(character)
    vertices = landmark_vertices(head)
    assert len(set(vertices.tolist())) == 54
    assert {head.part_names[part] for part in head.part[vertices]} <= set(OUTER)
    for name, vertex in zip(NAMES, vertices, strict=True):
        other = name.replace("left", "#").replace("right", "left").replace("#", "right")
        assert vertices[NAMES.index(other)] == head.mirror[vertex]


@pytest.mark.parametrize("character", ["tiny", "toon", "dragon"])
def test_landmarks_lie_where_their_names_say(character):
    head = head_of(character)
    place = dict(zip(NAMES, head.vertices[landmark_vertices(head)], strict=True))
    up = ["chin", "lip_lower", "seam_lower", "lip_upper", "nose_base", "nose_tip", "nose_bridge_3", "nose_bridge_1"]
    heights = [place[name][1] for name in up]
    assert heights == sorted(heights) and place["seam_lower"][1] <= place["seam_upper"][1] < place["lip_upper"][1]
    for start, step in (("brow_left", range(1, 6)), ("eye_left_upper", (1, 2)), ("lip_upper_left", (1, 2))):
        outwards = [place[f"{start}_{i}"][0] for i in step]
        assert outwards == sorted(outwards) and outwards[0] > 0
    assert place["eye_left_inner"][0] < place["eye_left_lower_1"][0] < place["eye_left_outer"][0]
    assert place["brow_left_3"][1] > place["eye_left_upper_1"][1] > place["eye_left_lower_1"][1] > place["nose_tip"][1]
    assert place["nose_wing_left"][0] > place["nostril_left"][0] > place["nose_base"][0] == pytest.approx(0, abs=1e-6)


def test_a_rig_gets_them_as_its_control_points_and_stays_what_it_is():
    rig = rigs.rig("tiny")
    other = with_face_landmarks(rig, character_parts("tiny")[0])
    assert other.control_point_names == NAMES and len(other.control_points) == len(other.control_point_regions) == 54
    pose = rig.default + np.float32(0.2) * (rig.upper - rig.lower)
    np.testing.assert_array_equal(other(pose), rig(pose))
    assert len(rig.control_points) != 54


def test_a_rig_of_ones_own_gets_them_whatever_its_class_is():
    class Own(PlainRig):
        name = "own"

    other = with_face_landmarks(Own(), character_parts("tiny")[0])
    assert isinstance(other, Rig) and other.name == "own" and other.control_point_names == NAMES
    assert len(other.control_points) == len(other.control_point_regions) == 54 and len(Own.control_points) == 0


def test_ict_facekit_has_them_by_the_models_own_numbers(tmp_path, monkeypatch):
    write_facekit(tmp_path)
    monkeypatch.setenv("ICT_FACEKIT", str(tmp_path))
    rig = build_rig(tmp_path / "mask.toml")
    other = with_face_landmarks(rig, character_parts(tmp_path / "mask.toml")[0])
    marked = dict(zip(rig.control_point_names, rig.control_points.tolist(), strict=True))
    found = dict(zip(NAMES, other.control_points.tolist(), strict=True))
    same = {
        "chin": "chin",
        "nose_tip": "nose_tip",
        "mouth_corner_left": "mouth_corner_left",
        "lip_upper": "lip_upper_top",
    }
    assert {name: found[name] for name in same} == {name: marked[theirs] for name, theirs in same.items()}
