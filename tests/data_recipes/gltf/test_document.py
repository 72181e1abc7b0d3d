"""Damaged glTF files: each is refused in one sentence that names it, before anything large is made."""

import copy
import json
import os
import struct
import tracemalloc

import numpy as np
import pytest
from gltf_writer import GRID, Gltf

from data_recipes.gltf import document
from data_recipes.gltf.document import buffer_files
from data_recipes.gltf.gltf_face import read_gltf
from replicate.base.exceptions import InputError


def refused(file):
    """Return the sentence with which a file is refused."""
    with pytest.raises(InputError) as caught:
        read_gltf(file)
    text = str(caught.value)
    assert text.startswith(f"{file}: ") and "\n" not in text and len(text) < 500
    return text.removeprefix(f"{file}: ")


def rich():
    """Return a file with all that can be damaged."""
    g = Gltf(scene=0, scenes=[{"nodes": [0, 1]}], extensionsRequired=["KHR_mesh_quantization"])
    attributes = {
        "TEXCOORD_0": g.numbers(GRID[:, :2]),
        "JOINTS_0": g.numbers(np.zeros((4, 4)), "u1"),
        "WEIGHTS_0": g.numbers(np.eye(4)[[0] * 4]),
    }
    target = {"POSITION": g.numbers((4, 3), sparse=([1], [[1, 2, 3]]))}
    colour = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1]}}
    g.add("materials", **colour)
    g.show(g.primitive(attributes=attributes, targets=[target], material=0), skin=0, name="head")
    g.add("nodes", children=[2], rotation=[0, 0, 0, 1], scale=[1, 1, 1])
    g.add("nodes", translation=[0, 0, 0])
    g.add("skins", joints=[2], inverseBindMatrices=g.numbers(np.eye(4).reshape(1, 16)))
    return g


