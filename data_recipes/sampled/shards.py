"""The shards of a folder of samples: files of poses with their vertices, checked by their headers before any is read.

A shard is an npz, or a set of npy files NAME.params.npy, NAME.vertices.npy and so on. Nothing is ever unpickled, and an
array is allocated only once its size is known to agree with its file's.
"""

from __future__ import annotations

import math
import os
import re
import stat
import struct
import sys
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BufferedIOBase
from pathlib import Path

import numpy as np

from replicate.base.exceptions import InputError
from replicate.base.schema import cut, shown
from replicate.base.user_files import shown_path

FOLDER = "poses"
CACHE_ENDINGS = (".usd", ".usda", ".usdc", ".abc")  # of points that move over time: see point_caches.py
NEEDED, OPTIONAL = ("params", "vertices"), ("clip", "frame", "drawn")
ARRAYS = (*NEEDED, *OPTIONAL)
UNFINISHED = ".part"
MOST_FILES = 20_000
MOST_BYTES = 1_000_000_000  # of an array: it is read as a whole
LONGEST_CLIP = 100  # letters of a clip's name
KINDS = {"params": "fiu", "vertices": "f", "clip": "US", "frame": "iuf", "drawn": "b"}
WORDS = {
    "params": "numbers, floats of at most 64 bits",
    "vertices": "numbers of float16, float32 or float64",
    "clip": f"texts of at most {LONGEST_CLIP} letters",
    "frame": "whole numbers",
    "drawn": "true or false (bool)",
}
_PAIR = re.compile(r"(.+)\.(" + "|".join(ARRAYS) + r")\.npy")
DAMAGE = (OSError, EOFError, ValueError, KeyError, RuntimeError, NotImplementedError, SyntaxError, struct.error,
          tokenize.TokenError, zlib.error, zipfile.BadZipFile)  # fmt: skip


class _UnfitError(ValueError):
    """An array can be read but is not one that a shard may have."""


@dataclass(frozen=True)
class Header:
    """An array's shape and type, as its file states them."""

    shape: tuple[int, ...]
    dtype: np.dtype


