"""Neutral mesh and morph targets of a GLB, read by what the standard says: JSON, then bytes, some of them sparse."""

import json
from pathlib import Path

import numpy as np
import onnxruntime

KINDS = {5123: "<u2", 5125: "<u4", 5126: "<f4"}
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


def read_shapes(data: bytes):
    """Return the mesh as glTF has it, its vertices (n, 3) and its morph targets (s, n, 3), in metres."""
    length = int.from_bytes(data[12:16], "little")
    tree, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def numbers(place, kind, shape):
        start = tree["bufferViews"][place["bufferView"]].get("byteOffset", 0) + place.get("byteOffset", 0)
        return np.frombuffer(binary, KINDS[kind], int(np.prod(shape)), start).reshape(shape)

    def array(index):
        accessor = tree["accessors"][index]
        kind, columns = accessor["componentType"], COLUMNS[accessor["type"]]
        shape = (accessor["count"], columns)
        values = numbers(accessor, kind, shape).copy() if "bufferView" in accessor else np.zeros(shape, KINDS[kind])
        if sparse := accessor.get("sparse"):
            where = numbers(sparse["indices"], sparse["indices"]["componentType"], (sparse["count"],))
            assert (np.diff(where.astype(int)) > 0).all(), "the standard wants indices that increase"
            values[where] = numbers(sparse["values"], kind, (sparse["count"], columns))
        for name, bound in (("min", values.min(0)), ("max", values.max(0))):
            assert name not in accessor or np.array_equal(np.float32(accessor[name]), bound)
        return values

    (mesh,) = tree["meshes"]
    (primitive,) = mesh["primitives"]
    targets = np.stack([array(target["POSITION"]) for target in primitive["targets"]])
    return mesh, array(primitive["attributes"]["POSITION"]), targets


def posed_by_shapes(file: Path, params):
    """Return the vertices, mm, of poses (b, m): weights by `file`.onnx, applied to the shapes of `file`.glb."""
    _, neutral, targets = read_shapes(file.with_suffix(".glb").read_bytes())
    session = onnxruntime.InferenceSession(file.with_suffix(".onnx"), providers=["CPUExecutionProvider"])
    (weights,) = session.run(["weights"], {"parameters": params})
    return 1000 * (neutral + np.tensordot(weights, targets, 1))
