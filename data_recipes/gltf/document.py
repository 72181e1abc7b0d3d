"""A glTF file's JSON, buffers and accessors, every index, size and number of which is checked before it is used.

Own code: general readers give arrays of what is in the file, or fail somewhere, and merge or reorder vertices besides.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float, Int

from data_recipes.gltf.compression import MESHOPT, decode_meshopt, is_installed
from replicate.base.exceptions import InputError
from replicate.base.schema import cut, naming, shown
from replicate.base.user_files import read_bytes, shown_path

MOST_BYTES = 400_000_000
MOST_ELEMENTS = 20_000_000  # of an accessor
FAR = 1e9

DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
SECTIONS = (
    "accessors",
    "bufferViews",
    "buffers",
    "images",
    "materials",
    "meshes",
    "nodes",
    "scenes",
    "skins",
    "textures",
)
# What an extension that a file requires has in its name where it changes no triangle
HARMLESS = ("material", "texture", "light", "VRM", "animation", "mesh_quantization", "xmp", "node_visibility")
READ = (*MESHOPT, "KHR_draco_mesh_compression")


@dataclass(frozen=True)
class Document:
    """A glTF file.

    tree: section → its entries, [] where the file has none; `scene`, `extensions` and `extensionsRequired` besides.
    folder: where buffers of their own lie.
    chunk: a GLB's binary chunk.
    buffers, decoded: what has been read of buffers, and of compressed buffer views, by index.
    """

    tree: dict[str, Any]
    folder: Path
    chunk: bytes | None
    buffers: dict[int, bytes] = field(default_factory=dict)
    decoded: dict[int, bytes] = field(default_factory=dict)


def read_document(file: Path) -> Document:
    """Return a GLB's or glTF's document. Raises InputError, which may lack the file's name, if it is damaged."""
    data = read_bytes(file, MOST_BYTES)
    chunk = None
    if data.startswith(b"version https://git-lfs"):
        raise InputError("this is Git LFS's pointer to the file: `git lfs pull` fetches the file itself")
    if data[:4] == b"glTF":
        data, chunk = _chunks(data)
    try:
        tree = json.loads(data.decode("utf-8-sig"), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:  # also text that isn't UTF-8
        raise InputError(f"not a readable glTF file ({cut(' '.join(str(error).split()))})") from None
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise InputError("not a glTF file: expected an object with an asset")
    version = tree["asset"].get("version")
    if not isinstance(version, str) or not version.startswith("2."):
        raise InputError(f"expected glTF version 2.0, got {shown(version)}")
    for section in SECTIONS:
        tree[section] = _list(tree, section, dict, "objects", "")
    required = _list(tree, "extensionsRequired", str, "names", "")
    for name in required:
        if name not in READ and not any(word in name for word in HARMLESS):
            raise InputError(f"it needs the extension {cut(name)!r}, which isn't read here: export it without")
    return Document(tree | {"extensionsRequired": required}, file.parent, chunk)


def buffer_files(file: Path) -> tuple[Path, ...]:
    """Return the files beside a glTF that its buffers are in. Raises InputError as `read_document` does."""
    with naming(shown_path(file)):
        document = read_document(file)
        uris = [(entry.get("uri"), f"buffers[{k}].uri") for k, entry in enumerate(document.tree["buffers"])]
        found = [_file_beside(file.parent, uri, place) for uri, place in uris if _is_file(uri)]
    return tuple(dict.fromkeys(found))


def _is_file(uri: Any) -> bool:
    return isinstance(uri, str) and uri[:5].lower() != "data:"


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """Return a GLB's JSON and its binary chunk, if it has one."""
    if len(data) < 20:
        raise InputError(f"expected a GLB of at least 20 bytes, got {len(data)}")
    version, length = struct.unpack_from("<2I", data, 4)
    if version != 2:
        raise InputError(f"expected a GLB of version 2, got {version}")
    if length > len(data):
        raise InputError(f"the GLB is cut: expected {length} bytes, got {len(data)}")
    chunks, at = [], 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise InputError(f"a chunk at byte {at}: expected at most {length - at - 8} bytes, got {size}")
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    if not chunks or chunks[0][0] != b"JSON":
        raise InputError("expected a GLB that begins with JSON")
    return chunks[0][1], next((content for kind, content in chunks if kind == b"BIN\0"), None)


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _list(table: dict[str, Any], key: str, kind: type, what: str, place: str) -> list:
    value = table.get(key, [])
    if not isinstance(value, list) or not all(isinstance(item, kind) for item in value):
        raise InputError(f"{place}{key}: expected a list of {what}, got {shown(value)}")
    return value


def table_of(table: dict[str, Any], key: str, place: str) -> dict[str, Any]:
    """Return a table's object under a key, {} if there is none."""
    value = table.get(key, {})
    if not isinstance(value, dict):
        raise InputError(f"{place}.{key}: expected an object, got {shown(value)}")
    return value


def tables_of(table: dict[str, Any], key: str, place: str) -> list[dict[str, Any]]:
    """Return a table's list of objects under a key, [] if there is none."""
    return _list(table, key, dict, "objects", f"{place}.")


def whole(
    table: dict[str, Any],
    key: str,
    place: str,
    default: int | None = None,
    lower: int = 0,
    upper: int = MOST_BYTES,
) -> int:
    """Return a whole number of a table; place: where that is, for messages; no default: it must be there."""
    value = table.get(key, default)
    if isinstance(value, float) and value.is_integer():
        value = int(value)  # 3.0
    if isinstance(value, bool) or not isinstance(value, int) or not lower <= value <= upper:
        raise InputError(f"{place}.{key}: expected a whole number from {lower} to {upper}, got {shown(value)}")
    return value


def reals(
    table: dict[str, Any], key: str, place: str, default: list[float] | None, exactly: bool = True
) -> list[float]:
    """Return a table's list of finite numbers, as many as its default has unless any count will do."""
    value = table.get(key, default)
    fits = isinstance(value, list) and (not exactly or default is None or len(value) == len(default))
    if not fits or not all(type(x) in (int, float) and abs(x) <= FAR for x in value):
        count = f"{len(default)} " if default is not None and exactly else ""
        raise InputError(f"{place}.{key}: expected {count}numbers up to {FAR:g}, got {shown(value)}")
    return [float(x) for x in value]


def reference(document: Document, table: dict[str, Any], key: str, place: str, section: str) -> int | None:
    """Return the index of an entry of a section that a table refers to, None if it refers to none."""
    if key not in table:
        return None
    if not document.tree[section]:
        raise InputError(f"{place}.{key}: there are no {section}")
    return whole(table, key, place, upper=len(document.tree[section]) - 1)


def references(document: Document, table: dict[str, Any], key: str, place: str, section: str) -> list[int]:
    """Return the indices of entries of a section that a table lists."""
    values, last = table.get(key, []), len(document.tree[section]) - 1
    if not isinstance(values, list) or not all(type(value) is int and 0 <= value <= last for value in values):
        raise InputError(f"{place}.{key}: expected indices of {last + 1} {section}, got {shown(values)}")
    return values


def matrices(values: Float[np.ndarray, "k 16"], place: str) -> Float[np.ndarray, "k 4 4"]:
    """Return matrices that are stored column by column; their last rows must be 0, 0, 0, 1."""
    matrix = values.reshape(-1, 4, 4).transpose(0, 2, 1).copy()
    if np.abs(matrix[:, 3] - [0, 0, 0, 1]).max(initial=0) > 1e-3:
        raise InputError(f"{place}: expected matrices with a last row of 0, 0, 0, 1")
    matrix[:, 3] = [0, 0, 0, 1]
    return matrix


def accessor_count(document: Document, index: int) -> int:
    """Return how many elements an accessor says it has."""
    return whole(document.tree["accessors"][index], "count", f"accessors[{index}]", lower=1, upper=MOST_ELEMENTS)


def read_floats(document: Document, index: int, kind: str, count: int | None = None) -> Float[np.ndarray, "k w"]:
    """Return an accessor's numbers, normalised whole ones as the numbers that they stand for.

    kind: the type that is expected, as glTF names it, such as "VEC3".
    count: how many elements are expected, if it is known.
    """
    values = _elements(document, index, kind, count)
    floats = values.astype(np.float64)
    if document.tree["accessors"][index].get("normalized") is True:
        floats = normalised(values)
    bad = np.flatnonzero(~(np.abs(floats) <= FAR).all(axis=1))
    if len(bad):
        value = shown(floats[bad[0]].tolist())
        raise InputError(f"accessors[{index}]: element {bad[0]}: expected numbers up to {FAR:g}, got {value}")
    return floats


def normalised(values: np.ndarray) -> Float[np.ndarray, "k w"]:
    """Return whole numbers as parts of the largest that their type holds; real ones as they are."""
    if values.dtype.kind == "f":
        return values.astype(np.float64)
    return np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)


