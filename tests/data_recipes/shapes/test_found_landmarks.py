"""Landmarks that are found on faces of shapes: near those that are known, and a sentence where there are none."""

import os
from dataclasses import replace

import numpy as np
import pytest
import rigs
from gltf_writer import Gltf
from landmark_mask import write_glb
from plain_rig import PlainRig

from data_recipes.catalogue import FACE_LANDMARKS, build_rig, character_parts, play_weights, with_face_landmarks
from data_recipes.shapes.found_landmarks import found_landmarks
from replicate.base.exceptions import InputError

NAMES = tuple(FACE_LANDMARKS)
SHAPES = ("eyeBlinkLeft", "eyeBlinkRight", "jawOpen", "browDownLeft", "browDownRight")
facekit = pytest.mark.skipif(not os.environ.get("ICT_FACEKIT"), reason="ICT_FACEKIT names no folder of ICT-FaceKit")


def known(name):
    """A character's places of its landmarks, as its recipe has them, mm."""
    rig = with_face_landmarks(rigs.rig(name), character_parts(name)[0])
    return rig.mesh.neutral[rig.control_points]


def off_mm(vertices, places):
    return np.linalg.norm(vertices - places, axis=1)


@pytest.mark.parametrize(
    ("name", "mean", "most"), [("toon", 3.7, 18), ("teen", 2.1, 8), pytest.param("ict", 3.0, 8, marks=facekit)]
)
def test_they_are_near_the_known_ones_of_a_human_face(name, mean, most):
    found = found_landmarks(rigs.rig(name), {})
    assert tuple(found) == NAMES and len(set(found.values())) == len(NAMES)
    off = off_mm(rigs.rig(name).mesh.neutral[list(found.values())], known(name))
    assert off.mean() < mean and off.max() < most


def test_lips_have_theirs_on_their_own_side_of_the_seam():
    rig = rigs.rig("toon")
    params, _ = play_weights(["jawOpen"], np.ones((1, 1)), rig.controls)
    down = (rig.mesh.neutral - rig(params.astype(np.float32))[0])[:, 1]
    found = found_landmarks(rig, {})
    upper, lower = (
        [down[vertex] for name, vertex in found.items() if name.startswith(starts)]
        for starts in (("lip_upper", "seam_upper"), ("lip_lower", "seam_lower"))
    )
    assert max(upper) < 0.5 * np.median(lower) and min(lower) > np.median(upper) + 1


@pytest.fixture(scope="module")
def glb(tmp_path_factory):
    """The toon as somebody's GLB: a few shapes in ARKit's names, in metres, somewhere else in space."""
    rig, g = rigs.rig("toon"), Gltf(scene=0)
    params, _ = play_weights(SHAPES, np.eye(len(SHAPES)), rig.controls)
    offsets = rig(params.astype(np.float32)) - rig.mesh.neutral
    targets = [{"POSITION": g.numbers(offset / 1000)} for offset in offsets]
    vertices = rig.mesh.neutral / 1000 + (0, 1.6, 0.1)
    head = {"attributes": {"POSITION": g.numbers(vertices)}, "targets": targets}
    head["indices"] = g.numbers(rig.mesh.faces.reshape(-1, 1), "u4")
    g.add("scenes", nodes=[g.show(head, mesh={"extras": {"targetNames": list(SHAPES)}}, name="Head")])
    file = tmp_path_factory.mktemp("head") / "head.glb"
    file.write_bytes(g.glb())
    return file


def test_a_glb_has_them_and_its_face_toml_names_those_that_are_off(glb):
    chin = int(np.argmin(np.linalg.norm(rigs.rig("toon").mesh.neutral - known("toon")[NAMES.index("chin")], axis=1)))
    (glb.parent / "face.toml").write_text(f"[points.face_landmarks]\nchin = {chin}\n")
    rig = build_rig(glb)
    marked = with_face_landmarks(rig, character_parts(glb)[0])
    assert marked.control_point_names == NAMES
    places = marked.mesh.neutral[marked.control_points]
    off = places - known("toon")
    shift = off[NAMES.index("chin")]  # the whole face's
    assert np.linalg.norm(off - shift, axis=1).mean() < 3.7
    assert marked.control_points[NAMES.index("chin")] == rig.file_vertices[chin]


def test_a_face_whose_lids_cover_nothing_is_told_to_name_them(tmp_path):
    file = write_glb(tmp_path, ("chin", "nose_tip"))
    message = (
        r"mask: 2 of its 54 landmarks have no vertex, nor can be found: lids that close cover no opening of the left "
        r"eye: chin, nose_tip; name them in face.toml, \[points.face_landmarks\], as REPRODUCING.md says"
    )
    with pytest.raises(InputError, match=message):
        with_face_landmarks(build_rig(file), character_parts(file)[0])


def test_a_face_whose_jaw_parts_no_lips_is_told_so():
    rig = rigs.rig("toon")
    still = replace(rig, controls=tuple(replace(c, name=c.name.replace("jaw_open", "brow_x")) for c in rig.controls))
    with pytest.raises(InputError, match="no shape is called jawOpen"):
        found_landmarks(still, {})
    with pytest.raises(InputError, match="no shape is called eyeBlinkLeft or eyeBlinkRight or jawOpen"):
        found_landmarks(PlainRig(), {})
