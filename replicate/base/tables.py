"""CSV files with declared columns, each cell of which is checked; they keep the last bit of every number.

Reading loads pandas, writing doesn't.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from replicate.base.exceptions import InputError
from replicate.base.files import write_text
from replicate.base.schema import either

if TYPE_CHECKING:
    import pandas

SPARE = 20  # columns beyond those declared, so that extra cells of a line can be counted
LONGEST = 200  # characters of a file in a message
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?inf|nan", re.ASCII | re.IGNORECASE)
DIGITS = 18  # of a whole number: as many as 64 bits hold
_WHOLE_NUMBER = re.compile(rf"-?\d{{1,{DIGITS}}}", re.ASCII)


@dataclass(frozen=True)
class Column:
    """What the cells of one column may hold.

    optional: whether a cell may be empty, which means *not known*.
    choices: the texts to choose from; any text if there are none.
    """

    name: str
    kind: Literal["text", "number", "finite number", "whole number"] = "text"
    optional: bool = False
    choices: tuple[str, ...] = ()

    @property
    def dtype(self) -> str:
        """The dtype of the column in a DataFrame; whole numbers have one that can hold *not known*."""
        return {"text": "str", "whole number": "Int64"}.get(self.kind, "float64")


def read_csv(path: Path, columns: Sequence[Column], key: Sequence[str], missing: str) -> "pandas.DataFrame":
    """Read a CSV file with exactly these columns.

    key: the columns that together identify a row; without any, rows may repeat.
    missing: the message if the file isn't there, after its name.

    Raises InputError, naming file and line, for anything else in the file.
    """
    import pandas

    cells = _cells(path, len(columns), missing)
    names = [column.name for column in columns]
    header = [cell for cell in cells.iloc[0] if isinstance(cell, str)] if len(cells) else ["nothing"]
    if header != names:
        raise InputError(f"{path}, line 1: expected the header {','.join(names)!r}, got {_shorten(','.join(header))!r}")
    body = cells.iloc[1:].reset_index(drop=True)
    for line, count in enumerate(body.notna().sum(axis="columns"), start=2):
        if count != len(columns):
            raise InputError(f"{path}, line {line}: expected {len(columns)} cells, got {count}")
    read = {}
    for place, column in enumerate(columns):
        texts = body[place].tolist()
        for line, text in enumerate(texts, start=2):
            _check(path, line, column, text)
        read[column.name] = pandas.Series([_value(column, text) for text in texts], dtype=column.dtype)
    frame = pandas.DataFrame(read)
    _check_unique(path, frame[list(key)].itertuples(index=False, name=None) if key else ())
    return frame


def write_csv(path: Path, columns: Sequence[Column], lines: Iterable[Sequence], key: Sequence[str] = ()) -> None:
    r"""Write lines of values for `read_csv`; the file appears whole or not at all.

    A value of None is *not known*; floats get as many digits as they need to be read back; lines end in \n. Raises
    InputError, before it writes anything, for what `read_csv` would refuse.
    """
    rows = [[_text(value) for value in line] for line in lines]
    for line, texts in enumerate(rows, start=2):
        for column, text in zip(columns, texts, strict=True):
            _check(path, line, column, text)
    places = [place for place, column in enumerate(columns) if column.name in key]
    _check_unique(path, (tuple(texts[place] for place in places) for texts in rows) if key else ())
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([[column.name for column in columns], *rows])
    write_text(path, text.getvalue())


def _cells(path: Path, width: int, missing: str) -> "pandas.DataFrame":
    """Return a file's cells as texts, NaN where a line has no cell, with `SPARE` columns more than there should be.

    pandas' Python parser, unlike its C parser, can tell an empty cell from a missing one.
    """
    import pandas

    try:
        with open(path, encoding="utf-8", newline="") as file:
            return pandas.read_csv(
                file,
                engine="python",
                header=None,
                names=range(width + SPARE),
                index_col=False,
                dtype="str",
                na_filter=False,
                skip_blank_lines=False,
            )
    except FileNotFoundError:
        raise InputError(f"{path}: {missing}") from None
    except OSError as error:
        raise InputError(f"{path} can't be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected comma-separated values ({error})") from None
    except (csv.Error, pandas.errors.ParserError) as error:
        raise InputError(f"{path}{_broken_line(path)}: expected comma-separated values ({error})") from None


def _broken_line(path: Path) -> str:
    """Return ", line 3" if a row that begins there can't be parsed, and "" if all rows can."""
    with open(path, encoding="utf-8", newline="") as file:
        rows, line = csv.reader(file, strict=True), 1
        try:
            for _ in rows:
                line = rows.line_num + 1
        except csv.Error:
            return f", line {line}"
    return ""


def _check(path: Path, line: int, column: Column, text: str) -> None:
    if not text:
        right = column.optional
    elif column.kind == "text":
        right = not column.choices or text in column.choices
    elif column.kind == "whole number":
        right = _WHOLE_NUMBER.fullmatch(text)
    else:
        right = _NUMBER.fullmatch(text) and (column.kind == "number" or math.isfinite(float(text)))
    if not right:
        is_long = column.kind == "whole number" and re.fullmatch(r"-?\d+", text, re.ASCII)
        long = f" of at most {DIGITS} digits" if is_long else ""
        kind = column.kind if column.kind == "text" else f"a {column.kind}{long}"
        expected = either(column.choices) if column.choices else kind
        raise InputError(f"{path}, line {line}: {column.name}: expected {expected}, got {_shorten(text)!r}")


def _check_unique(path: Path, keys: Iterable[tuple]) -> None:
    earlier = set()
    for line, key in enumerate(keys, start=2):
        if key in earlier:
            raise InputError(f"{path}, line {line}: expected one row for {key}, got a second")
        earlier.add(key)


def _value(column: Column, text: str) -> str | float | int | None:
    if column.kind == "text":
        return text
    if not text:
        return None
    return int(text) if column.kind == "whole number" else float(text)


def _text(value: object) -> str:
    if value is None:
        return ""
    return repr(float(value)) if isinstance(value, float | np.floating) else str(value)


def _shorten(text: str) -> str:
    return text if len(text) <= LONGEST else text[:LONGEST] + "…"
