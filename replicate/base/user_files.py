"""What users type and the files that they bring: lists of words, numbers, paths, TOML and CSV."""

import os
import shlex
import stat
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from replicate.base.exceptions import InputError
from replicate.base.paths import LONGEST_NAME
from replicate.base.schema import LONGEST, cut, shown

TOML_BYTES = 100_000  # of a recipe or a configuration; ours have 2 to 6 KB
MOST_DOTS = 200  # of a line: the time to read a key grows with the square of its parts
MOST_TABLES = 8  # one within the other

BESIDE = ".0000000.part"  # what the name of a half-written file is longer by

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def read_bytes(file: Path, most_bytes: int) -> bytes:
    """Return a file's contents. Raises InputError for a missing or unreadable one, for what is no regular file
    and for more than `most_bytes`."""
    name = shown_path(file)
    try:
        _check_regular(os.stat(file).st_mode, name)  # first by name: to open some devices does something
        descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with open(descriptor, "rb") as stream:
            _check_regular(os.fstat(descriptor).st_mode, name)
            data = stream.read(most_bytes + 1)
    except FileNotFoundError:
        raise InputError(f"{name}: there is no such file") from None
    except OSError as error:
        raise InputError(f"{name}: found no readable file ({error.strerror})") from None
    except InputError:
        raise
    except ValueError as error:  # a NUL, or what no file system can encode
        raise InputError(f"{name}: no file can have this name ({error})") from None
    if len(data) > most_bytes:
        raise InputError(f"{name}: the file is too long: allowed are {most_bytes / 1e6:g} MB")
    return data


def _check_regular(mode: int, name: str) -> None:
    if not stat.S_ISREG(mode):
        raise InputError(f"{name} is {_KINDS.get(stat.S_IFMT(mode), 'no regular file')}: allowed is a regular file")


def read_text(file: Path, most_bytes: int) -> str:
    """Return a file's text, UTF-8 with or without a byte order mark. Raises InputError as `read_bytes` does, and for
    bytes that are no UTF-8."""
    data = read_bytes(file, most_bytes)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{shown_path(file)}: found bytes that are no UTF-8 at {error.start}") from None


def read_toml(file: Path) -> dict[str, Any]:
    """Return a TOML file's table.

    Raises InputError as `read_text` does, for what is no TOML, and for keys that are longer or deeper than any has to
    be.
    """
    text = read_text(file, TOML_BYTES)
    for number, line in enumerate(text.split("\n"), 1):
        if (dots := line.count(".")) > MOST_DOTS:
            allowed = f"expected at most {MOST_DOTS}, with keys of a few parts and numbers line by line"
            raise InputError(f"{shown_path(file)}: line {number} has {dots:,} dots: {allowed}")
    try:
        table = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{shown_path(file)}: not a readable TOML file (it is nested too deeply)") from None
    except ValueError as error:  # also whole numbers of more digits than Python reads
        raise InputError(f"{shown_path(file)}: not a readable TOML file ({cut(str(error))})") from None
    _check_keys(table, shown_path(file))
    return table


def _check_keys(table: dict[str, Any], name: str, depth: int = 1) -> None:
    if depth > MOST_TABLES:
        raise InputError(f"{name}: its tables are nested more than {MOST_TABLES} deep: expected a few")
    for key, value in table.items():
        if len(key) > LONGEST:
            raise InputError(f"{name}: the key {cut(key)} has {len(key):,} characters: expected at most {LONGEST}")
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, dict):
                _check_keys(inner, name, depth + 1)


def is_file(file: Path) -> bool:
    """Tell whether there is a regular file of this name; a name that no file can have is none."""
    try:
        return stat.S_ISREG(os.stat(file).st_mode)
    except (OSError, ValueError):
        return False


def check_output_file(file: Path) -> None:
    """Raise InputError where no regular file can be written: a folder, device or pipe is there, or the name is none."""
    name = shown_path(file)
    if "\0" in str(file) or len(os.fsencode(file.name)) > LONGEST_NAME - len(BESIDE):
        raise InputError(f"{name}: no file can have this name, name another file")
    try:
        _check_regular(os.stat(file).st_mode, name)
    except FileNotFoundError:
        pass
    except OSError as error:
        raise InputError(f"{name} can't be written ({error.strerror}): name another file") from None


def shown_path(file: Path) -> str:
    """Return a path as a sentence can hold it: as it is, or quoted and cut if it is no printable name."""
    text = str(file)
    return text if text.isprintable() and len(text) <= 4 * LONGEST_NAME else shown(text)


def as_whole_number(text: str) -> int | None:
    """Return a text of decimal digits as a number of at most 18 digits, and None for any other text."""
    digits = text.strip().lstrip("0") or "0" if text.strip() else ""
    return int(digits) if digits.isascii() and digits.isdecimal() and len(digits) <= 18 else None


def whole_number(text: str, what: str, lower: int, upper: int) -> int:
    """Return a text of the command line as a whole number in [lower, upper]; what: its name, for messages.

    Raises InputError for any other text.
    """
    value = as_whole_number(text)
    if value is None or not lower <= value <= upper:
        raise InputError(f"{what} is {shown(text)}: allowed is a whole number from {lower} to {upper}")
    return value


# Lists as people type them: words between commas or spaces.


def words(text: str | Iterable[str]) -> list[str]:
    """Return the words of a list, separated by commas or spaces.

    A path with spaces stands in quotes, or alone or between commas if there is such a file or folder. Raises InputError
    for a quote that does not end.
    """
    line = " ".join(map(_quoted, [text] if isinstance(text, str) else text))
    lexer = shlex.shlex(line, posix=True, punctuation_chars="")
    lexer.whitespace, lexer.whitespace_split, lexer.commenters = " \t\r\n,", True, ""
    try:
        return list(lexer)
    except ValueError:
        raise InputError(f"{line!r}: a quote does not end") from None


def _quoted(text: str) -> str:
    """Return a text with quotes around what is there under its whole name, alone or between commas."""
    parts = [text] if _is_there(text) else text.split(",")
    return ",".join(shlex.quote(part.strip()) if _is_there(part) else part for part in parts)


def _is_there(text: str) -> bool:
    return os.path.exists(os.path.expanduser(text.strip()))