NAN = struct.pack("<f", np.nan)
POSITION, SPARSE, TARGET = 4, ("accessors", 3, "sparse"), ("meshes", 0, "primitives", 0, "targets")
PRIMITIVE = ("meshes", 0, "primitives", 0)
FACTOR = ("materials", 0, "pbrMetallicRoughness", "baseColorFactor")
FAULTS = {  # place, value, words of the sentence
    "no asset": (("asset",), None, "expected an object with an asset"),
    "version 1": (("asset", "version"), "1.0", "expected glTF version 2.0, got '1.0'"),
    "another file's extension": (("extensionsRequired",), ["KHR_gaussian_splatting"], "KHR_gaussian_splatting"),
    "a scene out of range": (("scene",), 7, "glTF.scene: expected a whole number from 0 to 0, got 7"),
    "a root out of range": (("scenes", 0, "nodes"), [9], "scenes[0].nodes: expected indices of 3 nodes, got [9]"),
    "a root twice": (("scenes", 0, "nodes"), [0, 0], "a node twice"),
    "a root within another": (("scenes", 0, "nodes"), [0, 1, 2], "a node twice"),
    "an empty scene": (("scenes", 0, "nodes"), [], "expected a scene with triangles, got none"),
    "nodes that aren't a list": (("nodes",), {"a": 1}, "nodes: expected a list of objects"),
    "nodes in a circle": (("nodes", 2, "children"), [1], "nodes[1]: it is among its own children"),
    "a node in itself": (("nodes", 0, "children"), [0], "nodes[0]: it is among its own children"),
    "a node of two parents": (("nodes", 0, "children"), [2], "nodes[2]: expected one parent"),
    "a node twice in a list": (("nodes", 1, "children"), [2, 2], "nodes[2]: expected one parent"),
    "a child that is text": (("nodes", 1, "children"), ["a"], "nodes[1].children: expected indices"),
    "a scale of two": (("nodes", 1, "scale"), [1, 1], "nodes[1].scale: expected 3 numbers"),
    "a huge scale": (("nodes", 1, "scale"), [1e300, 1, 1], "numbers up to 1e+09"),
    "a whole number without end": (("nodes", 1, "scale"), [10**400, 1, 1], "numbers up to 1e+09"),
    "a rotation of nothing": (("nodes", 1, "rotation"), [0] * 4, "a quaternion other than zero"),
    "a matrix of perspective": (("nodes", 1, "matrix"), [1.0] * 16, "a last row of 0, 0, 0, 1"),
    "a joint without size": (("nodes", 1, "scale"), [0, 1, 1], "expected a joint of some size"),
    "a mesh out of range": (("nodes", 0, "mesh"), 1, "nodes[0].mesh"),
    "a mesh that is true": (("nodes", 0, "mesh"), True, "nodes[0].mesh"),
    "a skin out of range": (("nodes", 0, "skin"), 3, "nodes[0].skin"),
    "weights as text": (("nodes", 0, "weights"), ["much"], "nodes[0].weights: expected numbers"),
    "joints out of range": (("skins", 0, "joints"), [-1], "skins[0].joints"),
    "no joints": (("skins", 0, "joints"), [], "expected joints from 0 to -1, got 0"),
    "too few matrices": (("skins", 0, "joints"), [2, 1], "expected 2 matrices, got 1"),
    "matrices that are positions": (("skins", 0, "inverseBindMatrices"), POSITION, "type: expected MAT4, got 'VEC3'"),
    "an unknown mode": ((*PRIMITIVE, "mode"), 7, "mode: expected a whole number from 0 to 6, got 7"),
    "no positions": ((*PRIMITIVE, "attributes", "POSITION"), None, "POSITION is missing"),
    "attributes that are a list": ((*PRIMITIVE, "attributes"), [], "attributes: expected an object"),
    "positions out of range": ((*PRIMITIVE, "attributes", "POSITION"), 99, "POSITION: expected a whole number"),
    "positions that are text": ((*PRIMITIVE, "attributes", "POSITION"), "a", "POSITION: expected a whole number"),
    "texture coordinates of a wrong kind": ((*PRIMITIVE, "attributes", "TEXCOORD_0"), POSITION, "expected VEC2"),
    "indices that are positions": ((*PRIMITIVE, "indices"), POSITION, "expected SCALAR, got 'VEC3'"),
    "targets that are a number": (TARGET, 3, "targets: expected a list of objects"),
    "a target of another size": ((*TARGET, 0, "POSITION"), 6, "expected VEC3, got 'MAT4'"),
    "a material out of range": ((*PRIMITIVE, "material"), 4, "material: expected a whole number"),
    "a colour as text": (FACTOR, "red", "baseColorFactor: expected 4 numbers"),
    "corners that make no triangles": (("accessors", 5, "count"), 5, "expected three corners a triangle, got 5"),
    "no count": (("accessors", POSITION, "count"), None, "count: expected a whole number"),
    "a count of zero": (("accessors", POSITION, "count"), 0, "count: expected a whole number"),
    "a huge count": (("accessors", POSITION, "count"), 10**15, "count: expected a whole number"),
    "a count beyond the view": (
        ("accessors", 5, "count"),
        9,
        "accessors[5]: expected a bufferView of at least 18 bytes",
    ),
    "fewer coordinates": (("accessors", 0, "count"), 3, "accessors[0].count: expected 4, got 3"),
    "an offset beyond the view": (("accessors", POSITION, "byteOffset"), 40, "a bufferView of at least 88 bytes"),
    "a negative offset": (("accessors", POSITION, "byteOffset"), -4, "byteOffset: expected a whole number"),
    "an unknown type": (("accessors", POSITION, "type"), "VEC9", "type: expected VEC3, got 'VEC9'"),
    "an unknown component": (("accessors", POSITION, "componentType"), 5130, "componentType: expected one of 5120"),
    "real indices": (("accessors", 5, "componentType"), 5126, "bufferView"),
    "a view out of range": (("accessors", POSITION, "bufferView"), 99, "bufferView: expected a whole number"),
    "views as text": (("bufferViews",), "all", "bufferViews: expected a list of objects"),
    "a view beyond the buffer": (("bufferViews", 0, "byteLength"), 10**6, "expected bytes up to"),
    "a view of no length": (("bufferViews", 0, "byteLength"), None, "byteLength: expected a whole number"),
    "a stride too small": (("bufferViews", 0, "byteStride"), 4, "byteStride: expected at least 8"),
    "a stride too large": (("bufferViews", 0, "byteStride"), 2**70, "byteStride: expected a whole number"),
    "a buffer out of range": (("bufferViews", 0, "buffer"), 1, "buffer: expected a whole number from 0 to 0"),
    "no buffer": (("bufferViews", 0, "buffer"), None, "a buffer is missing"),
    "a buffer longer than its data": (("buffers",), [{"byteLength": 10**6}], "expected 1000000 bytes, got"),
    "a buffer elsewhere": (("buffers",), [{"byteLength": 4, "uri": "https://example.com/a.bin"}], "in the same folder"),
    "a buffer above": (("buffers",), [{"byteLength": 4, "uri": "../a.bin"}], "expected a file in the same folder"),
    "a buffer above, disguised": (("buffers",), [{"byteLength": 4, "uri": "%2e%2e/a"}], "in the same folder"),
    "a buffer at the root": (("buffers",), [{"byteLength": 4, "uri": "/etc/passwd"}], "in the same folder"),
    "a buffer of NUL": (("buffers",), [{"byteLength": 4, "uri": "a%00"}], "in the same folder"),
    "a buffer that isn't there": (("buffers",), [{"byteLength": 4, "uri": "no.bin"}], "there is no such file"),
    "a buffer that is the folder": (("buffers",), [{"byteLength": 4, "uri": "."}], "in the same folder"),
    "data in no base64": (("buffers",), [{"byteLength": 4, "uri": "data:a;base64,@@"}], "expected data in base64"),
    "data in plain text": (("buffers",), [{"byteLength": 4, "uri": "data:text/plain,abcd"}], "data in base64"),
    "sparse that is a list": (SPARSE, [], "sparse: expected an object"),
    "sparse of more than all": ((*SPARSE, "count"), 5, "sparse.count: expected a whole number from 0 to 4"),
    "sparse without values": ((*SPARSE, "values"), {}, "sparse.values: a bufferView is missing"),
    "sparse values out of range": ((*SPARSE, "values", "bufferView"), 99, "sparse.values.bufferView"),
    "sparse real indices": ((*SPARSE, "indices", "componentType"), 5126, "sparse.indices"),
}


