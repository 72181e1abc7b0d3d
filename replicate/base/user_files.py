"""What users type, and the files they bring: words, numbers, paths, TOML."""

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

BESIDE = ".0000000.part"  # is added to the name of a half-written file

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def read_bytes(file: Path, most_bytes: int) -> bytes:
    """Return a file's contents. Raises InputError if it is missing, unreadable, not regular or too long."""
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
        raise InputError(f"{name} can't be read ({error.strerror})") from None
    except InputError:
        raise
    except ValueError as error:  # a NUL, or what no file system can encode
        raise InputError(f"{name}: no file can have this name ({error})") from None
    if len(data) > most_bytes:
        raise InputError(f"{name}: expected at most {most_bytes / 1e6:g} MB, got a longer file")
    return data


def _check_regular(mode: int, name: str) -> None:
    if not stat.S_ISREG(mode):
        raise InputError(f"{name}: expected a regular file, got {_KINDS.get(stat.S_IFMT(mode), 'something else')}")


def read_text(file: Path, most_bytes: int) -> str:
    """Return a file's text without byte order mark. Raises InputError as `read_bytes` does, and if it isn't UTF-8."""
    data = read_bytes(file, most_bytes)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{shown_path(file)}: byte {error.start} is no UTF-8: save the file as UTF-8") from None


def read_toml(file: Path) -> dict[str, Any]:
    """Return a TOML file's table. Raises InputError if it can't be read, and for keys that are too long or too deep."""
    text = read_text(file, TOML_BYTES)
    for line_number, line in enumerate(text.split("\n"), 1):
        if (dots := line.count(".")) > MOST_DOTS:
            remedy = f"expected at most {MOST_DOTS}, with keys of a few parts and numbers line by line"
            raise InputError(f"{shown_path(file)}: line {line_number} has {dots:,} dots: {remedy}")
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
        raise InputError(f"{name}: expected tables at most {MOST_TABLES} deep, got deeper ones")
    for key, value in table.items():
        if len(key) > LONGEST:
            raise InputError(f"{name}: the key {cut(key)} has {len(key):,} characters: expected at most {LONGEST}")
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, dict):
                _check_keys(inner, name, depth + 1)


def is_file(file: Path) -> bool:
    """Return whether there is a regular file of this name."""
    try:
        return stat.S_ISREG(os.stat(file).st_mode)
    except (OSError, ValueError):
        return False


def check_output_file(file: Path) -> None:
    """Raise InputError where no file can be written: a folder, device or pipe is there, or no file can be called so."""
    name = shown_path(file)
    if "\0" in str(file) or len(os.fsencode(file.name)) > LONGEST_NAME - len(BESIDE):
        raise InputError(f"{name}: no file can have this name: name another file")
    try:
        _check_regular(os.stat(file).st_mode, name)
    except FileNotFoundError:
        pass
    except OSError as error:
        raise InputError(f"{name} can't be written ({error.strerror}): name another file") from None


def shown_path(file: Path) -> str:
    """Return a path for use in a message: as it is, or quoted and cut if it isn't printable or short."""
    text = str(file)
    return text if text.isprintable() and len(text) <= 4 * LONGEST_NAME else shown(text)


def as_whole_number(text: str) -> int | None:
    """Return a text of at most 18 decimal digits as a number, None for any other text."""
    digits = text.strip().lstrip("0") or "0" if text.strip() else ""
    return int(digits) if digits.isascii() and digits.isdecimal() and len(digits) <= 18 else None


def whole_number(text: str, what: str, lower: int, upper: int) -> int:
    """Return a text of the command line as a whole number in [lower, upper]; raise InputError for any other text.

    what: the option's name, for messages.
    """
    value = as_whole_number(text)
    if value is None or not lower <= value <= upper:
        raise InputError(f"{what}: expected a whole number from {lower} to {upper}, got {shown(text)}")
    return value


# Lists as people type them: words between commas or spaces.


def words(text: str | Iterable[str]) -> list[str]:
    """Return the words of a list, separated by commas or spaces.

    A path with spaces is one word if it is quoted, or if it exists and stands alone or between commas. Raises
    InputError for a quote that does not end.
    """
    line = " ".join(map(_quoted, [text] if isinstance(text, str) else text))
    lexer = shlex.shlex(line, posix=True, punctuation_chars="")
    lexer.whitespace, lexer.whitespace_split, lexer.commenters = " \t\r\n,", True, ""
    try:
        return list(lexer)
    except ValueError:
        raise InputError(f"{line!r}: a quote does not end") from None


def _quoted(text: str) -> str:
    """Return a text with quotes around every existing path in it that stands alone or between commas."""
    parts = [text] if _is_there(text) else text.split(",")
    return ",".join(shlex.quote(part.strip()) if _is_there(part) else part for part in parts)


def _is_there(text: str) -> bool:
    return os.path.exists(os.path.expanduser(text.strip()))
