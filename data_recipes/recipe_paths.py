"""Where recipes lie, by the names of their characters. Light: command lines read it before anything is built."""

import os
from pathlib import Path

RECIPES = Path(__file__).resolve().parent
OUTSIDE = {"ict": "ICT_FACEKIT"}  # characters whose data is not in the project → the variable that names its folder


def character_names() -> tuple[str, ...]:
    """Return the names of the characters: one recipe file each, and those whose data a variable names."""
    outside = tuple(name for name, variable in OUTSIDE.items() if os.environ.get(variable, "").strip())
    return (*sorted(path.stem for path in RECIPES.glob("*.toml")), *outside)


def recipe_file(character: str) -> Path:
    """Return the recipe of a character, given by its name or as the path of a `.toml` file of one's own."""
    if character.endswith(".toml"):
        return Path(os.path.abspath(character))
    inner = RECIPES / character / f"{character}.toml"  # of a character whose data lies elsewhere
    return inner if character in OUTSIDE and inner.is_file() else RECIPES / f"{character}.toml"
