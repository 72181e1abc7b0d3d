"""What a mistyped word may have meant: `make` asks before anything is installed, so this needs Python's own library."""

import difflib
import re
import sys
from collections.abc import Iterable

LONGEST = 60  # characters of a word that a sentence repeats


def meant(word: str, names: Iterable[str]) -> str:
    """Return the name that a word most probably stands for, "" for none.

    Numbers may lack their zero, capitals and - for _ count for nothing: "Figure1" stands for "figure01".
    """
    plain = {re.sub(r"[^a-z0-9]|(?<!\d)0+(?=\d)", "", name.lower()): name for name in names}
    near = difflib.get_close_matches(re.sub(r"[^a-z0-9]|(?<!\d)0+(?=\d)", "", word.lower()), plain, 1, 0.6)
    return plain[near[0]] if near else ""


def nothing_named(kind: str, word: str, names: Iterable[str], otherwise: str) -> str:
    """Return the sentence for a word that names nothing: "there is no method coarze; did you mean coarse?".

    kind: what it was to name. otherwise: how the sentence ends where no name is near.
    """
    near = meant(word, names)
    end = f"; did you mean {near}?" if near else otherwise
    word = word if word.isprintable() and word.strip() else repr(word)
    return f"there is no {kind} {word if len(word) <= LONGEST else word[:LONGEST] + '…'}{end}"


def main() -> int:
    """Say that make knows no target or variable of a name, and which it may have meant; always 2, for bad input.

    The words of the command line: "target" or "variable", the word, and the names that there are.
    """
    kind, word, *names = sys.argv[1:]
    print(f"make: {nothing_named(kind, word, names, '; `make` alone lists them')}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
