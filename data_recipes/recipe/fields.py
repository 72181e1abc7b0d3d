"""Fields that several sections of a recipe have: points, directions and radii, colours, shares."""

from typing import Any

from replicate.engine.schema import number, numbers

Triple = tuple[float, float, float]


def triple(default: Triple, lower: float = -300.0, upper: float = 300.0) -> Any:
    """Declare three numbers: a point or radii in mm, a direction."""
    return numbers(default, 3, lower, upper)


def colour(red: float, green: float, blue: float) -> Any:
    """Declare a colour, RGB from 0 to 1."""
    return numbers((red, green, blue), 3, 0.0, 1.0)


def share(default: float) -> Any:
    """Declare a share, 0 to 1."""
    return number(default, 0.0, 1.0)
