"""Where recipes and folders of samples lie, by the names of their characters.

Light: command lines read it before anything is built.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from replicate.base.exceptions import InputError
from replicate.base.paths import with_home
from replicate.base.spelling import nothing_named
from replicate.base.user_files import is_file, read_toml

RECIPES = Path(__file__).resolve().parent
FACE_FILE, CONTROL_FILE = "face.toml", "controls.csv"  # of a folder of samples
LABEL = r"[\w.-]+"  # what results can be called
STANDS_FOR = {"teen": "Hiccup", "woman": "Valka", "dragon": "Toothless", "toon": "Ray"}  # ours → the paper's
OUTSIDE = {"ict": "ICT_FACEKIT"}  # characters whose data is not in the project → the variable that names its folder


def character_names() -> tuple[str, ...]:
    """Return the names of the characters: one recipe file each, and those whose data a variable names."""
    outside = tuple(name for name, variable in OUTSIDE.items() if os.environ.get(variable, "").strip())
    return (*sorted(path.stem for path in RECIPES.glob("*.toml")), *outside)


def no_character(name: str) -> str:
    """Return the sentence for a name that no character has: who plays that part here, or the nearest name."""
    for own, played in STANDS_FOR.items():
        if name.lower() == played.lower() and own in character_names():
            return f"{played}'s part is played by the {own}: CHARACTERS={own}"
    names = character_names()
    others = f": there are {', '.join(names)}, and paths of .toml recipes and of folders of samples"
    return nothing_named("character", name, names, others)


def named(character: str) -> str:
    """Return a character's name or path as it is meant: ~ is the home folder, a folder's face.toml is the folder.

    Raises InputError for the home folder of nobody.
    """
    path = str(with_home(character, "CHARACTERS")) if character.startswith("~") else character
    folder = os.path.dirname(os.path.abspath(path))
    is_its_file = os.path.basename(path) == FACE_FILE and _is_there(Path(folder, CONTROL_FILE))
    return folder if is_its_file else path


def sample_folder(character: str) -> Path | None:
    """Return the folder of samples that a character is named by: a path with a slash, or a folder with a `face.toml`.

    None for a character's name and for a recipe. The folder need not be there.
    """
    if re.fullmatch(r".*\.toml(@.*)?", character, re.DOTALL) or _is_there(RECIPES / f"{character}.toml"):
        return None
    folder = Path(os.path.abspath(character))
    return folder if "/" in character or _is_there(folder / FACE_FILE) else None


def _is_there(file: Path) -> bool:
    try:
        return file.exists()
    except (OSError, ValueError):  # a name that no file can have
        return False


def split_character(character: str) -> tuple[str, tuple[str, ...]]:
    """Return a character's name or path, and its variants: "teen@one_face" → ("teen", ("one_face",)).

    A folder of samples has no variants.
    """
    if sample_folder(character):
        return character, ()
    path, variants = re.fullmatch(r"(.*\.toml|[^@]*)((?:@.*)?)", character, re.DOTALL).groups()
    return path, tuple(variants.split("@")[1:])


def character_label(character: str) -> str:
    """Return what results call a character: the stem of its recipe's file, and its variants; a folder's name.

    Of a folder whose name can't name files it is the name in its face.toml, if there is one.
    """
    if folder := sample_folder(character):
        file = folder / FACE_FILE
        if re.fullmatch(LABEL, folder.name) or not is_file(file):
            return folder.name
        name = read_toml(file).get("name")
        return name if isinstance(name, str) else folder.name
    return "@".join([recipe_file(character).stem, *split_character(character)[1]])


def absolute(character: str) -> str:
    """Return a character as it is named from any folder: a path is made absolute, a name stays."""
    if folder := sample_folder(character):
        return str(folder)
    name, variants = split_character(character)
    return "@".join([os.path.abspath(name) if name.endswith(".toml") else name, *variants])


def recipe_file(character: str) -> Path:
    """Return the recipe of a character, given by its name or as the path of a `.toml` file of one's own.

    What follows an @ says which variant of it, and leads to the same file. Of a folder of samples it is its face.toml.
    """
    if folder := sample_folder(character):
        return folder / FACE_FILE
    name, _ = split_character(character)
    if name.endswith(".toml"):
        return Path(os.path.abspath(name))
    inner = RECIPES / name / f"{name}.toml"  # of a character whose data lies elsewhere
    return inner if name in OUTSIDE and inner.is_file() else RECIPES / f"{name}.toml"


def check_function(characters: Sequence[str], command: str, purpose: str) -> None:
    """Raise InputError for a character that is known by its samples alone, where a command asks rigs for more."""
    for character in characters:
        if sample_folder(character):
            raise InputError(
                f"{character_label(character)} is known by its samples alone, and {command} asks the rig {purpose}: "
                "allowed are characters with a function"
            )


def drags_file(character: str) -> Path:
    """Return the file of a character's drags of control points: drags/<name>.csv beside its recipe, whatever variant.

    A character may have none.
    """
    recipe = recipe_file(character)
    return recipe.parent / "drags" / f"{recipe.stem}.csv"