def read_whole(document: Document, index: int, kind: str, count: int | None = None) -> Int[np.ndarray, "k w"]:
    """Return an accessor's whole numbers. kind, count: as in `read_floats`."""
    values = _elements(document, index, kind, count)
    if values.dtype.kind == "f":
        raise InputError(f"accessors[{index}]: expected whole numbers, got real ones")
    return values.astype(np.int64)


def _elements(document: Document, index: int, kind: str, count: int | None) -> np.ndarray:
    """Return an accessor's elements (k, w) in the type that the file has them in."""
    entry, place = document.tree["accessors"][index], f"accessors[{index}]"
    if entry.get("type") != kind:
        raise InputError(f"{place}.type: expected {kind}, got {shown(entry.get('type'))}")
    width, dtype, stated = WIDTHS[kind], component_type(entry, place), accessor_count(document, index)
    if count is not None and stated != count:
        raise InputError(f"{place}.count: expected {count}, got {stated}")
    view = reference(document, entry, "bufferView", place, "bufferViews")
    if view is None:
        values = np.zeros((stated, width), dtype)
    else:
        values = _strided(document, view, whole(entry, "byteOffset", place, 0), (stated, width), dtype, place)
    if "sparse" not in entry:
        return values
    sparse, place = table_of(entry, "sparse", place), f"{place}.sparse"
    changed = whole(sparse, "count", place, upper=stated)
    if not changed:
        return values
    parts = []
    for key, shape in (("indices", (changed, 1)), ("values", (changed, width))):
        part, where = table_of(sparse, key, place), f"{place}.{key}"
        view = reference(document, part, "bufferView", where, "bufferViews")
        if view is None:
            raise InputError(f"{where}: a bufferView is missing")
        kind_of = dtype if key == "values" else component_type(part, where)
        parts.append(_strided(document, view, whole(part, "byteOffset", where, 0), shape, kind_of, where))
    places = parts[0][:, 0]
    if places.dtype.kind != "u" or places.max() >= stated:
        raise InputError(f"{place}.indices: expected whole numbers from 0 to {stated - 1}, got {shown(places.max())}")
    values = values.copy()
    values[places] = parts[1]
    return values


