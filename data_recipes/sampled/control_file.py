"""The controls of a folder of samples, `controls.csv`: a line a control, in the order of the columns of `params`."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from data_recipes.controls import Control
from replicate.engine.exceptions import InputError
from replicate.engine.schema import naming, shown
from replicate.engine.user_files import read_text, shown_path

CONTROL_FILE = "controls.csv"
HEADER = ["name", "lower", "default", "upper", "region"]
MOST_BYTES = 4_000_000
MOST_CONTROLS = 5_000
LONGEST_NAME = 63  # bytes
FAR = 1e9  # beyond it a limit is a mistake
WITHOUT_REGION = "face"


def read_controls(folder: Path) -> tuple[Control, ...]:
    """Return the controls. Raises InputError, naming file, line and control, for anything that is not allowed."""
    file = folder / CONTROL_FILE
    where = shown_path(file)
    reader = csv.reader(io.StringIO(read_text(file, MOST_BYTES), newline=""), strict=True)
    controls: dict[str, Control] = {}
    try:
        header = next(reader, [])
        if header != HEADER:
            raise InputError(f"{where}: its first line is {shown(','.join(header))}: allowed is {','.join(HEADER)}")
        for row in reader:
            if not row:
                continue
            control = _control(row, f"{where}: line {reader.line_num}")
            if control.name in controls:
                raise InputError(f"{where}: line {reader.line_num} is the second {shown(control.name)}: allowed is one")
            controls[control.name] = control
            if len(controls) > MOST_CONTROLS:
                raise InputError(f"{where}: found more than {MOST_CONTROLS:,} controls: allowed are so many at most")
    except csv.Error as error:
        raise InputError(f"{where}: found no CSV text ({error})") from None
    if not controls:
        raise InputError(f"{where}: found no controls: allowed is one at least")
    return tuple(controls.values())


def _control(row: list[str], where: str) -> Control:
    if len(row) != len(HEADER):
        raise InputError(f"{where} has {len(row)} values: allowed are {len(HEADER)}, {','.join(HEADER)}")
    name, *texts, region = (cell.strip() for cell in row)
    for text, what, least in ((name, "name", 1), (region, "region", 0)):
        if not (text.isprintable() and least <= len(text.encode()) <= LONGEST_NAME and "," not in text):
            raise InputError(f"{where}: its {what} is {shown(text)}: allowed is one of {LONGEST_NAME} bytes at most")
    values = []
    for text, what in zip(texts, HEADER[1:4], strict=True):
        try:
            values.append(float(text))
        except ValueError:
            raise InputError(f"{where}: {what} of {shown(name)} is {shown(text)}: allowed is a number") from None
        if not abs(values[-1]) <= FAR:  # False for NaN as well
            raise InputError(f"{where}: {what} of {shown(name)} is {shown(text)}: allowed is a number up to {FAR:g}")
    with naming(where):
        return Control(name, *values, region or WITHOUT_REGION)
