"""Lists as people type them: words between commas or spaces."""

import shlex
from collections.abc import Iterable

from replicate.engine.exceptions import InputError


def words(text: str | Iterable[str]) -> list[str]:
    """Return the words of a list, separated by commas or spaces; a path with spaces stands in quotes.

    Raises InputError for a quote that does not end.
    """
    line = text if isinstance(text, str) else " ".join(text)
    lexer = shlex.shlex(line, posix=True, punctuation_chars="")
    lexer.whitespace, lexer.whitespace_split, lexer.commenters = " \t\r\n,", True, ""
    try:
        return list(lexer)
    except ValueError:
        raise InputError(f"{line!r}: a quote does not end") from None