@dataclass(frozen=True)
class Shard:
    """A file of poses, or several that belong together.

    name: of the file, or the NAME of several.
    files: array → its file, one npz for all of them.
    headers: by array.
    ignored: names of arrays that no shard needs.
    """

    name: str
    files: Mapping[str, Path]
    headers: Mapping[str, Header]
    ignored: tuple[str, ...] = ()

    @property
    def poses(self) -> int:
        """The number of poses."""
        return self.headers["params"].shape[0]

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files, each once."""
        return tuple(dict.fromkeys(self.files.values()))

    def read(self, name: str) -> np.ndarray:
        """Return one of its arrays. Raises InputError for a file that is damaged, or has changed since."""
        file = self.files[name]
        with _reading(file, name), _stream(file, name) as (stream, size):
            header = _header(stream, size)
            if header != self.headers[name]:
                raise ValueError("it has changed since the run was started")
            count = int(np.prod(header.shape))
            data = stream.read(count * header.dtype.itemsize + 1)
            if len(data) != count * header.dtype.itemsize:
                raise ValueError("it ends too early")
            order = "F" if _is_fortran(file, name) else "C"
            array = np.frombuffer(data, header.dtype).reshape(header.shape, order=order)
        if header.dtype.kind == "S":
            array = _decoded(array, f"{shown_path(file)}: {name}")
        if array.dtype.kind == "U":
            _check_names(array, f"{shown_path(file)}: {name}")
        return array


def shard_files(folder: Path) -> tuple[Path, ...]:
    """Return the files of shards in a folder's `poses`, sorted by name.

    Those that end in .part or begin with a dot are left out. Raises InputError, naming the file, for any other that is
    no npz, npy, point cache or table of one, or no regular file.
    """
    place = folder / FOLDER
    where = shown_path(place)
    try:
        names = sorted(entry.name for entry in os.scandir(place))
    except OSError as error:
        raise InputError(f"{where}: not a readable folder of poses ({error.strerror})") from None
    names = [name for name in names if not name.startswith(".") and not name.endswith(UNFINISHED)]
    if len(names) > MOST_FILES:
        raise InputError(f"{where}: expected at most {MOST_FILES:,} files, got {len(names):,}")
    caches = {Path(name).stem for name in names if Path(name).suffix.lower() in CACHE_ENDINGS}
    for name in names:
        is_cache = Path(name).suffix.lower() in (*CACHE_ENDINGS, ".csv") and Path(name).stem in caches
        if not (name.endswith(".npz") or _PAIR.fullmatch(name) or is_cache):
            endings = (
                "NAME.npz, NAME.params.npy with NAME.vertices.npy, NAME.usdc with NAME.csv, or a name that ends in "
            )
            endings += UNFINISHED
            raise InputError(f"{where}: expected {endings}, got {shown(name)}")
        _check_regular(place / name)
    if not names:
        raise InputError(f"{where}: expected at least one shard of poses, NAME.npz, got none")
    return tuple(place / name for name in names)


def read_shards(files: Sequence[Path], controls: int, vertices: int | None) -> tuple[Shard, ...]:
    """Return the shards that files make up, once their headers are read.

    controls, vertices: how many the rig has, None for any number. Raises InputError, naming the file and the array, for
    any other content.
    """
    groups: dict[str, dict[str, Path]] = {}
    ignored: dict[str, tuple[str, ...]] = {}
    for file in files:
        if pair := _PAIR.fullmatch(file.name):
            groups.setdefault(pair[1], {})[pair[2]] = file
        else:
            names = _names_in(file)
            groups[file.name] = dict.fromkeys(filter(ARRAYS.__contains__, names), file)
            ignored[file.name] = tuple(name for name in names if name not in ARRAYS)
            if not names:
                raise InputError(f"{shown_path(file)}: it is empty: a shard needs params and vertices")
    shards = (_shard(name, group, controls, vertices) for name, group in groups.items())
    return tuple(replace(shard, ignored=ignored.get(shard.name, ())) for shard in shards)


def _decoded(names: np.ndarray, where: str) -> np.ndarray:
    try:
        return np.char.decode(names, "utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: expected texts in UTF-8, got {shown(error.object)}") from None


def _check_names(names: np.ndarray, where: str) -> None:
    """Raise InputError for a text that can't name a clip and its files; an empty one stands for no clip."""
    expected = "expected a name of printable characters without / or \\"
    codes = names.astype(names.dtype.newbyteorder("=")).view(np.uint32).reshape(len(names), -1)
    if (codes > sys.maxunicode).any():
        raise InputError(f"{where}[{np.argwhere(codes > sys.maxunicode)[0, 0]}] is no Unicode text: {expected}")
    for name, place in zip(*np.unique(names, return_index=True), strict=True):
        if not name.isprintable() or "/" in name or "\\" in name:
            raise InputError(f"{where}[{place}] is {shown(str(name))}: {expected}")


def _check_regular(file: Path) -> None:
    try:
        mode = os.stat(file).st_mode
    except OSError as error:
        raise InputError(f"{shown_path(file)}: not a readable file ({error.strerror})") from None
    if not stat.S_ISREG(mode):
        raise InputError(f"{shown_path(file)} is no regular file: replace or remove it")


def _names_in(file: Path) -> list[str]:
    with _reading(file, ""), zipfile.ZipFile(_open(file)) as archive:
        names = [info.filename.removesuffix(".npy") for info in archive.infolist()]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"{shown_path(file)}: the array {shown(twice)} is there twice, expected once")
    return names


