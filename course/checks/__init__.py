"""What the lessons' exercises are checked by: each check says what is right, or in one sentence what is wrong."""


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