def put(tree, place, value):
    """Return a tree with another value at a place, or without it."""
    tree = copy.deepcopy(tree)
    table = tree
    for key in place[:-1]:
        table = table[key]
    if value is None:
        del table[place[-1]]
    else:
        table[place[-1]] = value
    return tree


def test_the_file_that_is_damaged_here_is_a_good_one(tmp_path):
    face = read_gltf(rich().write(tmp_path / "a.glb"))
    assert len(face.vertices) == 4 and face.skin and face.targets["target_00"][1].tolist() == [1, 2, 3]


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_damaged_or_out_of_range_is_refused_in_a_sentence(tmp_path, fault):
    g, (place, value, words) = rich(), FAULTS[fault]
    g.tree = put(g.tree, place, value)
    assert words in refused(g.write(tmp_path / "a.glb"))


@pytest.mark.parametrize(
    ("accessor", "values", "words"),
    [
        (0, np.full((4, 2), np.nan), "accessors[0]: element 0: expected numbers up to 1e+09, got [nan, nan]"),
        (2, np.full((4, 4), -0.5), "expected weights of at least 0, got -0.5"),
        (POSITION, np.full((4, 3), np.inf), "element 0: expected numbers"),
        (POSITION, np.full((4, 3), 1e30), "element 0: expected numbers"),
        (6, np.full((1, 16), 0.5), "expected matrices with a last row"),
    ],
)
def test_numbers_that_are_none_are_refused(tmp_path, accessor, values, words):
    g = rich()
    at = g.tree["bufferViews"][g.tree["accessors"][accessor]["bufferView"]]["byteOffset"]
    g.data[at : at + 4 * values.size] = values.astype("<f4").tobytes()
    assert words in refused(g.write(tmp_path / "a.glb"))


