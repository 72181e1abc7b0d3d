"""A writer of small glTF files for tests: every choice that a file has is the test's own."""

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
GRID = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]])  # two triangles
PAIR = [0, 1, 2, 2, 1, 3]


class Gltf:
    """A file in the making: its JSON, and the bytes of its one buffer."""

    def __init__(self, **tree: Any):
        self.tree = {"asset": {"version": "2.0"}, **tree}
        self.data = bytearray()

    def add(self, section: str, **entry: Any) -> int:
        """Add an entry to a section and return its index."""
        self.tree.setdefault(section, []).append(entry)
        return len(self.tree[section]) - 1

    def view(self, data: bytes, **entry: Any) -> int:
        """Add bytes as a buffer view."""
        self.data += bytes(-len(self.data) % 4)
        first = len(self.data)
        self.data += data
        return self.add("bufferViews", buffer=0, byteOffset=first, byteLength=len(data), **entry)

    def numbers(self, values: Any, dtype: str = "f4", pad: int = 0, sparse: Any = None, **entry: Any) -> int:
        """Add an accessor of rows of values.

        pad: bytes between two rows. values: their count and width, for zeros. sparse: (rows, values) that change.
        """
        if isinstance(values, tuple):
            count, width, view = *values, {}
        else:
            rows = np.asarray(values).astype(f"<{dtype}")
            rows = rows.reshape(len(rows), -1)
            count, width = rows.shape
            wide = np.zeros((count, width * rows.itemsize + pad), np.uint8)
            wide[:, : width * rows.itemsize] = np.frombuffer(rows.tobytes(), np.uint8).reshape(count, -1)
            stride = {"byteStride": wide.shape[1]} if pad else {}
            view = {"bufferView": self.view(wide.tobytes(), **stride)}
        if sparse is not None:
            places, changed = (np.asarray(part) for part in sparse)
            entry["sparse"] = {
                "count": len(places),
                "indices": {"bufferView": self.view(places.astype("<u2").tobytes()), "componentType": 5123},
                "values": {"bufferView": self.view(changed.astype(f"<{dtype}").tobytes())},
            }
        kind = {"componentType": CODES[dtype], "type": KINDS[width]}
        return self.add("accessors", count=count, **view, **kind, **entry)

    def primitive(self, vertices: Any = GRID, indices: Any = PAIR, **entry: Any) -> dict[str, Any]:
        """Return a primitive of float positions and u16 indices; attributes=… adds to its attributes."""
        attributes = {"POSITION": self.numbers(vertices), **entry.pop("attributes", {})}
        corners = {} if indices is None else {"indices": self.numbers(np.reshape(indices, (-1, 1)), "u2")}
        return {"attributes": attributes, **corners, **entry}

    def show(self, *primitives: dict[str, Any], mesh: dict[str, Any] | None = None, **node: Any) -> int:
        """Add a mesh and a node that has it, and return the node's index."""
        return self.add("nodes", mesh=self.add("meshes", primitives=list(primitives), **(mesh or {})), **node)

    def finished(self, uri: str | None = None) -> dict[str, Any]:
        """Return the JSON with its buffer."""
        buffer = {"byteLength": len(self.data)} | ({"uri": uri} if uri else {})
        return {"buffers": [buffer], **self.tree} if self.data else self.tree

    def glb(self) -> bytes:
        """Return the file as GLB."""
        text = json.dumps(self.finished()).encode()
        text += b" " * (-len(text) % 4)
        data = bytes(self.data) + bytes(-len(self.data) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
        return struct.pack("<4s2I", b"glTF", 2, 12 + len(chunks)) + chunks

    def write(self, file: Path, embedded: bool = False) -> Path:
        """Write a .glb or .vrm, or a .gltf with its buffer beside it (embedded: in a data URI)."""
        if file.suffix != ".gltf":
            file.write_bytes(self.glb())
            return file
        uri = f"data:application/octet-stream;base64,{base64.b64encode(self.data).decode()}"
        if not embedded:
            uri = f"{file.stem}%20data.bin"
            (file.parent / f"{file.stem} data.bin").write_bytes(self.data)
        file.write_text(json.dumps(self.finished(uri)))
        return file
