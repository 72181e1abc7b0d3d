"""What a mistyped word may have meant. `make` asks before anything is installed, so this imports no package."""

import difflib
import re
import sys
from collections.abc import Iterable

LONGEST = 60  # characters of a word in a message


def meant(word: str, names: Iterable[str]) -> str:
    """Return the name that a word most probably stands for, or "".

    Capitals, punctuation and leading zeros make no difference: "Figure1" stands for "figure01".
    """
    plain = {_plain(name): name for name in names}
    near = difflib.get_close_matches(_plain(word), plain, 1, 0.6)
    return plain[near[0]] if near else ""


def _plain(word: str) -> str:
    return re.sub(r"[^a-z0-9]|(?<!\d)0+(?=\d)", "", word.lower())


def nothing_named(kind: str, word: str, names: Iterable[str], otherwise: str) -> str:
    """Return a sentence about a word that names nothing: "there is no method coarze; did you mean coarse?".

    kind: the noun, such as "method".
    otherwise: the end of the sentence where no name is near.
    """
    near = meant(word, names)
    end = f"; did you mean {near}?" if near else otherwise
    word = word if word.isprintable() and word.strip() else repr(word)
    return f"there is no {kind} {word if len(word) <= LONGEST else word[:LONGEST] + '…'}{end}"


def main() -> int:
    """Print that make has no such target or variable, and which may be meant; return 2, for bad input.

    The command line has "target" or "variable", the word, and the names that there are.
    """
    kind, word, *names = sys.argv[1:]
    print(f"make: {nothing_named(kind, word, names, '; `make` alone lists them')}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
