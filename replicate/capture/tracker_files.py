"""Recordings as other programs write them (§5.3.2): Live Link Face, OpenFace 2, MediaPipe, or a CSV of our own kind.

`read_recording` tells them apart by their first line. Frames without a face, or with one that the program isn't sure
of, are gaps: short ones are interpolated, those at the ends left out.
"""

import csv
import io
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from data_recipes.catalogue import FACE_LANDMARKS, arkit_parts
from replicate.base.exceptions import InputError
from replicate.base.schema import shown
from replicate.base.spelling import nothing_named
from replicate.base.user_files import read_text, shown_path
from replicate.capture.capture_config import CaptureConfig
from replicate.capture.landmark_file import (
    LARGEST,
    MM,
    MOST_FRAMES,
    PIXELS,
    Recording,
    check_gaps,
    filled,
    read_landmarks,
)
from replicate.capture.video_landmarks import DETECTED, pixel_landmarks

MOST_BYTES = 400_000_000  # six minutes of MediaPipe's points at 30 frames a second
RATES = (24, 25, 30, 48, 50, 60, 120, 240)  # frames a second that cameras have
NEAR_RATE = 0.01  # a rate that is so near to a whole number is that


@dataclass(frozen=True)
class Weights:
    """What an actor's face did in weights of ARKit's shapes. names: k, as in the file. values: (t, k).

    head: the columns of the head's and the eyes' turns, which drive nothing. filled: how many frames were interpolated.
    """

    names: tuple[str, ...]
    values: np.ndarray
    head: tuple[str, ...]
    filled: int
    frames_per_second: float
    origin: str

    def in_words(self) -> str:
        """Return what is in it, as a sentence's beginning."""
        gaps = f", {self.filled} of which are interpolated" if self.filled else ""
        return f"{len(self.values)} frames of {len(self.names)} weights from {self.origin}{gaps}"


def read_recording(file: Path, section: CaptureConfig) -> Recording | Weights:
    """Return a recording of any program that is known here: landmarks in the order of `FACE_LANDMARKS`, or weights.

    Raises InputError, naming the file and the line or the frame, for a file of none of them, with cells that are
    missing or no number, with several faces or without any, and for gaps as `read_landmarks` does.
    """
    where, text = shown_path(file), read_text(file, MOST_BYTES)
    if text.lstrip()[:1] in ("[", "{"):
        return _mediapipe_json(where, text, section)
    header = [cell.strip() for cell in text.split("\n", 1)[0].split(",")]
    lower = {name.lower() for name in header}
    if {"timecode", "blendshapecount"} <= lower:
        return _live_link(where, text, section)
    if {"x_0", "y_0"} <= lower:
        return _openface(where, text, section)
    if {"frame", "landmark", "x", "y"} <= lower:
        return _mediapipe_csv(where, text, section)
    return read_landmarks(file, tuple(FACE_LANDMARKS), section.longest_gap)


# A table of numbers, line by line.


