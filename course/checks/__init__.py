"""What the lessons' exercises are checked by: each check says what is right, or in one sentence what is wrong."""

from collections.abc import Callable

import numpy as np


class Wrong(AssertionError):
    """An answer that is not right yet. A notebook shows its sentence alone, without the code that led there."""

    def _render_traceback_(self) -> list[str]:  # what IPython shows in place of a traceback
        return [f"Not yet: {self}"]


def require(fact: object, sentence: str) -> None:
    """Raise Wrong with a sentence that helps, unless something is true."""
    if not fact:
        raise Wrong(sentence)


def passed(sentence: str) -> None:
    """Say what an answer was found to do right."""
    print(f"✓ {sentence}")


def require_kept(arguments: tuple[np.ndarray, ...], before: list[np.ndarray]) -> None:
    """Raise Wrong if an answer has changed its arguments. before: copies from before the call."""
    same = all((one == other).all() for one, other in zip(arguments, before, strict=True))
    require(same, "Your function changes its arguments; make new arrays, for the caller needs the old ones.")


def given_by(answer: Callable, *arguments: object, example: str) -> object:
    """Return what an answer gives for copies of some arguments, of which it may change no array.

    example: for the sentence that says so.
    """
    copies = [argument.copy() if isinstance(argument, np.ndarray) else argument for argument in arguments]
    given = answer(*copies)
    require(given is not None, "Your function returns None: end it with a `return`.")
    for copy, argument in zip(copies, arguments, strict=True):
        kept = not isinstance(argument, np.ndarray) or np.array_equal(copy, argument)
        require(kept, f"Your function changes its argument: {example}.")
    return given