def test_indices_and_joints_beyond_the_vertices_and_the_skin_are_refused(tmp_path):
    g = rich()
    g.show({**g.primitive(), "indices": g.numbers([[0], [1], [4]], "u2")})
    g.tree["scenes"] = [{"nodes": [0, 3]}]
    assert "meshes[1].primitives[0]: expected vertices from 0 to 3, got 4" in refused(g.write(tmp_path / "a.glb"))
    g = rich()
    g.tree["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = g.numbers(np.full((4, 4), 3), "u1")
    assert "expected joints from 0 to 0, got 3" in refused(g.write(tmp_path / "a.glb"))


def test_files_that_are_no_glb_or_are_cut_are_refused(tmp_path):
    whole, file = rich().glb(), tmp_path / "a.glb"
    cases = {
        b"": "not a readable glTF file",
        b"glTF": "expected a GLB of at least 20 bytes, got 4",
        b"not a GLB": "not a readable glTF file",
        b"\xff\xfe{}": "not a readable glTF file",
        b"[" * 100_000: "not a readable glTF file",
        b'{"asset": {"version": "2.0"}, "scene": NaN}': "NaN is no number of JSON",
        b'{"a": ' + b"9" * 5000 + b"}": "not a readable glTF file",
        b"[]": "expected an object with an asset",
        whole[:300]: "the GLB is cut",
        whole[:4] + struct.pack("<I", 1) + whole[8:]: "expected a GLB of version 2, got 1",
        whole[:12] + struct.pack("<I", 10**9) + whole[16:]: "a chunk at byte 12",
        whole[:16] + b"BIN\0" + whole[20:]: "expected a GLB that begins with JSON",
    }
    for data, words in cases.items():
        file.write_bytes(data)
        assert words in refused(file)
    for size in range(0, len(whole), 97):
        file.write_bytes(whole[:size])
        refused(file)
    file.write_bytes(b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n")
    assert "`git lfs pull` fetches the file itself" in refused(file)
    file.unlink()
    assert refused(file) == "there is no such file"


def test_a_glb_whose_json_ends_anywhere_is_read(tmp_path):
    """Chunks should be filled up to four bytes, and some writers don't: the next one follows at once."""
    g, file = rich(), tmp_path / "a.glb"
    for spaces in range(4):
        text = json.dumps(g.finished()).encode() + b" " * spaces
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(g.data), b"BIN\0") + g.data
        file.write_bytes(struct.pack("<4s2I", b"glTF", 2, 12 + len(chunks)) + chunks)
        assert len(read_gltf(file).vertices) == 4


def test_a_buffer_behind_a_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "in").mkdir()
    g = rich()
    file = g.write(tmp_path / "in" / "a.gltf")
    assert buffer_files(file) == (tmp_path / "in" / "a data.bin",)
    os.replace(tmp_path / "in" / "a data.bin", tmp_path / "outside.bin")
    (tmp_path / "in" / "a data.bin").symlink_to(tmp_path / "outside.bin")
    assert "expected a file in the same folder, got 'a data.bin'" in refused(file)


def test_little_data_that_would_become_much_is_refused_before_it_does(tmp_path, monkeypatch):
    """Accessors without a view, a mesh shown a million times, targets by the hundred."""
    monkeypatch.setattr(document, "MOST_BYTES", 10_000_000)  # as much is reserved when a file is read
    tracemalloc.start()
    zeros = {"componentType": 5126, "type": "VEC3", "count": 4_900_000}
    g = Gltf(accessors=[zeros])
    g.show({"attributes": {"POSITION": 0}, "targets": [{"POSITION": 0}] * 100})
    assert "expected at most 400,000,000 offsets, got 100 targets of 4900000 vertices" in refused(
        g.write(tmp_path / "a.glb")
    )
    g = Gltf(accessors=[zeros], nodes=[{"mesh": 0}] * 1000, meshes=[{"primitives": [{"attributes": {"POSITION": 0}}]}])
    assert "expected at most 5,000,000 vertices in all, got more" in refused(g.write(tmp_path / "a.glb"))
    deep = Gltf(nodes=[{"children": [k + 1]} for k in range(3_000)] + [{}])
    assert "expected a scene with triangles" in refused(deep.write(tmp_path / "a.glb"))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50_000_000


def test_any_byte_of_the_json_may_change(tmp_path):
    """Each is refused in a sentence or read."""
    text = json.dumps(rich().finished()).encode()
    whole, rng, file, refusals = rich().glb(), np.random.default_rng(0), tmp_path / "a.glb", 0
    for _ in range(400):
        data = bytearray(whole)
        for place in rng.integers(12, 20 + len(text), 1 + rng.integers(3)):
            data[place] = rng.choice(np.frombuffer(b'0179-."{}[],:eE \x00\xff', np.uint8))
        file.write_bytes(data)
        try:
            read_gltf(file)
        except InputError as error:
            assert str(error).startswith(f"{file}: ") and "\n" not in str(error)
            refusals += 1
    assert refusals > 200
