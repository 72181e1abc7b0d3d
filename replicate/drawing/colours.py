"""Colours as pictures have them: red, green and blue from 0 to 255."""

from collections.abc import Sequence


def colour_in_bytes(colour: Sequence[float]) -> tuple[int, int, int]:
    """Return a colour from 0 to 255; one whose parts are at most 1 is taken to be from 0 to 1."""
    scale = 255 if max(colour) <= 1 else 1
    return tuple(round(scale * float(channel)) for channel in colour)
