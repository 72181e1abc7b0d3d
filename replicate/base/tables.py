"""CSV files with declared columns, each cell of which is checked; they keep the last bit of every number.

Reading loads pandas, writing doesn't.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from replicate.base.exceptions import InputError
from replicate.base.files import write_text
from replicate.base.schema import either

if TYPE_CHECKING:
    import pandas

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

    Raises InputError, naming file and line, for anything else in the file. A file that hasn't changed is read once.
    """
    state = path.stat() if path.is_file() else None
    changes = (state.st_ino, state.st_mtime_ns, state.st_size) if state else ()
    return _read(path, changes, tuple(columns), tuple(key), missing).copy()


@lru_cache(maxsize=128)
def _read(path: Path, changes: tuple[int, ...], columns: tuple, key: tuple, missing: str) -> "pandas.DataFrame":
    import pandas

    header, *body = _rows(path, missing) or [["nothing"]]
    if header != [column.name for column in columns]:
        expected, got = (",".join(names) for names in ([column.name for column in columns], header))
        raise InputError(f"{path}, line 1: expected the header {expected!r}, got {_shorten(got)!r}")
    for line, row in enumerate(body, start=2):
        if len(row) != len(columns):
            raise InputError(f"{path}, line {line}: expected {len(columns)} cells, got {len(row)}")
    read: dict[str, list] = {}
    for place, column in enumerate(columns):
        texts = [row[place] for row in body]
        lines: dict[str, int] = {}  # where each text is first; most come again and again
        for line, text in enumerate(texts, start=2):
            lines.setdefault(text, line)
        for text, line in lines.items():
            _check(path, line, column, text)
        values = {text: _value(column, text) for text in lines}
        read[column.name] = [values[text] for text in texts]
    _check_unique(path, zip(*(read[name] for name in key), strict=True))
    return pandas.DataFrame({column.name: pandas.Series(read[column.name], dtype=column.dtype) for column in columns})


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


def _rows(path: Path, missing: str) -> list[list[str]]:
    """Return the cells of each row of a file."""
    rows, line = [], 1
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            for row in reader:
                rows.append(row)
                line = reader.line_num + 1
    except FileNotFoundError:
        raise InputError(f"{path}: {missing}") from None
    except OSError as error:
        raise InputError(f"{path} can't be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected comma-separated values ({error})") from None
    except csv.Error as error:
        raise InputError(f"{path}, line {line}: expected comma-separated values ({error})") from None
    return rows


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
