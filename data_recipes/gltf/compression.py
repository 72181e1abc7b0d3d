"""Compressed geometry of glTF files, where the optional packages that decode it are installed."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np

from replicate.base.exceptions import InputError
from replicate.base.schema import cut, shown

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
DRACO = "KHR_draco_mesh_compression"
# Filter → the strides that it takes, and the name of its decoder
FILTERS = {
    "OCTAHEDRAL": ((4, 8), "decode_filter_oct"),
    "QUATERNION": ((8,), "decode_filter_quat"),
    "EXPONENTIAL": (tuple(range(4, 253, 4)), "decode_filter_exp"),
}


def decode_meshopt(data: bytes, count: int, stride: int, mode: Any, filter: Any, place: str) -> bytes:
    """Return the bytes of count elements of stride bytes each that meshopt compressed.

    mode, filter: as the extension names them. place: the buffer view, for messages.
    Raises InputError for what can't be decoded, and where `meshoptimizer` isn't installed.
    """
    filter = "NONE" if filter is None else filter
    attributes = mode == "ATTRIBUTES" and stride % 4 == 0 and stride <= 252
    indices = mode in ("TRIANGLES", "INDICES") and stride in (2, 4) and (mode == "INDICES" or count % 3 == 0)
    if not (attributes or indices) or (filter != "NONE" and (indices or stride not in FILTERS.get(filter, ((),))[0])):
        got = f"mode {shown(mode)}, filter {shown(filter)}, {count} elements of {stride} bytes"
        raise InputError(f"{place}: expected one of meshopt's modes and filters with the strides they take, got {got}")
    try:
        import meshoptimizer
    except ImportError:
        raise _missing(MESHOPT[0], "meshoptimizer") from None
    try:
        if attributes:
            values = meshoptimizer.decode_vertex_buffer(count, stride, data).view(np.uint8).reshape(-1)
            if filter != "NONE":
                values = getattr(meshoptimizer, FILTERS[filter][1])(values, count, stride)
            return values.tobytes()
        decode = meshoptimizer.decode_index_buffer if mode == "TRIANGLES" else meshoptimizer.decode_index_sequence
        return decode(count, 4, data).astype(f"<u{stride}").tobytes()
    except Exception as error:  # whatever the package stumbles over
        raise InputError(f"{place}: can't be decoded ({cut(' '.join(str(error).split()))})") from None


def decode_draco(data: bytes, place: str) -> tuple[dict[int, np.ndarray], np.ndarray]:
    """Return the attributes of a mesh that Draco compressed, by their unique ids, and its faces (f, 3).

    Raises InputError for what can't be decoded, and where `DracoPy` isn't installed.
    """
    try:
        import DracoPy
    except ImportError:
        raise _missing(DRACO, "DracoPy") from None
    try:
        mesh = DracoPy.decode(data)
        attributes = {int(entry["unique_id"]): np.asarray(entry["data"]) for entry in mesh.attributes}
        return attributes, np.asarray(mesh.faces).astype(np.int64).reshape(-1, 3)
    except Exception as error:  # whatever the package stumbles over, also a point cloud
        raise InputError(f"{place}: can't be decoded ({cut(' '.join(str(error).split()))})") from None


def is_installed(extension: str) -> bool:
    """Return whether the package that decodes an extension is."""
    return find_spec("DracoPy" if extension == DRACO else "meshoptimizer") is not None


def _missing(extension: str, package: str) -> InputError:
    return InputError(f"it is compressed with {extension}: pip install {package}, or export it without compression")
