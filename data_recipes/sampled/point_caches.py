"""Point caches as samples: a USD whose points move over time, and the values of the controls in each of its frames.

The values are a table, NAME.csv beside NAME.usdc: a header of controls and a row a frame. A folder without `poses` has
one cache, and its table may be its `controls.csv`. A file that `make export` has written has the values in it.
A USD states its unit and its axes, and both are converted. Alembic states neither: Blender makes a USD of it, numbers
and all, and `face.toml` says what they are.
"""

from __future__ import annotations

import csv
import io
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64

from data_recipes.exporters.blender_python import through_blender
from data_recipes.sampled.face_file import (
    CONTROL_FILE,
    FACE_FILE,
    MM,
    STATING,
    WITHOUT_REGION,
    ControlLine,
    FaceFile,
    in_our_axes,
    read_controls,
    read_face,
)
from data_recipes.sampled.shards import CACHE_ENDINGS, FOLDER, MOST_BYTES, Header, Shard, read_shards, shard_files
from replicate.base.exceptions import InputError
from replicate.base.schema import cut, naming, shown
from replicate.base.user_files import is_file, read_bytes, read_text, shown_path

TABLE, ALEMBIC = ".csv", ".abc"
TIMES = ("frame", "time")  # a first column of a table that names the frames, as the file counts them
TIME_TOLERANCE = 1e-3
MOST_FRAMES = 20_000
TABLE_BYTES = 100_000_000
CONTROLS = "controls:"  # attributes of a file that has its controls in it
PROP = "shownOnly"  # custom data of meshes that are shown and not part of the face
UV_NAMES = ("st", "UVMap", "map1", "uv")
SEGMENT, MATERIAL = "segment", "materialBind"  # families of subsets of faces


def is_cache(file: Path) -> bool:
    """Return whether a file's name is that of a point cache."""
    return file.suffix.lower() in CACHE_ENDINGS


def states_unit(file: Path) -> bool:
    """Return whether a file states its unit and axes, by its name."""
    return file.suffix.lower() in STATING


@dataclass(frozen=True)
class Spoken:
    """What a `face.toml` says of a folder's numbers: their unit, the axis that points upwards, frames per second."""

    unit: str = "mm"
    up: str = "y"
    rate: float = 24.0


SPOKEN = Spoken()


def spoken_of(face: FaceFile) -> Spoken:
    """Return what a `face.toml` says of numbers."""
    return Spoken(face.unit, face.up, face.frames_per_second)


def lone_cache(folder: Path) -> Path | None:
    """Return the one point cache of a folder without `poses`, None for others. Raises InputError for several."""
    if (folder / FOLDER).exists() or not folder.is_dir():
        return None
    caches = sorted(file for file in folder.iterdir() if is_cache(file) and not file.name.startswith("."))
    if len(caches) > 1:
        names = cut(", ".join(file.name for file in caches))
        raise InputError(f"{shown_path(folder)}: expected one point cache, or several in {FOLDER}, got {names}")
    return caches[0] if caches else None


def face_of(folder: Path) -> FaceFile:
    """Return what a folder's `face.toml` says; a folder of one point cache may do without it.

    Raises InputError as `read_face` does.
    """
    cache = None if is_file(folder / FACE_FILE) else lone_cache(folder)
    if cache is None:
        return read_face(folder)
    if not states_unit(cache):
        said = "write a face.toml with name, unit, up and mesh"
        raise InputError(f"{shown_path(cache)}: Alembic states no unit and no axes: {said}")
    name = re.sub(r"[^\w-]+", "_", folder.name).strip("_-") or "face"
    return FaceFile(name, "mm", "y", cache.name)


def pose_files(folder: Path) -> tuple[Path, ...]:
    """Return the files of a folder's poses, tables of frames included. Raises InputError as `shard_files` does."""
    cache = lone_cache(folder)
    if cache is None:
        return shard_files(folder)
    own, common = cache.with_suffix(TABLE), folder / CONTROL_FILE
    table = own if is_file(own) and own != common else common
    return (cache, table) if is_file(table) and not _lists_controls(table) else (cache,)


def control_file(folder: Path) -> Path:
    """Return the file that says what a folder's controls are: its `controls.csv`, or its only point cache."""
    file = folder / CONTROL_FILE
    return file if is_file(file) else lone_cache(folder) or file