def component_type(entry: dict[str, Any], place: str) -> np.dtype:
    """Return the type of an accessor's components."""
    code = whole(entry, "componentType", place)
    if code not in DTYPES:
        raise InputError(f"{place}.componentType: expected one of {', '.join(map(str, DTYPES))}, got {code}")
    return np.dtype(DTYPES[code])


def _strided(
    document: Document,
    view: int,
    offset: int,
    shape: tuple[int, int],
    dtype: np.dtype,
    place: str,
) -> np.ndarray:
    data, stride = read_view(document, view)
    size = shape[1] * dtype.itemsize
    stride = stride or size
    if stride < size:
        raise InputError(f"bufferViews[{view}].byteStride: expected at least {size} for {place}, got {stride}")
    end = offset + stride * (shape[0] - 1) + size
    if end > len(data):
        raise InputError(
            f"{place}: expected a bufferView of at least {end} bytes, got bufferViews[{view}] of {len(data)}"
        )
    return np.ndarray(shape, dtype, data, offset, (stride, dtype.itemsize))


def read_view(document: Document, index: int) -> tuple[bytes | memoryview, int]:
    """Return a buffer view's bytes, decoded if they are compressed, and the stride between its elements (0: none)."""
    view, place = document.tree["bufferViews"][index], f"bufferViews[{index}]"
    stride = whole(view, "byteStride", place, 0, upper=252)
    extensions = table_of(view, "extensions", place)
    name = next((name for name in MESHOPT if name in extensions), None)
    if name is None or not (name in document.tree["extensionsRequired"] or is_installed(name)):
        return _slice(document, view, place), stride  # where it isn't required, the file has the same uncompressed
    packed, where = table_of(extensions, name, place), f"{place}.extensions.{name}"
    width = whole(packed, "byteStride", where, lower=1)
    if index not in document.decoded:
        document.decoded[index] = _decode(document, packed, width, whole(view, "byteLength", place), where)
    return document.decoded[index], stride or (width if packed.get("mode") == "ATTRIBUTES" else 0)


