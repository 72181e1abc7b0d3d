"""Expressions as amounts of the named controls.

"*" stands for both sides. Amounts are those of a full but not extreme performance; `procedural_acting` scales them,
makes them uneven and leaves out the controls that a smaller rig lacks. An expression has everything that the face does
together: a smile lifts the cheeks and narrows the eyes, a cry opens the jaw and squares the lower lip.
"""

from collections.abc import Container

from data_recipes.acting.antics import ANTICS, CREATURE
from data_recipes.acting.feelings import FEELINGS

EXPRESSIONS = FEELINGS | ANTICS
MARK = "snarl_left"  # a control that only creatures have


def expression(name: str, controls: Container[str]) -> dict[str, float]:
    """Return an expression's amounts for a rig with controls of these names."""
    return EXPRESSIONS[name] | (CREATURE.get(name, {}) if MARK in controls else {})