def controls_of(folder: Path) -> tuple[ControlLine, ...]:
    """Return a folder's controls: a line each of its `controls.csv`, or those of its only point cache.

    A table of frames says only their names: they are 0 at rest, and frames decide their limits. Raises InputError for
    a table that is wrong, and where there is none.
    """
    cache, file = lone_cache(folder), folder / CONTROL_FILE
    if cache is None or (is_file(file) and _lists_controls(file)):
        return read_controls(folder)
    table = next((other for other in pose_files(folder) if other != cache), None)
    if table is not None:
        return tuple(ControlLine(name, np.nan, 0.0, np.nan, WITHOUT_REGION) for name in _read_table(table).names)
    found = open_cache(cache).table
    if found is None:
        raise InputError(_without_values(cache))
    return found.lines


def _without_values(cache: Path) -> str:
    names = f"{cache.with_suffix(TABLE).name} or {CONTROL_FILE}"
    return f"{shown_path(cache)}: nothing says what the controls are in its frames: write {names}, a row a frame"


def _lists_controls(file: Path) -> bool:
    """Return whether a table has a line a control and not a row a frame."""
    first = re.split(r"[\r\n]", read_text(file, TABLE_BYTES), maxsplit=1)[0]
    return {"name", "default"} <= {cell.strip().lower() for cell in re.split(r"[,;\t]", first)}


# Tables of frames.


@dataclass(frozen=True)
class FrameTable:
    """The controls of some frames.

    names, values: (t, m).
    times: of the frames, as a column of the table says, or None.
    lines: what is said of the controls besides.
    """

    names: tuple[str, ...]
    values: Float32[np.ndarray, "t m"]
    times: Float64[np.ndarray, " t"] | None = None
    lines: tuple[ControlLine, ...] = ()


def _read_table(file: Path) -> FrameTable:
    """Read a header of controls and a row a frame; cells are separated as those of `controls.csv` may be."""
    where, text = shown_path(file), read_text(file, TABLE_BYTES)
    separator = max(",;\t", key=re.split(r"[\r\n]", text, maxsplit=1)[0].count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True, strict=True)
    rows: list[list[float]] = []
    try:
        header = [cell.strip() for cell in next(reader, [])]
        if twice := next((name for name in header if header.count(name) > 1), None):
            raise InputError(f"{where}: the header names {shown(twice)} {header.count(twice)} times, expected once")
        for row in reader:
            if not any(cell.strip() for cell in row):
                continue
            place = f"{where}: line {reader.line_num}"
            if len(row) != len(header):
                raise InputError(f"{place}: expected {len(header)} values, got {len(row)}")
            if len(rows) == MOST_FRAMES:
                raise InputError(f"{place}: expected at most {MOST_FRAMES:,} frames, got one more")
            rows.append(
                [_number(cell, separator != ",", f"{place}: {name}") for name, cell in zip(header, row, strict=True)]
            )
    except csv.Error as error:
        raise InputError(f"{where}: expected CSV text, but it can't be read ({error})") from None
    timed = bool(header) and header[0].lower() in TIMES
    names = tuple(header[timed:])
    if not rows or not names:
        raise InputError(f"{where}: expected a header of controls and a row for each frame, got {len(rows)} rows")
    values = np.array(rows, np.float64)
    return FrameTable(names, values[:, timed:].astype(np.float32), values[:, 0] if timed else None)


