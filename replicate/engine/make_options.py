"""The options that `make` hands on: all variables that are set go to every target, which leaves out what it lacks."""

from collections.abc import Collection

FROM_MAKE = "--from-make"


def without_foreign(given: list[str], taken: Collection[str]) -> list[str]:
    """Return a command line's words; those from make without the options, and their values, that are not `taken`.

    taken: the options that the command takes, as "--profile".
    """
    if FROM_MAKE not in given:
        return given
    kept, keep = [], True
    for word in given:
        keep = word in taken if word.startswith("--") else keep
        if keep:
            kept.append(word)
    return kept
