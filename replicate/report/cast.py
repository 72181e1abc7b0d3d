"""Who stands for whom: our characters beside the paper's, and the order in which tables list them."""

from collections.abc import Iterable

from data_recipes.recipe_paths import OUTSIDE, recipe_file
from replicate.report.results import Row

STANDS_FOR = {"teen": "Hiccup", "woman": "Valka", "dragon": "Toothless", "toon": "Ray"}


def cast() -> tuple[str, ...]:
    """Return the characters that stand for the paper's four, in its order: those that have a recipe."""
    return tuple(name for name in STANDS_FOR if recipe_file(name).is_file())


def order_of(character: str) -> tuple[bool, int, str]:
    """Return what sorts characters: those that stand for one of the paper's in its order, then others by name.

    Variants, as teen@one_face, come last, in the order of the characters that they are variants of.
    """
    names, (base, at, _) = list(STANDS_FOR), character.partition("@")
    return bool(at), (names.index(base) if base in names else len(names)), character


def has_committed_meshes(character: str) -> bool:
    """Return whether meshes of a character's test poses are committed, beside numbers and pictures.

    Those of a face that is no part of this project are not; those of variants, as teen@one_face, would take space.
    """
    return character not in OUTSIDE and "@" not in character


def led_by(characters: Iterable[str], first: str) -> list[str]:
    """Return the characters with one of them in front, if it is among them."""
    return sorted(characters, key=lambda name: name != first)


def characters_of(rows: Iterable[Row]) -> list[str]:
    """Return the characters of some rows in the order of the paper's."""
    return sorted({row.character for row in rows}, key=order_of)