def _number(text: str, decimal_comma: bool, where: str) -> float:
    try:
        value = float(text.replace(",", ".") if decimal_comma else text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{where}: expected a number, got {shown(text)}")
    return value


# Files.


@dataclass(frozen=True)
class CacheMesh:
    """A file's meshes as one, its polygons as they are.

    vertices: at rest.
    uv, uv_polygons: texture coordinates, and those of each polygon's corners, −1 for none.
    labels: group and material of each polygon.
    members: group → its vertices, where the file says so.
    remarks: sentences on what was left out or taken for something.
    """

    vertices: Float64[np.ndarray, "n 3"]
    uv: list[list[float]]
    polygons: list[list[int]]
    uv_polygons: list[list[int]]
    labels: list[tuple[str, str]]
    members: dict[str, list[int]]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class PointCache:
    """An open file.

    stage, meshes: as USD has them.
    counts: of the vertices of each mesh.
    times: at which something moves, as the file counts frames; some programs leave out frames in which nothing does.
    span: the first and the last frame.
    table: the controls in its frames, or None if it says nothing of them.
    spoken: what its vertices are read in.
    props: how many meshes are left out, since they are only shown.
    """

    file: Path
    stage: Any
    meshes: tuple[Any, ...]
    counts: tuple[int, ...]
    times: tuple[float, ...]
    span: tuple[float, float]
    table: FrameTable | None
    spoken: Spoken
    props: int

    def at(self, time: float | None) -> Float64[np.ndarray, "n 3"]:
        """Return the vertices at a time, None for those at rest, in the unit and axes of `spoken`.

        Raises InputError for a frame with another number of vertices.
        """
        from pxr import Usd, UsdGeom

        code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
        transforms, parts = UsdGeom.XformCache(code), []
        for mesh, count in zip(self.meshes, self.counts, strict=True):
            points = np.asarray(mesh.GetPointsAttr().Get(code) or np.empty((0, 3)), np.float64)
            if len(points) != count:
                when = "at rest" if time is None else f"at frame {time:g}"
                place = f"{shown_path(self.file)}: mesh {shown(_label(mesh))} {when}"
                raise InputError(f"{place}: expected {count} vertices as in the other frames, got {len(points)}")
            matrix = np.array(transforms.GetLocalToWorldTransform(mesh.GetPrim()))
            parts.append(points @ matrix[:3, :3] + matrix[3, :3])
        up = "z" if UsdGeom.GetStageUpAxis(self.stage) == UsdGeom.Tokens.z else "y"
        metres = in_our_axes(np.concatenate(parts), up) * UsdGeom.GetStageMetersPerUnit(self.stage)
        if not states_unit(self.file):
            return metres  # Blender takes its numbers for metres
        x, y, z = (metres * (1000.0 / MM[self.spoken.unit])).T
        return np.stack([x, -z, y] if self.spoken.up == "z" else [x, y, z], axis=1)


def open_cache(file: Path, spoken: Spoken = SPOKEN) -> PointCache:
    """Open a point cache; a process reads the same file once.

    Raises InputError, naming the file, where usd-core (or for Alembic, Blender) is missing, and for a file that is
    damaged, refers to others, has no mesh, or whose faces change.
    """
    try:
        facts = file.stat()
    except OSError as error:
        raise InputError(f"{shown_path(file)} can't be read ({error.strerror})") from None
    return _open(file, spoken, facts.st_mtime_ns, facts.st_size)


@lru_cache(maxsize=8)
def _open(file: Path, spoken: Spoken, _changed: int, _size: int) -> PointCache:
    where = shown_path(file)
    if not is_file(file):
        raise InputError(f"{where}: expected a regular file")
    try:
        from pxr import Tf, Usd, UsdGeom, UsdSkel
    except ImportError:
        sentence = "USD files need the package usd-core, of the extra `usd`: python -m pip install usd-core"
        raise InputError(f"{where}: {sentence}") from None
    try:
        layer = _layer(file, spoken)
        others = sorted(layer.GetCompositionAssetDependencies()) if layer else []
        if others:
            remedy = "write one file with everything in it, as `usdcat --flatten` does"
            raise InputError(f"{where}: it refers to other files, {cut(', '.join(map(str, others)))}: {remedy}")
        stage = Usd.Stage.Open(layer) if layer else None
    except Tf.ErrorException:
        stage = None
    if stage is None:
        raise InputError(f"{where}: not a readable USD file; is it half-written?")
    # what blend shapes and joints do becomes points, beside the file's content
    session = stage.GetSessionLayer()
    session.timeCodesPerSecond = stage.GetTimeCodesPerSecond()  # else frames would be at other times
    stage.SetEditTarget(session)
    if any(prim.IsA(UsdSkel.Root) for prim in stage.Traverse()):
        UsdSkel.BakeSkinning(stage.Traverse())
    meshes, props = [], 0
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Mesh) and _is_shown(prim):
            props += bool(prim.GetCustomDataByKey(PROP))
            meshes += [] if prim.GetCustomDataByKey(PROP) else [UsdGeom.Mesh(prim)]
    if not meshes:
        raise InputError(f"{where}: expected a mesh, got none")
    times = sorted({time for mesh in meshes for time in _times(mesh)})
    first = Usd.TimeCode(times[0]) if times else Usd.TimeCode.Default()
    for mesh in meshes:
        _check_faces(mesh, where)
    counts = tuple(len(mesh.GetPointsAttr().Get(first) or ()) for mesh in meshes)
    span = (times[0], times[-1]) if times else (0.0, 0.0)
    if times and stage.HasAuthoredTimeCodeRange():
        span = (min(span[0], stage.GetStartTimeCode()), max(span[1], stage.GetEndTimeCode()))
    table = _table_in(stage, where)
    return PointCache(file, stage, tuple(meshes), counts, tuple(times), span, table, spoken, props)