def _decode(document: Document, packed: dict[str, Any], width: int, length: int, place: str) -> bytes:
    count = whole(packed, "count", place, lower=1)
    if count * width != length:
        raise InputError(f"{place}: expected {length} bytes, got {count} elements of {width} bytes")
    if sum(map(len, document.decoded.values())) + length > MOST_BYTES:
        raise InputError(f"{place}: expected at most {MOST_BYTES / 1e6:g} MB when decoded, got more")
    data = bytes(_slice(document, packed, place))
    return decode_meshopt(data, count, width, packed.get("mode"), packed.get("filter"), place)


def _slice(document: Document, view: dict[str, Any], place: str) -> memoryview:
    buffer = reference(document, view, "buffer", place, "buffers")
    if buffer is None:
        raise InputError(f"{place}: a buffer is missing")
    data = _buffer(document, buffer)
    offset, length = whole(view, "byteOffset", place, 0), whole(view, "byteLength", place, lower=1)
    if offset + length > len(data):
        raise InputError(f"{place}: expected bytes up to {len(data)} of buffers[{buffer}], got up to {offset + length}")
    return memoryview(data)[offset : offset + length]


def _buffer(document: Document, index: int) -> bytes:
    if index in document.buffers:
        return document.buffers[index]
    entry, place = document.tree["buffers"][index], f"buffers[{index}]"
    length, uri = whole(entry, "byteLength", place, lower=1), entry.get("uri")
    if uri is None and index == 0 and document.chunk is not None:
        data = document.chunk
    elif not isinstance(uri, str):
        raise InputError(f"{place}.uri: expected a file's name or a data URI, got {shown(uri)}")
    elif _is_file(uri):
        data = read_bytes(_file_beside(document.folder, uri, f"{place}.uri"), MOST_BYTES)
    else:
        head, _, text = uri.partition(",")
        try:
            data = base64.b64decode(unquote(text), validate=True)
        except (ValueError, binascii.Error):
            data = None
        if data is None or not head.endswith(";base64"):
            raise InputError(f"{place}.uri: expected data in base64, got {shown(uri)}")
    if len(data) < length:
        raise InputError(f"{place}: expected {length} bytes, got {len(data)}")
    if sum(map(len, document.buffers.values())) + length > MOST_BYTES:
        raise InputError(f"{place}: expected buffers of at most {MOST_BYTES / 1e6:g} MB, got longer ones")
    document.buffers[index] = data[:length]
    return document.buffers[index]


def _file_beside(folder: Path, uri: str, place: str) -> Path:
    """Return the file that a URI names. Raises InputError unless it lies in the folder."""
    name = unquote(uri)
    try:
        file, home = (folder / name).resolve(), folder.resolve()
    except (OSError, ValueError, RuntimeError):  # a NUL, a circle of links
        file = home = folder
    if ":" in name or "\\" in name or file == home or not file.is_relative_to(home):
        raise InputError(f"{place}: expected a file in the same folder, got {shown(name)}")
    return folder / name


def name_of(entry: dict[str, Any], default: str) -> str:
    """Return an entry's name, or the default if it has none that can be printed."""
    name = entry.get("name")
    return name.encode("utf-8", "replace").decode() if isinstance(name, str) and name.strip() else default
