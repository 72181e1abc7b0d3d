"""The options that `make` hands on: all variables that are set go to every target, which leaves out what it lacks."""

from collections.abc import Collection

FROM_MAKE = "--from-make"


def without_foreign(words: list[str], options: Collection[str]) -> list[str]:
    """Return a command line's words; those from make without the options, and their values, that a command lacks.

    options: those that the command takes, as "--profile".
    """
    if FROM_MAKE not in words:
        return words
    rest, keep = [], True
    for word in words:
        keep = word in options if word.startswith("--") else keep
        if keep:
            rest.append(word)
    return rest
