"""The posing page as one HTML file (§5.3.1): arrays packed as text, and the parts of the page around them."""

import base64
import gzip
import html
import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template

import numpy as np

from replicate.base.exceptions import InputError
from replicate.methods import coarse, refined, regional

EVALUATED = (regional.METHOD.name, coarse.METHOD.name, refined.METHOD.name)  # methods that the JavaScript evaluates

Parts = tuple[dict, dict[str, np.ndarray]]  # words for the header, and arrays by name
KINDS = ("float32", "float16", "uint32", "int16", "uint16", "int8", "uint8")
ALIGNMENT = 4  # bytes: where an array begins, so that a page can look at it in place
HIGHEST_LEVEL = 9


def packed(header: Mapping[str, object], arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return words and arrays as gzip; the same ones give the same bytes.

    It holds the length of the header in bytes (little-endian, 32 bits), the header as JSON with a list "arrays" of
    name, kind and shape, and the arrays one after the other. All begin at multiples of `ALIGNMENT`. Arrays of 16 bits
    have all their lower bytes first, then the upper ones, which are more alike: that saves a twentieth.
    Raises InputError for an array of another kind than `KINDS`.
    """
    for name, array in arrays.items():
        if array.dtype.name not in KINDS:
            raise InputError(f"array {name!r}: expected one of {', '.join(KINDS)}, got {array.dtype.name}")
    entries = [{"name": name, "kind": a.dtype.name, "shape": list(a.shape)} for name, a in arrays.items()]
    text = json.dumps({**header, "arrays": entries}, separators=(",", ":")).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    parts = [struct.pack("<I", len(text)), text]
    for array in arrays.values():
        data = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()
        data = np.frombuffer(data, np.uint8).reshape(-1, 2).T.tobytes() if array.itemsize == 2 else data
        parts.append(data + bytes(-len(data) % ALIGNMENT))
    return gzip.compress(b"".join(parts), HIGHEST_LEVEL, mtime=0)


def as_text(data: bytes) -> str:
    """Return bytes as base64."""
    return base64.b64encode(data).decode("ascii")


def indices(values: np.ndarray, below: int) -> np.ndarray:
    """Return whole numbers from 0 to below a limit in 16 bits where they fit, else in 32."""
    return np.asarray(values).astype(np.uint16 if below <= 1 << 16 else np.uint32)


# The page to pose in (§5.3.1): one HTML file with style, script and data, which opens from disk and loads nothing.

FRONT = Path(__file__).parent / "front"
TEMPLATE, STYLES = FRONT / "page.html", (FRONT / "poser.css", FRONT / "page.css")
SCRIPTS = tuple(
    FRONT / f"{name}.js"
    for name in (
        "packed", "networks", "regional", "maps", "face", "display", "pose", "pose_files", "drags", "view", "points",
        "panel", "poser",
    )
)  # fmt: skip
CHECKS = FRONT / "self_test.js"
SOURCES = (TEMPLATE, *STYLES, *SCRIPTS, CHECKS)  # what a page depends on beside its data
ABOUT = (
    "Drag a red dot: small networks (inverse kinematics, §4 of Fast and Deep Facial Deformations) find values of "
    "{controls} controls, and an approximation of the rig, {approximation}, turns these into {vertices:,} "
    "vertices. Nothing leaves this page."
)


def page(header: Mapping[str, object], arrays: Mapping[str, np.ndarray], provenance: str) -> str:
    """Return the HTML of a page to pose a face in.

    header, arrays: its contents. provenance: where it comes from, in a sentence.
    """
    counts = {"controls": len(header["controls"]), "vertices": len(arrays["neutral"])}
    about = ABOUT.format(approximation=header["approximation"], **counts)
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=html.escape(f"Pose the {header['character']}"),
        about=html.escape(about),
        provenance=html.escape(provenance),
        style=joined(STYLES),
        packed=as_text(packed(header, arrays)),
        script=joined((*SCRIPTS, CHECKS)),
    )


def joined(files: Sequence[Path]) -> str:
    """Return the text of some files, one after the other; that of `SCRIPTS` defines `mountPoser`."""
    return "\n".join(file.read_text(encoding="utf-8") for file in files)
