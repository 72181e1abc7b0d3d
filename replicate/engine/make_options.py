"""The options that `make` hands on: all variables that are set go to every target, which leaves out what it lacks."""

import sys
from collections.abc import Collection

FROM_MAKE = "--from-make"
ALWAYS_SET = ("--profile",)  # by the Makefile, whoever asks for what


def without_foreign(words: list[str], options: Collection[str]) -> list[str]:
    """Return a command line's words; those from make without the options, and their values, that a command lacks.

    options: those that the command takes, as "--profile". Standard error says which variables count for nothing.
    """
    if FROM_MAKE not in words:
        return words
    rest, foreign, keep = [], [], True
    for word in words:
        if word.startswith("--"):
            keep = word in options
            if not keep and word not in (FROM_MAKE, *ALWAYS_SET):
                foreign.append(word)
        if keep:
            rest.append(word)
    if foreign:
        print(f"left out, since this command doesn't take it: {', '.join(map(_variable, foreign))}", file=sys.stderr)
    return rest


def _variable(option: str) -> str:
    return option.removeprefix("--").replace("-", "_").upper()