def _layer(file: Path, spoken: Spoken) -> Any:
    """Return a file's content as USD; by its name, a layer that has changed since would be an old one."""
    from pxr import Sdf

    if states_unit(file):
        return Sdf.Layer.OpenAsAnonymous(str(file))
    data = read_bytes(file, MOST_BYTES)
    with tempfile.TemporaryDirectory() as folder, naming(shown_path(file)):
        made = Path(folder) / "made.usdc"
        made.write_bytes(through_blender(data, ALEMBIC, made.suffix, spoken.rate))
        layer = Sdf.Layer.CreateAnonymous(made.suffix)
        layer.TransferContent(Sdf.Layer.OpenAsAnonymous(str(made)))
        return layer


def _is_shown(prim: Any) -> bool:
    from pxr import UsdGeom

    shown_ = UsdGeom.Imageable(prim)
    purposes = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
    return shown_.ComputePurpose() in purposes and shown_.ComputeVisibility() != UsdGeom.Tokens.invisible


def _times(mesh: Any) -> list[float]:
    """Return the times at which a mesh's points, or where they are, are stated."""
    from pxr import UsdGeom

    times, prim = list(mesh.GetPointsAttr().GetTimeSamples()), mesh.GetPrim()
    while prim and not prim.IsPseudoRoot():
        if place := UsdGeom.Xformable(prim):
            times += place.GetTimeSamples()
        prim = prim.GetParent()
    return times


def _check_faces(mesh: Any, where: str) -> None:
    for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()):
        times = attribute.GetTimeSamples()
        for time in times[1:]:
            if not np.array_equal(attribute.Get(time), attribute.Get(times[0])):
                place = f"{where}: mesh {shown(_label(mesh))}"
                raise InputError(
                    f"{place}: its faces at frame {time:g} are others than at frame {times[0]:g}, expected one topology"
                )


def _label(prim: Any) -> str:
    prim = prim.GetPrim()
    return prim.GetDisplayName() or prim.GetName()


def _table_in(stage: Any, where: str) -> FrameTable | None:
    """Return the controls that a file has in it, as `make export` writes them, or None."""
    root = stage.GetDefaultPrim()
    names = root.GetAttribute(f"{CONTROLS}names").Get() if root else None
    if not names:
        return None
    values = root.GetAttribute(f"{CONTROLS}values")
    times = values.GetTimeSamples()
    rows = [values.Get(time) for time in times]
    numbers = {key: root.GetAttribute(CONTROLS + key).Get() for key in ("lower", "default", "upper")}
    regions = root.GetAttribute(f"{CONTROLS}regions").Get() or [WITHOUT_REGION] * len(names)
    columns = [*rows, *numbers.values(), regions]
    if any(column is None or len(column) != len(names) for column in columns):
        expected = f"{CONTROLS}values, {CONTROLS}lower, {CONTROLS}default and {CONTROLS}upper for each of them"
        raise InputError(f"{where}: it names {len(names)} controls: expected {expected}")
    lines = zip(names, *numbers.values(), regions, strict=True)
    return FrameTable(
        tuple(names),
        np.array(rows, np.float32).reshape(-1, len(names)),
        np.array(times, np.float64),
        tuple(ControlLine(str(name), *map(float, limits), str(region)) for name, *limits, region in lines),
    )


def mesh_of(file: Path, spoken: Spoken = SPOKEN) -> CacheMesh:
    """Return the mesh of a point cache at rest: with the points that the file states for no time, else the first frame.

    Raises InputError as `open_cache` does.
    """
    cache = open_cache(file, spoken)
    where, remarks = shown_path(file), []
    at_rest = not cache.times or all(mesh.GetPointsAttr().Get() is not None for mesh in cache.meshes)
    at_rest &= not cache.times or states_unit(file)  # Alembic has no points at rest
    if not at_rest:
        remarks.append(f"{where}: it states no points at rest: its first frame is taken for the neutral pose")
    if cache.props:
        remarks.append(f"{where}: meshes that are only shown, left out: {cache.props}")
    found = CacheMesh(cache.at(None if at_rest else cache.times[0]), [], [], [], [], {}, tuple(remarks))
    first = 0
    for mesh, count in zip(cache.meshes, cache.counts, strict=True):
        _add_faces(mesh, first, found, where)
        first += count
    return found


