"""Lists as people type them: words between commas or spaces."""

import os
import shlex
from collections.abc import Iterable

from replicate.engine.exceptions import InputError


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
