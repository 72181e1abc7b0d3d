"""A user's animation as CSV: the header names controls, every further row is a frame (24 a second)."""

import csv
import io
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from replicate.base.exceptions import InputError
from replicate.base.schema import shown
from replicate.base.user_files import read_text, shown_path

TOLERANCE = 1e-6  # of a control's range, since decimals are rounded
MOST_FRAMES = 20_000  # 14 minutes, three times what our longest character acts
MOST_LINES = 10 * MOST_FRAMES  # empty ones included
MOST_BYTES = 100_000_000  # so many frames of 350 controls, in 14 characters each


def read_clip(path: Path, controls: Sequence) -> Float32[np.ndarray, "t m"]:
    """Return the poses of a clip file; controls that it doesn't name keep their defaults.

    controls: the rig's controls in the order of p, each with name, lower, default and upper.
    Raises InputError, naming file, line and control, for a file that is missing or no CSV, an unknown or repeated
    control, a row of the wrong length, more than MOST_FRAMES frames, and a value outside its control's range.
    """
    path = Path(path)
    where = shown_path(path)
    columns = {control.name: column for column, control in enumerate(controls)}
    lines = _lines(where, read_text(path, MOST_BYTES))
    _, header = next(lines, (0, []))
    for name in header:
        if name not in columns:
            raise InputError(f"{where}: header: there is no control {shown(name)} in this rig; {_some(columns)}.")
        if header.count(name) > 1:
            raise InputError(f"{where}: the header names '{name}' {header.count(name)} times, expected once.")
    place = [columns[name] for name in header]
    default = np.array([control.default for control in controls], np.float32)
    poses = []
    for line, row in lines:
        if len(row) != len(header):
            raise InputError(f"{where}: line {line}: expected {len(header)} values, got {len(row)}.")
        if len(poses) == MOST_FRAMES:
            raise InputError(f"{where}: line {line}: expected at most {MOST_FRAMES:,} frames, got one more.")
        pose = default.copy()
        for name, column, text in zip(header, place, row, strict=True):
            pose[column] = _value(text, controls[column], f"{where}: line {line}, {name}")
        poses.append(pose)
    if not poses:
        length = "1 line" if header else "no lines"
        raise InputError(f"{where}: expected a header of controls and a row for each frame, got {length}.")
    return np.stack(poses)


def _lines(where: str, text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the cells of each line that is not empty. Raises InputError for a text that is no CSV."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for row in reader:
            if reader.line_num > MOST_LINES:
                raise InputError(f"{where}: expected at most {MOST_LINES:,} lines, got more.")
            if row:
                yield reader.line_num, [cell.strip() for cell in row]
    except csv.Error as error:
        raise InputError(f"{where}: expected CSV text, but it can't be read ({error}).") from None


def _value(text: str, control, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    slack = TOLERANCE * (control.upper - control.lower)
    if not control.lower - slack <= value <= control.upper + slack:  # True for NaN as well
        expected = f"expected a number from {control.lower:g} to {control.upper:g}"
        raise InputError(f"{where}: {expected}, got {shown(text)}.")
    return min(max(value, control.lower), control.upper)


def _some(names: Collection[str]) -> str:
    some = list(names)[:5]
    return f"there are {', '.join(some)}" + (f" and {len(names) - 5} more" if len(names) > 5 else "")
