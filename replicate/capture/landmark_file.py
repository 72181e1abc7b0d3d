"""Recorded landmarks as CSV, one line a landmark and frame (§5.3.2): every fault is named, short gaps are filled."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from replicate.base.exceptions import InputError
from replicate.base.schema import shown
from replicate.base.tables import Column, read_csv, write_csv
from replicate.base.user_files import read_text, shown_path

if TYPE_CHECKING:
    import pandas

MOST_BYTES = 60_000_000
MOST_FRAMES = 20_000
LARGEST = 1e6  # coordinate, in mm or pixels
MM, PIXELS = "mm", "px"  # y points up in mm, down in pixels; x points to the picture's right, the face's own left
KEY = ("frame", "landmark")
SCHEMAS = {
    unit: (
        Column("frame", "whole number"),
        Column("landmark"),
        Column(f"x_{unit}", "number", optional=True),
        Column(f"y_{unit}", "number", optional=True),
    )
    for unit in (MM, PIXELS)
}


@dataclass(frozen=True)
class Recording:
    """What an actor's landmarks did. positions: (t, l, 2), x to the picture's right and y up, in `unit`, MM or PIXELS.

    filled: how many places were interpolated, of t · l. frames_per_second: as the file says, None where it doesn't.
    origin: the program that wrote it and what was assumed, in words, "" for a file of the suite's own kind.
    """

    positions: np.ndarray
    unit: str
    filled: int
    frames_per_second: float | None = None
    origin: str = ""

    def in_words(self) -> str:
        """Return what is in it, as a sentence's beginning."""
        origin = f" from {self.origin}" if self.origin else ""
        many = f"{len(self.positions)} frames of {self.positions.shape[1]} landmarks{origin}"
        return f"{many}, {self.filled} places of which are interpolated" if self.filled else many


def write_landmarks(file: Path, positions: Float[np.ndarray, "t l 2"], names: Sequence[str], unit: str) -> None:
    """Write a recording whose frames are numbered from 0.

    positions: x to the picture's right, y up in mm and down in pixels, as in the file; NaN where a landmark was not
    seen.
    """
    lines = [
        (t, name, *(None if np.isnan(value) else float(value) for value in place))
        for t, places in enumerate(positions)
        for name, place in zip(names, places, strict=True)
    ]
    write_csv(file, SCHEMAS[unit], lines, KEY)


def read_landmarks(file: Path, names: Sequence[str], longest_gap: int) -> Recording:
    """Read a recording of all landmarks, which may come in any order within a frame.

    names: of the landmarks. longest_gap: the most frames in a row over which an unseen landmark is interpolated.
    Raises InputError, naming the file and the line or the frame, for a file that is missing or no such table, for an
    unknown landmark, for frames that repeat, run backwards or lack landmarks, for a coordinate that is beyond `LARGEST`
    or alone, and for a gap that is longer or at either end.
    """
    where = shown_path(file)
    unit = _unit(where, read_text(file, MOST_BYTES))
    table = read_csv(file, SCHEMAS[unit], (), missing="there is no such file of landmarks.")
    if table.empty:
        raise InputError(f"{where}: expected {len(names)} landmarks a frame, got none.")
    _check_lines(where, table, names)
    frames = table["frame"].to_numpy(np.int64)
    first, last = int(frames[0]), int(frames[-1])
    if last - first >= MOST_FRAMES:
        raise InputError(f"{where}: expected at most {MOST_FRAMES:,} frames, got frames {first} to {last}.")
    _check_counts(where, table, names)
    places = {name: k for k, name in enumerate(names)}
    positions = np.full((last - first + 1, len(names), 2), np.nan)
    rows, columns = frames - first, table["landmark"].map(places).to_numpy()
    positions[rows, columns] = table.iloc[:, 2:].to_numpy(np.float64)
    unseen = np.isnan(positions).any(axis=2)
    check_gaps(where, unseen, first, names, longest_gap)
    positions = filled(positions, unseen)
    if unit == PIXELS:
        positions = positions * (1.0, -1.0)
    return Recording(positions, unit, int(unseen.sum()))


def _unit(where: str, text: str) -> str:
    header = text.split("\n", 1)[0].strip("\r")
    headers = {",".join(column.name for column in columns): unit for unit, columns in SCHEMAS.items()}
    if header not in headers:
        expected = " or ".join(map(repr, headers))
        raise InputError(
            f"{where}, line 1: expected the header {expected}, or that of a file of Live Link Face, OpenFace 2 or "
            f"MediaPipe, got {shown(header)}."
        )
    return headers[header]