def _shard(name: str, files: dict[str, Path], controls: int, vertices: int | None) -> Shard:
    where = shown_path(next(iter(files.values()), Path(name)).parent / name)
    if missing := [array for array in NEEDED if array not in files]:
        raise InputError(f"{where}: it has no array {missing[0]}: a shard needs params and vertices")
    headers = {}
    for array, file in files.items():
        with _reading(file, array), _stream(file, array) as (stream, size):
            headers[array] = _header(stream, size)
    t = headers["params"].shape[0] if headers["params"].shape else 0
    shapes = {"params": (t, controls), "vertices": (t, vertices, 3)}
    if vertices is None:
        shapes["vertices"] = headers["vertices"].shape
    about = {
        "params": f": {controls} controls",
        "vertices": f": as many poses as params, {vertices} vertices of the mesh",
    }
    for array, header in headers.items():
        expectation = shapes.get(array, (t,))
        if header.shape != expectation or t == 0:
            expected = "at least one pose" if t == 0 else f"{expectation}{about.get(array, ', one for each pose')}"
            raise InputError(f"{where}: shape of {array}: expected {expected}, got {cut(str(header.shape))}")
        longest = 4 * LONGEST_CLIP if header.dtype.kind in "US" else 8
        if header.dtype.kind not in KINDS[array] or header.dtype.itemsize > longest:
            raise InputError(f"{where}: {array}: expected {WORDS[array]}, got {header.dtype}")
    if ("clip" in headers) != ("frame" in headers):
        raise InputError(f"{where}: it has only one of clip and frame: write both or neither")
    if "drawn" in headers and "clip" not in headers:
        raise InputError(f"{where}: it has drawn without clip and frame: write these too, or leave it out")
    return Shard(name, files, headers)


def _open(file: Path) -> BufferedIOBase:
    descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    return open(descriptor, "rb")


@contextmanager
def _stream(file: Path, name: str) -> Iterator[tuple[BufferedIOBase, int]]:
    """Yield a stream of an array's bytes and how many there are."""
    with _open(file) as plain:
        if not file.name.endswith(".npz"):
            yield plain, os.fstat(plain.fileno()).st_size
            return
        with zipfile.ZipFile(plain) as archive:
            info = archive.getinfo(f"{name}.npy")
            with archive.open(info) as stream:
                yield stream, info.file_size


def _read_header(stream: BufferedIOBase) -> tuple[tuple[int, ...], bool, np.dtype]:
    version = np.lib.format.read_magic(stream)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"its format is {version}")
    try:
        return readers[version](stream)
    except (tokenize.TokenError, MemoryError):  # thousands of brackets, say
        raise ValueError("its header is damaged") from None


def _header(stream: BufferedIOBase, size: int) -> Header:
    """Read the header from a stream. size: the bytes of header and array together."""
    shape, _, dtype = _read_header(stream)
    if dtype.hasobject:
        raise _UnfitError("expected numbers or texts, got Python objects: make them texts, np.array(…, dtype=str)")
    length = dtype.itemsize * math.prod(shape)
    if length > MOST_BYTES:
        raise _UnfitError(f"expected at most {MOST_BYTES / 1e9:g} GB, got {length / 1e9:.1f} GB: write smaller shards")
    if stream.tell() + length != size:
        raise ValueError("its file is shorter or longer than its header says")
    return Header(tuple(shape), dtype)


def _is_fortran(file: Path, name: str) -> bool:
    with _stream(file, name) as (stream, _):
        return _read_header(stream)[1]


@contextmanager
def _reading(file: Path, array: str) -> Iterator[None]:
    """Turn what a damaged file raises into one sentence."""
    try:
        yield
    except InputError:
        raise
    except _UnfitError as error:
        raise InputError(f"{shown_path(file)}: {array}: {error}") from None
    except DAMAGE as error:
        part = f"{array} of the shard" if array else "the shard"
        text = cut(" ".join(str(error).split())) or type(error).__name__
        raise InputError(f"{shown_path(file)}: {part} can't be read ({text}); is it half-written?") from None
