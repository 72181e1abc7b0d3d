"""Heads for the tests, each built once."""

from functools import cache

from data_recipes.head.neutral_head import Head, build_head
from data_recipes.recipe.reading import load_recipe

NAMES = ("tiny", "teen", "woman", "toon")


@cache
def head(name: str) -> Head:
    return build_head(load_recipe(name))
