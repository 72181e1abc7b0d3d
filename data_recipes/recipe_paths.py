"""Where recipes lie, by the names of their characters. Light: command lines read it before anything is built."""

import os
import re
from pathlib import Path

RECIPES = Path(__file__).resolve().parent
OUTSIDE = {"ict": "ICT_FACEKIT"}  # characters whose data is not in the project → the variable that names its folder


def character_names() -> tuple[str, ...]:
    """Return the names of the characters: one recipe file each, and those whose data a variable names."""
    outside = tuple(name for name, variable in OUTSIDE.items() if os.environ.get(variable, "").strip())
    return (*sorted(path.stem for path in RECIPES.glob("*.toml")), *outside)


def split_character(character: str) -> tuple[str, tuple[str, ...]]:
    """Return a character's name or path, and its variants: "teen@one_face" → ("teen", ("one_face",))."""
    path, variants = re.fullmatch(r"(.*\.toml|[^@]*)((?:@.*)?)", character, re.DOTALL).groups()
    return path, tuple(variants.split("@")[1:])


def character_label(character: str) -> str:
    """Return what results call a character: the stem of its recipe's file, and its variants."""
    return "@".join([recipe_file(character).stem, *split_character(character)[1]])


def absolute(character: str) -> str:
    """Return a character as it is named from any folder: a path is made absolute, a name stays."""
    name, variants = split_character(character)
    return "@".join([os.path.abspath(name) if name.endswith(".toml") else name, *variants])


def recipe_file(character: str) -> Path:
    """Return the recipe of a character, given by its name or as the path of a `.toml` file of one's own.

    What follows an @ says which variant of it, and leads to the same file.
    """
    name, _ = split_character(character)
    if name.endswith(".toml"):
        return Path(os.path.abspath(name))
    inner = RECIPES / name / f"{name}.toml"  # of a character whose data lies elsewhere
    return inner if name in OUTSIDE and inner.is_file() else RECIPES / f"{name}.toml"


def drags_file(character: str) -> Path:
    """Return the file of a character's drags of control points: drags/<name>.csv beside its recipe, whatever variant.

    A character may have none.
    """
    recipe = recipe_file(character)
    return recipe.parent / "drags" / f"{recipe.stem}.csv"
