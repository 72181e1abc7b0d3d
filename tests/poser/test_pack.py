"""What a page carries: arrays come back as they were, the same ones as the same bytes; eyeballs by what moves them."""

import gzip
import json
import struct

import numpy as np
import pytest
from posed_face import EYE_CENTRE, GAZE, MESH, PosedRig, posed_face

from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.poser.contents import face_contents
from replicate.poser.display_parts import display_contents, rigid_motion, sphere_centre
from replicate.poser.pack import ALIGNMENT, indices, packed

ARRAYS = {
    "odd": np.arange(-3, 4, dtype=np.int8),
    "halves": np.linspace(-2, 2, 15, dtype=np.float16).reshape(3, 5),
    "steps": np.array([[-32_768, 32_767, 5]], np.int16),
    "none": np.zeros((0, 3), np.float32),
    "last": np.array([1.5, np.pi], np.float32),
}


def unpacked(data):
    """Return (header, arrays) of what `packed` gave, as packed.js reads it."""
    plain = gzip.decompress(data)
    (length,) = struct.unpack_from("<I", plain)
    header = json.loads(plain[4 : 4 + length])
    arrays, place = {}, 4 + length
    for entry in header.pop("arrays"):
        kind, count = np.dtype(entry["kind"]).newbyteorder("<"), int(np.prod(entry["shape"]))
        data = plain[place : place + count * kind.itemsize]
        data = np.frombuffer(data, np.uint8).reshape(2, -1).T.tobytes() if kind.itemsize == 2 else data
        arrays[entry["name"]] = np.frombuffer(data, kind).reshape(entry["shape"])
        place += -(-len(data) // ALIGNMENT) * ALIGNMENT
    return header, arrays


def test_arrays_come_back_as_they_were():
    header, arrays = unpacked(packed({"character": "tëst", "list": [1, 2.5]}, ARRAYS))
    assert header == {"character": "tëst", "list": [1, 2.5]} and list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype and arrays[name].shape == array.shape
        np.testing.assert_array_equal(arrays[name], array)


def test_the_same_contents_are_the_same_bytes():
    assert packed({"a": 1}, ARRAYS) == packed({"a": 1}, ARRAYS) != packed({"a": 2}, ARRAYS)


def test_what_a_page_cannot_hold_is_refused():
    with pytest.raises(InputError, match=r"'wide': expected one of float32, .* got float64"):
        packed({}, {"wide": np.zeros(3)})


def test_indices_are_as_narrow_as_they_can_be():
    assert indices(np.array([65_535]), 65_536).dtype == np.uint16
    assert indices(np.array([65_536]), 65_537).dtype == np.uint32


def test_a_page_has_the_model_as_it_is_stored():
    face = posed_face()
    header, arrays = face_contents(face)
    assert header["rigid"] == 1 and [region["name"] for region in header["inverse"]["regions"]] == ["face", "neck"]
    for k, basis in enumerate(face.model.bases):
        np.testing.assert_array_equal(arrays[f"basis.{k}.rough"], basis.rough.numpy())
    for k, (network, seen) in enumerate(zip(face.model.network.networks, face.model.network.seen, strict=True)):
        weight = network.line.weight.detach().numpy()
        np.testing.assert_array_equal(arrays[f"regional.{k}.line"].astype(np.float32), weight)
        np.testing.assert_array_equal(arrays[f"regional.{k}.seen"], seen.numpy())


def test_an_eyeball_turns_by_what_each_control_does_to_it():
    header, arrays = display_contents(PosedRig(), progress)
    (eye,), motions = header["display"]["eyes"], arrays["display.eye.0"]
    np.testing.assert_allclose(eye["centre"], EYE_CENTRE, atol=1e-3)
    assert np.flatnonzero(motions.any(axis=(1, 2))).tolist() == [GAZE]
    np.testing.assert_allclose(motions[GAZE, 1], [0, 0, 1.0, 0, 2, 0], atol=1e-3)
    np.testing.assert_allclose(motions[GAZE, 0], [0, 0, -0.5, 0, -1, 0], atol=1e-3)


def test_what_lies_on_the_skin_stands_first_and_goes_with_the_vertices_nearest_to_it():
    header, arrays = display_contents(PosedRig(), progress)
    assert len(arrays["display.vertices"]) == 3 + 39 and arrays["display.index"].shape == (3, 4)
    assert arrays["display.index"][:, 0].tolist() == [0, 1, 16]
    assert (np.abs(arrays["display.weight"].sum(axis=1, dtype=int) - 255) <= 2).all()
    places = arrays["display.vertices"] * header["display"]["step_mm"]
    np.testing.assert_allclose(places[:3], MESH.neutral[[0, 1, 16]] + [0, 0, 1], atol=0.01)


def test_a_rig_without_props_has_nothing_for_display():
    class Bare(PosedRig):
        def pose_props(self, params):
            return []

    assert display_contents(Bare(), progress) == ({"display": None}, {})


def test_a_still_eyeball_has_no_motion():
    points = np.random.default_rng(0).normal(size=(20, 3))
    assert not rigid_motion(points, points + 1e-4, sphere_centre(points)).any()
