"""A user's own animation as CSV: the header names controls, every further row is a frame (24 a second)."""

import csv
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from replicate.engine.exceptions import InputError

TOLERANCE = 1e-6  # of a control's range, for what is lost in writing decimals


def read_clip(path: Path, controls: Sequence) -> Float32[np.ndarray, "t m"]:
    """Return the poses of a clip file; controls that it doesn't name keep their defaults.

    controls: the rig's controls in the order of p, each with name, lower, default and upper.
    Raises InputError, naming file, line and control, for a file that is missing or no CSV, an unknown or repeated
    control, a row of the wrong length, and a value that is no finite number within the control's range.
    """
    header, rows = _read(Path(path))
    columns = {control.name: column for column, control in enumerate(controls)}
    for name in header:
        if name not in columns:
            raise InputError(f"{path}: '{name}' in the header is no control of this rig; allowed are {_some(columns)}.")
        if header.count(name) > 1:
            raise InputError(f"{path}: the header names '{name}' {header.count(name)} times, where once is allowed.")
    poses = np.tile(np.array([control.default for control in controls], dtype=np.float32), (len(rows), 1))
    for frame, (line, row) in enumerate(rows):
        if len(row) != len(header):
            raise InputError(f"{path}: line {line} has {len(row)} values, where {len(header)} are allowed.")
        for name, text in zip(header, row, strict=True):
            control = controls[columns[name]]
            poses[frame, columns[name]] = _value(text, control, f"{path}: line {line}, {name}")
    return poses


def _read(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
        reader = csv.reader(text.splitlines(), strict=True)
        lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if row]
    except OSError as error:
        raise InputError(f"{path}: found no readable file ({error.strerror}).") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: found no CSV text ({error}).") from error
    if len(lines) < 2:
        raise InputError(f"{path}: found {len(lines)} lines, where a header of controls and a row a frame are allowed.")
    return lines[0][1], lines[1:]


def _value(text: str, control, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    slack = TOLERANCE * (control.upper - control.lower)
    if not control.lower - slack <= value <= control.upper + slack:  # True for NaN as well
        allowed = f"numbers from {control.lower:g} to {control.upper:g} are allowed"
        raise InputError(f"{where} is {text!r}, where {allowed}.")
    return min(max(value, control.lower), control.upper)


def _some(names: Collection[str]) -> str:
    shown = list(names)[:5]
    return ", ".join(shown) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