@dataclass(frozen=True)
class _Table:
    """The cells of a CSV file. columns: name → place. rows: texts. lines: the number of each row's line."""

    where: str
    columns: dict[str, int]
    rows: list[list[str]]
    lines: Int[np.ndarray, " r"]

    def numbers(self, names: Sequence[str], chosen: Int[np.ndarray, " c"] | None = None) -> Float[np.ndarray, "c k"]:
        """Return columns as numbers, of the chosen rows or of all. Raises InputError for a cell that is none."""
        rows = range(len(self.rows)) if chosen is None else chosen.tolist()
        places = [self.columns[name] for name in names]
        try:
            values = np.array([[float(self.rows[r][k]) for k in places] for r in rows]).reshape(len(rows), len(places))
        except ValueError:
            values = np.full((1, 1), np.nan)
        if not np.isfinite(values).all():
            for row in rows:
                for name, k in zip(names, places, strict=True):
                    if not _is_number(self.rows[row][k]):
                        found = f"{name}: expected a number, got {shown(self.rows[row][k])}"
                        raise InputError(f"{self.where}, line {self.lines[row]}: {found}")
        return values

    def whole(self, name: str) -> Int[np.ndarray, " r"]:
        """Return a column of whole numbers."""
        values = self.numbers([name])[:, 0]
        bad = np.flatnonzero((values != np.rint(values)) | (np.abs(values) > 1e9))
        if len(bad):
            found = f"{name}: expected a whole number, got {shown(self.rows[bad[0]][self.columns[name]])}"
            raise InputError(f"{self.where}, line {self.lines[bad[0]]}: {found}")
        return values.astype(np.int64)


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _table(where: str, text: str, short: Any = None) -> _Table:
    """Return the cells of a CSV file. short: (columns, row) → whether a row may be shorter than the header."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    columns: dict[str, int] = {}
    rows, lines = [], []
    try:
        header = [cell.strip() for cell in next(reader)]
        for place, name in enumerate(header):
            if name in columns:
                raise InputError(f"{where}, line 1: the column {shown(name)} is there twice, expected once")
            columns[name] = place
        for row in reader:
            if not row:
                continue
            if len(row) != len(header) and not (short and len(row) < len(header) and short(columns, row)):
                raise InputError(f"{where}, line {reader.line_num}: expected {len(header)} cells, got {len(row)}")
            rows.append(row)
            lines.append(reader.line_num)
    except csv.Error as error:
        at = f"{where}, line {reader.line_num}"
        raise InputError(f"{at}: expected comma-separated values ({error})") from None
    if not rows:
        raise InputError(f"{where}: expected a row for each frame below the header, got none")
    return _Table(where, columns, rows, np.array(lines))


# What all formats share: frames at one rate, gaps, and frames at the ends without a face.


def _on_frames(where: str, frames: Int[np.ndarray, " r"], values: Float[np.ndarray, "r *l"]) -> np.ndarray:
    """Return values frame by frame, NaN where there is none; of two in one frame the later one."""
    back = np.flatnonzero(np.diff(frames) < 0)
    if len(back):
        earlier, later = frames[back[0]], frames[back[0] + 1]
        raise InputError(f"{where}: expected frames in rising order, got frame {later} after frame {earlier}")
    if frames[-1] - frames[0] >= MOST_FRAMES:
        raise InputError(f"{where}: expected at most {MOST_FRAMES:,} frames, got frames {frames[0]} to {frames[-1]}")
    out = np.full((int(frames[-1] - frames[0]) + 1, *values.shape[1:]), np.nan)
    out[frames - frames[0]] = values
    return out


def _without_gaps(
    where: str, values: Float[np.ndarray, "t *l"], first: int, section: CaptureConfig
) -> tuple[np.ndarray, int, str]:
    """Return values without NaN, how many frames were interpolated, and words for those left out at the ends."""
    unseen = np.isnan(values).reshape(len(values), -1).any(axis=1)
    seen = np.flatnonzero(~unseen)
    if not len(seen):
        raise InputError(f"{where}: no face was found in any frame")
    start, end = int(seen[0]), int(seen[-1]) + 1
    inner = unseen[start:end]
    check_gaps(where, inner[:, None], first + start, ("face",), section.longest_gap, "no face is")
    out = len(values) - (end - start)
    words = f", {out} frame{'s' * (out > 1)} without a face at the ends left out" if out else ""
    return filled(values[start:end], inner), int(inner.sum()), words


def _rate(steps_per_second: float) -> float:
    """Return a measured number of frames a second, or the whole number that it is near to."""
    whole = round(steps_per_second)
    return float(whole) if abs(steps_per_second - whole) <= NEAR_RATE * max(whole, 1) else float(steps_per_second)


def _rate_of(where: str, frames: Int[np.ndarray, " r"], seconds: Float[np.ndarray, " r"]) -> float | None:
    """Return the frames a second of numbered frames with times; None for a single frame, or where time stands still."""
    lasts, steps = float(seconds[-1] - seconds[0]), int(frames[-1] - frames[0])
    if lasts <= 0 or steps <= 0:
        return None
    rate = _rate(steps / lasts)
    if not 1 <= rate <= 1_000:
        raise InputError(f"{where}: expected 1 to 1,000 frames a second by its times, got {rate:.3g}")
    return rate


# Live Link Face: weights of ARKit's shapes, and three turns of the head and of each eye.

TURNS = tuple(f"{part}{turn}" for part in ("Head", "LeftEye", "RightEye") for turn in ("Yaw", "Pitch", "Roll"))
LEAST_WEIGHT, MOST_WEIGHT = -0.5, 1.5  # beyond it a cell is a mistake
TIMECODE = re.compile(r"(\d+):(\d+):(\d+):(\d+)(?:\.(\d{1,4}))?")


def _live_link(where: str, text: str, section: CaptureConfig) -> Weights:
    def is_empty(columns: dict[str, int], row: list[str]) -> bool:
        return len(row) > columns["BlendShapeCount"] and row[columns["BlendShapeCount"]].strip() == "0"

    header = text.split("\n", 1)[0]
    if "Timecode" not in header or "BlendShapeCount" not in header:
        raise InputError(f"{where}, line 1: expected Timecode,BlendShapeCount, got {shown(header[:60])}")
    table = _table(where, text, is_empty)
    names = [name for name in table.columns if name not in ("Timecode", "BlendShapeCount", *TURNS)]
    for name in names:
        if not arkit_parts(name):
            expected = "expected names of ARKit's shapes, such as EyeBlinkLeft"
            raise InputError(f"{where}, line 1: {expected}, got {shown(name)}")
    if not names:
        raise InputError(f"{where}, line 1: expected a column for each of ARKit's shapes, got none")
    seen = np.array([row for row, cells in enumerate(table.rows) if not is_empty(table.columns, cells)], np.int64)
    values = np.full((len(table.rows), len(names)), np.nan)
    values[seen] = table.numbers(names, seen)
    beyond = np.argwhere((values < LEAST_WEIGHT) | (values > MOST_WEIGHT))
    if len(beyond):
        row, k = beyond[0]
        raise InputError(
            f"{where}, line {table.lines[row]}: {names[k]}: expected a weight from 0 to 1, got {values[row, k]:g}"
        )
    frames, rate = _timecodes(table)
    values, gaps, words = _without_gaps(where, _on_frames(where, frames, values), int(frames[0]), section)
    turns = tuple(name for name in TURNS if name in table.columns)
    return Weights(tuple(names), values, turns, gaps, rate, f"Live Link Face at {rate:g} frames a second{words}")


def _timecodes(table: _Table) -> tuple[Int[np.ndarray, " r"], float]:
    """Return each row's frame, from 0, and the frames a second, from hours:minutes:seconds:frames.thousandths.

    Where a recording lasts less than a second, nothing says how many frames a second has: 60, unless there are more.
    """
    parts = []
    for row, line in zip(table.rows, table.lines, strict=True):
        found = TIMECODE.fullmatch(row[table.columns["Timecode"]].strip())
        if not found:
            text = shown(row[table.columns["Timecode"]])
            raise InputError(f"{table.where}, line {line}: Timecode: expected 00:00:00:00.000, got {text}")
        parts.append([int(group or 0) for group in found.groups()])
    hours, minutes, seconds, frames, thousandths = np.array(parts, float).T
    whole_seconds = 3600 * hours + 60 * minutes + seconds
    least = max(frames.max() + 1, 60 if np.ptp(whole_seconds) == 0 else 0)
    base = next((rate for rate in RATES if rate >= least), least)
    counts = whole_seconds * base + frames
    times = counts + thousandths / 1000
    back = np.flatnonzero(np.diff(times) < 0)
    if len(back):
        raise InputError(f"{table.where}, line {table.lines[back[0] + 1]}: expected timecodes in rising order")
    rows_a_frame = round(len(counts) / len(np.unique(counts)))  # 2 for 60 pictures a second under timecodes of 30
    at = counts if rows_a_frame == 1 else np.floor(times * rows_a_frame)
    return (at - at[0]).astype(np.int64), float(base * rows_a_frame)


# OpenFace 2: 68 landmarks in pixels, or in mm of a camera, y down in both.

POINTS = 68
LEAST_CONFIDENCE = 0.5


def _openface(where: str, text: str, section: CaptureConfig) -> Recording:
    table = _table(where, text)
    axes, unit = (("x", "y"), PIXELS) if "x_0" in table.columns else (("X", "Y"), MM)
    names = [[f"{axis}_{k}" for axis in axes] for k in range(POINTS)]
    missing = [name for pair in names for name in pair if name not in table.columns]
    if missing:
        raise InputError(
            f"{where}, line 1: expected a column for each coordinate of {POINTS} landmarks, and {len(missing)} are "
            f"missing, {missing[0]} among them"
        )
    for name in table.columns:
        if re.fullmatch(r"[xyXY]_\d+", name) and int(name[2:]) >= POINTS:
            raise InputError(f"{where}, line 1: there is no landmark {name}: expected {POINTS}, from 0")
    rows = np.arange(len(table.rows))
    frames = table.whole("frame") if "frame" in table.columns else rows
    if "face_id" in table.columns:
        _check_one_face(where, table.whole("face_id"))
    seen = np.ones(len(rows), bool)
    for name, least in (("success", 1.0), ("confidence", LEAST_CONFIDENCE)):
        if name in table.columns:
            seen &= table.numbers([name])[:, 0] >= least
    chosen = [names[k] for k in FACE_LANDMARKS.values()]
    places = np.full((len(rows), len(chosen), 2), np.nan)
    flat = table.numbers([name for pair in chosen for name in pair], np.flatnonzero(seen))
    _check_coordinates(where, table, np.flatnonzero(seen), flat)
    places[seen] = flat.reshape(-1, len(chosen), 2) * (1.0, -1.0)
    rate = _rate_of(where, frames, table.numbers(["timestamp"])[:, 0]) if "timestamp" in table.columns else None
    return _recording(where, frames, places, unit, rate, section, "OpenFace 2")


def _check_one_face(where: str, faces: Int[np.ndarray, " r"]) -> None:
    several = np.unique(faces)
    if len(several) > 1:
        raise InputError(
            f"{where}: expected one face, got {len(several)}, face_id {several[0]} and {several[1]}: keep one"
        )


def _check_coordinates(where: str, table: _Table, rows: np.ndarray, values: np.ndarray) -> None:
    beyond = np.argwhere(np.abs(values) > LARGEST)
    if len(beyond):
        line, k = table.lines[rows[beyond[0, 0]]], values[tuple(beyond[0])]
        raise InputError(f"{where}, line {line}: expected coordinates up to {LARGEST:,.0f}, got {k:g}")


def _recording(
    where: str,
    frames: Int[np.ndarray, " r"],
    places: Float[np.ndarray, "r l 2"],
    unit: str,
    rate: float | None,
    section: CaptureConfig,
    program: str,
) -> Recording:
    """Return landmarks, y up, as a recording; rows of NaN are frames without a face."""
    positions, gaps, words = _without_gaps(where, _on_frames(where, frames, places), int(frames[0]), section)
    at = f" at {rate:g} frames a second" if rate else ""
    return Recording(positions, unit, gaps * positions.shape[1], rate, f"{program}{at}{words}")


# MediaPipe: 478 points, or 468 without the irises, in shares of the picture's width and height.

COUNTS = (468, DETECTED)
SHARE = 2.0  # a coordinate beyond −1 to 2 is no share of a picture
SQUARE = 1_000.0  # pixels a side of a picture whose size nobody says
CELLS = ("frame", "landmark", "x", "y", "z", "visibility", "presence", "face", "face_id", "timestamp", "timestamp_ms")
POINT_KEYS = ("landmarks", "face_landmarks", "faceLandmarks", "multi_face_landmarks", "multiFaceLandmarks")
TIME_KEYS = ("timestamp", "timestamp_ms", "timestampMs")
RATE_KEYS = ("frames_per_second", "fps")
Face = np.ndarray | None  # points (p, 2), or none in this frame


def _mediapipe_csv(where: str, text: str, section: CaptureConfig) -> Recording:
    table = _table(where, text)
    for name in table.columns:
        if name not in CELLS:
            others = f"; expected {', '.join(CELLS)}"
            raise InputError(f"{where}, line 1: {nothing_named('column', name, CELLS, others)}")
    for name in ("face", "face_id"):
        if name in table.columns:
            _check_one_face(where, table.whole(name))
    frames, points = table.whole("frame"), table.whole("landmark")
    values = table.numbers(["x", "y"])
    starts = np.flatnonzero(np.diff(frames, prepend=frames[0] - 1))
    faces: list[Face] = []
    for start, end in zip(starts, [*starts[1:], len(frames)], strict=True):
        frame, count = frames[start], end - start
        if count not in COUNTS or not np.array_equal(np.sort(points[start:end]), np.arange(count)):
            expected = f"expected points 0 to {COUNTS[0] - 1} or to {COUNTS[1] - 1}, each once"
            raise InputError(f"{where}: frame {frame}: {expected}, got {count} points")
        face = np.empty((count, 2))
        face[points[start:end]] = values[start:end]
        faces.append(face)
    times = next((table.numbers([name])[starts, 0] for name in TIME_KEYS if name in table.columns), None)
    return _mediapipe(where, frames[starts], faces, times, None, section.picture, section)


def _mediapipe_json(where: str, text: str, section: CaptureConfig) -> Recording:
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not a readable JSON file ({error})") from None
    about = tree if isinstance(tree, dict) else {}
    frames = about.get("frames") if about else tree
    if not isinstance(frames, list) or not frames:
        raise InputError(
            f'{where}: expected a list of frames, or {{"frames": […]}}, got {shown(type(frames).__name__)}'
        )
    if len(frames) > MOST_FRAMES:
        raise InputError(f"{where}: expected at most {MOST_FRAMES:,} frames, got {len(frames):,}")
    faces = [_json_face(f"{where}: frame {k}", frame) for k, frame in enumerate(frames)]
    size, rate = section.picture, None
    if "width" in about or "height" in about:
        size = tuple(_json_number(where, about.get(key), key) for key in ("width", "height"))
    for key in RATE_KEYS:
        if key in about:
            rate = _json_number(where, about[key], key)
    times = None
    for key in TIME_KEYS:
        if all(isinstance(frame, dict) and key in frame for frame in frames):
            times = np.array([_json_number(where, frame[key], key, 0.0) for frame in frames])
    return _mediapipe(where, np.arange(len(frames)), faces, times, rate, size, section)


def _json_number(where: str, value: Any, key: str, least: float = 1.0) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= 1e15:
        raise InputError(f"{where}: {key}: expected a number of at least {least:g}, got {shown(value)}")
    return float(value)


def _json_face(where: str, frame: Any) -> Face:
    """Return the points of a frame: a list of them, of faces, or either of these under a key; null for no face."""
    for _ in range(3):
        if isinstance(frame, dict):
            key = next((key for key in POINT_KEYS if key in frame), None)
            if key is None:
                raise InputError(f"{where}: expected landmarks, got the keys {shown(', '.join(map(str, frame)))}")
            frame = frame[key]
        elif isinstance(frame, list) and frame and isinstance(frame[0], (list, dict)) and not _is_point(frame[0]):
            if len(frame) > 1:
                raise InputError(f"{where}: expected one face, got {len(frame)}: keep one")
            frame = frame[0]
    if frame is None or frame == []:
        return None
    if not isinstance(frame, list) or len(frame) not in COUNTS:
        got = f"{len(frame)} points" if isinstance(frame, list) else shown(frame)
        raise InputError(f"{where}: expected {COUNTS[0]} or {COUNTS[1]} points, got {got}")
    places = [
        (point.get("x"), point.get("y")) if isinstance(point, dict) else tuple(point[:2]) if _is_point(point) else ()
        for point in frame
    ]
    for k, place in enumerate(places):
        if len(place) != 2 or any(isinstance(x, bool) or not isinstance(x, (int, float)) for x in place):
            raise InputError(f"{where}: point {k}: expected the numbers x and y, got {shown(frame[k])}")
    return np.array(places, float)


def _is_point(value: Any) -> bool:
    if isinstance(value, dict):
        return "x" in value
    return isinstance(value, list) and 2 <= len(value) <= 5 and not any(isinstance(x, (list, dict)) for x in value)


def _mediapipe(
    where: str,
    frames: Int[np.ndarray, " r"],
    faces: Iterable[Face],
    times: Float[np.ndarray, " r"] | None,
    rate: float | None,
    size: tuple[float, ...],
    section: CaptureConfig,
) -> Recording:
    faces = list(faces)
    for frame, face in zip(frames, faces, strict=True):
        if face is not None and not (np.isfinite(face) & (face >= 1 - SHARE) & (face <= SHARE)).all():
            value = face[~(np.isfinite(face) & (face >= 1 - SHARE) & (face <= SHARE))][0]
            expected = "expected shares of the picture, from 0 to 1"
            raise InputError(f"{where}: frame {frame}: {expected}, got {value:g}")
    if all(face is None for face in faces):
        raise InputError(f"{where}: no face was found in any frame")
    if rate is None and times is not None:
        in_ms = np.median(np.diff(times)) >= 1 if len(times) > 1 else True
        rate = _rate_of(where, frames, times / 1000 if in_ms else times)
    width, height = size or (SQUARE, SQUARE)
    square = ", the picture taken for square ([capture] picture = [width, height] would say its size)"
    program = f"MediaPipe{'' if size else square}"
    places = pixel_landmarks(faces, width, height) * (1.0, -1.0)
    return _recording(where, frames, places, PIXELS, rate, section, program)