def _add_faces(mesh: Any, first: int, found: CacheMesh, where: str) -> None:
    """Add the faces of a mesh, whose vertices begin at `first`."""
    from pxr import Usd, UsdGeom, UsdShade

    start = Usd.TimeCode.EarliestTime()
    lengths = np.asarray(mesh.GetFaceVertexCountsAttr().Get(start) or (), np.int64)
    corners = np.asarray(mesh.GetFaceVertexIndicesAttr().Get(start) or (), np.int64)
    if lengths.sum() != len(corners) or (lengths < 0).any():
        raise InputError(
            f"{where}: mesh {shown(_label(mesh))}: its faces have {lengths.sum()} corners, got {len(corners)}"
        )
    places = _uv_places(mesh, corners, found)
    ends = np.cumsum(lengths)
    turn = -1 if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded else 1
    material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    labels = [[_label(mesh), material.GetPrim().GetName() if material else ""] for _ in lengths]
    names = []
    for subset in UsdGeom.Subset.GetAllGeomSubsets(mesh):
        if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face:
            continue
        family, faces = subset.GetFamilyNameAttr().Get(), subset.GetIndicesAttr().Get(start) or ()
        material, _ = UsdShade.MaterialBindingAPI(subset).ComputeBoundMaterial()
        names += [_label(subset)] if family == SEGMENT else []
        for face in faces:
            if not 0 <= face < len(labels):
                expected = f"expected faces from 0 to {len(labels) - 1}, got {face}"
                raise InputError(f"{where}: subset {shown(_label(subset))}: {expected}")
            if family == MATERIAL:
                labels[face][1] = material.GetPrim().GetName() if material else _label(subset)
            else:
                labels[face][0] = _label(subset)
    of_vertex = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(SEGMENT)
    segment = np.asarray((of_vertex.Get() if of_vertex else None) or (), np.int64)
    for k, name in enumerate(names):
        found.members.setdefault(name, []).extend((np.flatnonzero(segment == k) + first).tolist())
    for label, end, length in zip(labels, ends, lengths, strict=True):
        found.polygons.append((corners[end - length : end][::turn] + first).tolist())
        found.uv_polygons.append(places[end - length : end][::turn].tolist())
        found.labels.append((label[0], label[1]))


def _uv_places(mesh: Any, corners: np.ndarray, found: CacheMesh) -> np.ndarray:
    """Add a mesh's texture coordinates; return those of each corner, −1 where it has none."""
    from pxr import UsdGeom

    primvars = {primvar.GetPrimvarName(): primvar for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues()}
    pairs = [name for name, primvar in primvars.items() if str(primvar.GetTypeName()).startswith("texCoord2")]
    name = next((name for name in (*UV_NAMES, *pairs) if name in primvars), None)
    none = np.full(len(corners), -1)
    if name is None:
        return none
    values, first = np.asarray(primvars[name].Get(), np.float64), len(found.uv)
    if values.ndim != 2 or values.shape[1] != 2:
        return none
    interpolation, indices = primvars[name].GetInterpolation(), primvars[name].GetIndices()
    indices = np.asarray(indices, np.int64) if indices else np.arange(len(values))
    if interpolation in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
        indices = indices[corners] if len(corners) and corners.max() < len(indices) else np.empty(0, np.int64)
    if len(indices) != len(corners) or (len(indices) and not 0 <= indices.min() <= indices.max() < len(values)):
        return none
    found.uv.extend(values.tolist())
    return indices + first


# Caches as shards.