def _check_lines(where: str, table: "pandas.DataFrame", names: Sequence[str]) -> None:
    unknown = np.flatnonzero(~table["landmark"].isin(names))
    if len(unknown):
        name, some = table["landmark"].iloc[unknown[0]], ", ".join(names[:4])
        raise InputError(
            f"{where}, line {unknown[0] + 2}: there is no landmark {shown(name)}; there are {some} and "
            f"{len(names) - 4} more, which `data_recipes/landmark_set.py` lists."
        )
    _check_coordinates(where, table)
    frames = table["frame"].to_numpy(np.int64)
    again = np.flatnonzero(table.duplicated(list(KEY)))
    if len(again):
        name = table["landmark"].iloc[again[0]]
        raise InputError(
            f"{where}, line {again[0] + 2}: {name!r} of frame {frames[again[0]]} comes a second time; leave one out."
        )
    back = np.flatnonzero(np.diff(frames) < 0)
    if len(back):
        line = back[0] + 3
        earlier, later = frames[back[0]], frames[back[0] + 1]
        raise InputError(
            f"{where}, line {line}: expected frames in rising order, got frame {later} after frame {earlier}."
        )


def _check_coordinates(where: str, table: "pandas.DataFrame") -> None:
    names, places = table.columns[2:], table.iloc[:, 2:].to_numpy(np.float64)
    beyond = np.argwhere(np.abs(places) > LARGEST)
    if len(beyond):
        line, axis = beyond[0]
        raise InputError(
            f"{where}, line {line + 2}: {names[axis]}: expected a number from {-LARGEST:,.0f} to {LARGEST:,.0f}, "
            f"got {places[line, axis]:g}."
        )
    empty = np.isnan(places)
    half = np.flatnonzero(empty[:, 0] != empty[:, 1])
    if len(half):
        lacking, given = names if empty[half[0], 0] else names[::-1]
        raise InputError(
            f"{where}, line {half[0] + 2}: {given} is there and {lacking} is not; give both, or leave both empty for a "
            "landmark that was not seen."
        )


def _check_counts(where: str, table: "pandas.DataFrame", names: Sequence[str]) -> None:
    counts = table.groupby("frame", sort=False)["landmark"].size()
    short = counts[counts < len(names)]
    if len(short):
        frame = short.index[0]
        missing = [name for name in names if name not in set(table.loc[table["frame"] == frame, "landmark"])]
        raise InputError(
            f"{where}: frame {frame} has {short.iloc[0]} of {len(names)} landmarks, and {missing[0]!r} is missing; "
            "leave the coordinates of a landmark that was not seen empty."
        )


def check_gaps(
    where: str,
    unseen: Bool[np.ndarray, "t l"],
    first: int,
    names: Sequence[str],
    longest: int,
    nothing: str = "no landmark is",
) -> None:
    """Raise InputError for a gap that is too long, or at either end.

    where: the file
    unseen: which landmark was not seen in which frame
    first: the number of the first frame
    names: of the landmarks
    longest: the most frames in a row that may be unseen
    nothing: the beginning of a sentence for frames in which nothing was seen
    """
    for k in np.flatnonzero(unseen.any(axis=0)):
        subject = nothing if unseen[unseen[:, k]].all() else f"{names[k]!r} is not"
        begins, ends = _runs(unseen[:, k])
        for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
            frames = f"frame {first + begin}" if end - begin == 1 else f"frames {first + begin} to {first + end - 1}"
            seen = f"{where}: {subject} seen in {frames}"
            if begin == 0 or end == len(unseen):
                raise InputError(f"{seen}, at the recording's end or beginning, where nothing can be interpolated.")
            if end - begin > longest:
                raise InputError(
                    f"{seen}; gaps of at most {longest} frames are interpolated ([capture] longest_gap in a CONFIG "
                    "file)."
                )


def _runs(missing: Bool[np.ndarray, " t"]) -> tuple[Int[np.ndarray, " r"], Int[np.ndarray, " r"]]:
    """Return where runs of missing frames begin, and where they have ended."""
    steps = np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8))
    return np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)


def filled(values: Float[np.ndarray, "t *l"], unseen: Bool[np.ndarray, "t *u"]) -> Float[np.ndarray, "t *l"]:
    """Return values with those that were not seen interpolated in time. unseen: by the first axes of the values."""
    import pandas

    known = np.array(values, np.float64)
    known[unseen] = np.nan
    table = pandas.DataFrame(known.reshape(len(known), -1))
    return table.interpolate(limit_area="inside").to_numpy().reshape(known.shape)
