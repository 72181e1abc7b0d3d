"""Compressed glTF files: decoded where the packages for it are installed, else refused with a remedy."""

import json
import sys

import numpy as np
import pytest
from gltf_writer import GRID, PAIR, Gltf

from data_recipes.gltf.gltf_face import read_gltf
from replicate.base.exceptions import InputError

MESHOPT, DRACO = "EXT_meshopt_compression", "KHR_draco_mesh_compression"
N = 40
STRIP = np.stack([np.arange(N) // 2, np.arange(N) % 2, np.zeros(N)], axis=1)
CORNERS = np.concatenate([[k, k + 1, k + 2] if k % 2 == 0 else [k + 1, k, k + 2] for k in range(N - 2)])


def packed(g, data, count, stride, mode, **entry):
    """Add a compressed buffer view, as gltfpack writes it: the uncompressed one lies in a buffer that isn't there."""
    extension = {"buffer": 0, "byteOffset": len(g.data), "byteLength": len(data)}
    extension |= {"byteStride": stride, "count": count, "mode": mode} | entry
    g.data += data + bytes(-len(data) % 4)
    stride = {"byteStride": stride} if mode == "ATTRIBUTES" else {}
    length = count * extension["byteStride"]
    return g.add("bufferViews", buffer=1, byteLength=length, **stride, extensions={MESHOPT: extension})


def meshopt_file(vertices, corners, **entry):
    """Return a file with these compressed positions (whole numbers, i2) and indices."""
    g = Gltf(extensionsRequired=[MESHOPT, "KHR_mesh_quantization"])
    kind = {"componentType": 5122, "count": N, "type": "VEC3"}
    place = g.add("accessors", bufferView=packed(g, vertices, N, 8, "ATTRIBUTES", **entry), **kind)
    view = packed(g, corners, len(CORNERS), 2, "TRIANGLES")
    index = g.add("accessors", bufferView=view, componentType=5123, count=len(CORNERS), type="SCALAR")
    g.show({"attributes": {"POSITION": place}, "indices": index})
    buffers = [{"byteLength": len(g.data)}, {"byteLength": 10**6, "extensions": {MESHOPT: {"fallback": True}}}]
    g.tree["buffers"] = buffers
    return g


def rotated(faces):
    """Return faces each from its smallest corner on; compression may turn them."""
    return sorted(tuple(np.roll(face, -np.argmin(face)).tolist()) for face in faces)


def test_meshopt_is_decoded(tmp_path):
    meshoptimizer = pytest.importorskip("meshoptimizer")
    rows = np.zeros((N, 4), "<i2")
    rows[:, :3] = STRIP
    vertices = meshoptimizer.encode_vertex_buffer(rows.view(np.float32), N, 8)
    g = meshopt_file(bytes(vertices), bytes(meshoptimizer.encode_index_buffer(CORNERS.astype("u4"), len(CORNERS), N)))
    face = read_gltf(g.write(tmp_path / "a.glb"))
    np.testing.assert_array_equal(face.vertices, STRIP)
    assert rotated(face.faces) == rotated(CORNERS.reshape(-1, 3))
    for change in (
        {"count": N + 1},
        {"count": 10**8},
        {"mode": "TRIANGLES"},
        {"byteLength": 20},
        {"filter": "QUATERNION2"},
    ):
        damaged = json.loads(json.dumps(g.tree))
        damaged["bufferViews"][0]["extensions"][MESHOPT] |= change
        other = Gltf(**damaged)
        other.data = g.data
        with pytest.raises(InputError, match=rf"b\.glb: bufferViews\[0\]\.extensions\.{MESHOPT}: "):
            read_gltf(other.write(tmp_path / "b.glb"))
    for place in range(0, len(g.data), 3):  # whatever is damaged is decoded to something or refused
        other = meshopt_file(bytes(vertices), b"")
        other.tree, other.data = g.tree, bytearray(g.data)
        other.data[place] ^= 0xFF
        try:
            read_gltf(other.write(tmp_path / "c.glb"))
        except InputError as error:
            assert "c.glb: " in str(error)


def test_meshopt_without_its_package_names_the_remedy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    with pytest.raises(InputError, match=r"a\.glb: it is compressed with EXT_meshopt_compression: pip install meshopt"):
        read_gltf(meshopt_file(b"\xa0" * 64, b"\xe0" * 64).write(tmp_path / "a.glb"))


def draco_file(data, ids, required=True, count=4):
    g = Gltf(**({"extensionsRequired": [DRACO]} if required else {}))
    view = g.view(data)
    kind = {"componentType": 5126, "count": count}
    attributes = {
        "POSITION": g.add("accessors", type="VEC3", **kind),
        "TEXCOORD_0": g.add("accessors", type="VEC2", **kind),
    }
    index = g.add("accessors", type="SCALAR", componentType=5123, count=6)
    extension = {DRACO: {"bufferView": view, "attributes": ids}}
    g.show({"attributes": attributes, "indices": index, "extensions": extension})
    return g


def test_draco_is_decoded(tmp_path):
    draco = pytest.importorskip("DracoPy")
    uv = GRID[:, :2].astype(float)
    data = draco.encode(GRID.astype("f4"), np.reshape(PAIR, (-1, 3)), 14, preserve_order=True, tex_coord=uv)
    names = {"POSITION": 0, "TEXCOORD_0": 3}
    ids = {
        name: next(entry["unique_id"] for entry in draco.decode(data).attributes if entry["attribute_type"] == kind)
        for name, kind in names.items()
    }
    face = read_gltf(draco_file(data, ids).write(tmp_path / "a.glb"))
    np.testing.assert_allclose(face.vertices, GRID, atol=1e-4)
    np.testing.assert_allclose(face.uv, uv * [1, -1] + [0, 1], atol=1e-3)
    np.testing.assert_array_equal(face.faces.ravel(), PAIR)
    for damaged in (draco_file(data[:40], ids), draco_file(data, {"POSITION": 9}), draco_file(data, ids, count=5)):
        with pytest.raises(InputError, match=r"b\.glb: .*KHR_draco_mesh_compression"):
            read_gltf(damaged.write(tmp_path / "b.glb"))


def test_draco_without_its_package_names_the_remedy_unless_the_file_does_without(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(
        InputError, match=r"a\.glb: it is compressed with KHR_draco_mesh_compression: pip install DracoPy"
    ):
        read_gltf(draco_file(b"DRACO" * 9, {"POSITION": 0}).write(tmp_path / "a.glb"))
    g = Gltf()
    g.show(g.primitive(extensions={DRACO: {"bufferView": 0, "attributes": {}}}))
    np.testing.assert_array_equal(read_gltf(g.write(tmp_path / "a.glb")).vertices, GRID)