@dataclass(frozen=True)
class CacheShard(Shard):
    """A point cache as a shard: a clip of its name. spoken: what its vertices are read in."""

    values: np.ndarray = field(default_factory=lambda: np.empty((0, 0), np.float32))
    times: tuple[float, ...] = ()
    spoken: Spoken = SPOKEN

    def read(self, name: str) -> np.ndarray:
        """Return one of its arrays. Raises InputError for a file that is damaged, or has changed since."""
        t = len(self.values)
        if name == "params":
            return self.values
        if name == "clip":
            return np.full(t, self.files["vertices"].stem)
        if name == "frame":
            return np.arange(t)
        cache = open_cache(self.files["vertices"], self.spoken)
        shape = self.headers["vertices"].shape
        if sum(cache.counts) != shape[1] or not cache.times or cache.span[1] < self.times[-1] - TIME_TOLERANCE:
            raise InputError(f"{shown_path(cache.file)}: it has changed since the run was started")
        vertices = np.empty(shape, np.float32)
        for k, time in enumerate(self.times):
            vertices[k] = cache.at(time)
        return vertices


def shards_of(
    files: Sequence[Path], lines: Sequence[ControlLine], vertices: int | None, spoken: Spoken = SPOKEN
) -> tuple[Shard, ...]:
    """Return the shards that files make up, point caches last.

    files: as `pose_files` gives them
    lines: the controls
    vertices: how many the mesh has, None for any number
    spoken: what vertices of caches are read in

    Raises InputError, naming the file, for a table that has other controls or other frames, and as `read_shards` does.
    """
    caches = [file for file in files if is_cache(file)]
    tables = [file for file in files if file.suffix.lower() == TABLE]
    others = [file for file in files if file not in caches and file not in tables]
    found = list(read_shards(others, len(lines), vertices))
    for cache in caches:
        table = next((file for file in tables if file.stem == cache.stem or len(caches) == 1), None)
        found.append(_cache_shard(cache, table, lines, vertices, spoken))
    return tuple(found)


def _cache_shard(
    file: Path, table_file: Path | None, lines: Sequence[ControlLine], vertices: int | None, spoken: Spoken
) -> CacheShard:
    cache = open_cache(file, spoken)
    table = cache.table if table_file is None else _read_table(table_file)
    if table is None:
        raise InputError(_without_values(file))
    where, n = shown_path(file), sum(cache.counts)
    times = _frames(cache, table, where if table_file is None else shown_path(table_file))
    t, of_table = len(times), where if table_file is None else shown_path(table_file)
    if vertices is not None and n != vertices:
        raise InputError(f"{where}: expected {vertices} vertices of the mesh, got {n}")
    if 12 * t * n > MOST_BYTES:
        least = -(-12 * t * n // MOST_BYTES)
        raise InputError(f"{where}: expected at most {MOST_BYTES / 1e9:g} GB of points: write {least} files")
    columns = {line.name: k for k, line in enumerate(lines)}
    for name in table.names:
        if name not in columns:
            raise InputError(f"{of_table}: there is no control {shown(name)} in this folder")
    values = np.tile(np.array([line.default for line in lines], np.float32), (t, 1))
    values[:, [columns[name] for name in table.names]] = table.values
    headers = {
        "params": Header(values.shape, values.dtype),
        "vertices": Header((t, n, 3), np.dtype(np.float32)),
        "clip": Header((t,), np.dtype(f"U{max(len(file.stem), 1)}")),
        "frame": Header((t,), np.dtype(np.int64)),
    }
    files = {"vertices": file, "params": table_file or file}
    return CacheShard(file.name, files, headers, (), values, times, spoken)


def _frames(cache: PointCache, table: FrameTable, where: str) -> tuple[float, ...]:
    """Return the times of a table's rows: those that it states, or that something moves at, or all whole frames.

    where: the table, for messages.
    """
    if not cache.times:
        raise InputError(f"{shown_path(cache.file)}: expected points that move over time, got a still mesh")
    (first, last), rows, name = cache.span, len(table.values), cache.file.name
    if table.times is not None:
        off = np.flatnonzero(~((table.times >= first - TIME_TOLERANCE) & (table.times <= last + TIME_TOLERANCE)))
        if len(off):
            expected = f"expected a frame of {name}, from {first:g} to {last:g}"
            raise InputError(f"{where}: row {off[0] + 1}: {expected}, got {table.times[off[0]]:g}")
        return tuple(table.times.tolist())
    if rows == len(cache.times):
        return cache.times
    if rows == int(last - first) + 1:
        return tuple(first + k for k in range(rows))
    raise InputError(f"{where}: expected a row for each of the {len(cache.times)} frames of {name}, got {rows}")
