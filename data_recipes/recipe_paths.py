"""Where recipes and folders of samples lie, by the names of their characters.

This module imports little, since command lines read it first: what looks into a folder of samples waits for one.
"""

import os
import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from data_recipes.sampled.face_file import CONTROL_FILE, FACE_FILE, MESH_ENDINGS
from data_recipes.sampled.shards import CACHE_ENDINGS
from replicate.base.exceptions import InputError
from replicate.base.paths import with_home
from replicate.base.spelling import nothing_named
from replicate.base.user_files import is_file, read_toml

RECIPES = Path(__file__).resolve().parent
POSES = "poses"  # of a folder of samples
SHAPE_ENDINGS = (".glb", ".gltf", ".vrm")  # of files that are a face by themselves
SHAPE_MESHES = (".obj", ".ply")  # of a folder with a mesh for each shape
LABEL = r"[\w.-]+"  # names that results can have
STANDS_FOR = {"teen": "Hiccup", "woman": "Valka", "dragon": "Toothless", "toon": "Ray"}  # ours → the paper's
OUTSIDE = {"ict": "ICT_FACEKIT"}  # characters whose data is not in the project → the variable that names its folder


def character_names() -> tuple[str, ...]:
    """Return the names of the characters: one recipe file each, and those whose data a variable names."""
    outside = tuple(name for name, variable in OUTSIDE.items() if os.environ.get(variable, "").strip())
    return (*sorted(path.stem for path in RECIPES.glob("*.toml")), *outside)


def no_character(name: str) -> str:
    """Return the sentence for a name that no character has: who plays that part here, or the nearest name."""
    names = character_names()
    for ours, the_papers in STANDS_FOR.items():
        if name.lower() == the_papers.lower() and ours in names:
            return f"{the_papers}'s part is played by the {ours}: CHARACTERS={ours}"
    for ending in SHAPE_ENDINGS:
        if _is_there(Path(f"{name}{ending}")):
            return f"there is no character {name}; did you mean the file {name}{ending}?"
    others = f": there are {', '.join(names)}, and paths of .toml recipes, of .glb, .gltf or .vrm files and of folders"
    return nothing_named("character", name, names, others)


def named(character: str) -> str:
    """Return a character's name or path with ~ expanded; for a file of a folder of samples, the folder.

    Such files are its face.toml, its table of controls and its mesh. A point cache stands for the folder that it is in.
    Raises InputError for the home folder of an unknown user.
    """
    path = str(with_home(character, "CHARACTERS")) if character.startswith("~") else character
    folder, name = os.path.split(os.path.abspath(path))
    if os.path.splitext(name)[1].lower() in CACHE_ENDINGS and is_file(Path(path)):
        return folder
    may_stand_alone = name == FACE_FILE or os.path.splitext(name)[1].lower() in SHAPE_ENDINGS
    beside = (Path(folder, other) for other in ((CONTROL_FILE, POSES) if may_stand_alone else (FACE_FILE,)))
    is_its_file = name in (FACE_FILE, CONTROL_FILE) or os.path.splitext(name)[1].lower() in MESH_ENDINGS
    return folder if is_its_file and is_file(Path(path)) and any(map(_is_there, beside)) else path


def sample_folder(character: str) -> Path | None:
    """Return the folder of samples that a character is given as, or None for a recipe or the name of one.

    Any path with a slash counts as a folder, whether it exists or not, and so does the name of one with a `face.toml`,
    a table of controls or poses; but a face of shapes (`shape_file`) is no folder of samples.
    """
    if shape_file(character):
        return None
    if re.fullmatch(r".*\.toml(@.*)?", character, re.DOTALL) or _is_there(RECIPES / f"{character}.toml"):
        return None
    folder = Path(os.path.abspath(character))
    has_samples = any(_is_there(folder / part) for part in (FACE_FILE, CONTROL_FILE, POSES))
    return folder if "/" in character or has_samples else None


def shape_file(character: str) -> Path | None:
    """Return the glTF that a character is given as, or the folder of shapes; None for others.

    Such a folder has a mesh for each shape, or is one of samples with one pose for each shape.
    """
    path = Path(os.path.abspath(character))
    if path.suffix.lower() in SHAPE_ENDINGS:
        return path
    if "/" not in character and _is_there(RECIPES / f"{character}.toml"):
        return None
    if _is_there(path / CONTROL_FILE):
        from data_recipes.sampled.one_pose_each import has_one_pose_each

        return path if has_one_pose_each(path) else None
    try:
        return path if path.is_dir() and _has_meshes(path) else None
    except OSError:
        return None


def _has_meshes(folder: Path) -> bool:
    return any(file.suffix.lower() in SHAPE_MESHES for file in folder.iterdir()) and not (folder / POSES).is_dir()


def _is_there(file: Path) -> bool:
    try:
        return file.exists()
    except (OSError, ValueError):  # a name that no file can have
        return False


def split_character(character: str) -> tuple[str, tuple[str, ...]]:
    """Return a character's name or path, and its variants: "teen@one_face" → ("teen", ("one_face",)).

    A folder of samples has no variants.
    """
    if sample_folder(character) or shape_file(character):
        return character, ()
    path, variants = re.fullmatch(r"(.*\.toml|[^@]*)((?:@.*)?)", character, re.DOTALL).groups()
    return path, tuple(variants.split("@")[1:])


def character_label(character: str) -> str:
    """Return what results call a character: its recipe file's stem with the variants, or its folder's name.

    A folder whose name can't be part of a file's name goes by the name in its face.toml, if that has one.
    """
    if place := shape_file(character):
        return re.sub(r"[^\w.-]+", "_", place.name if place.is_dir() else place.stem).strip("_") or "face"
    if folder := sample_folder(character):
        file = folder / FACE_FILE
        if re.fullmatch(LABEL, folder.name) or not is_file(file):
            return folder.name
        name = read_toml(file).get("name")
        return name if isinstance(name, str) else folder.name
    return "@".join([recipe_file(character).stem, *split_character(character)[1]])


def absolute(character: str) -> str:
    """Return a character's name or path so that it holds in any working folder: paths become absolute."""
    if place := sample_folder(character) or shape_file(character):
        return str(place)
    name, variants = split_character(character)
    return "@".join([os.path.abspath(name) if name.endswith(".toml") else name, *variants])


def in_command(character: str) -> str:
    """Return a character as a command names it wherever it is typed: paths are whole, and quoted if they need it.

    The label of one from elsewhere doesn't tell its path: there words in brackets stand in its place.
    """
    whole = absolute(character)
    if sample_folder(whole) or shape_file(whole) or split_character(whole)[0].endswith(".toml"):
        return shlex.quote(whole)
    is_ours = split_character(whole)[0] in STANDS_FOR or is_file(recipe_file(whole))
    return whole if is_ours else f"<recipe or folder of {character}>"


def recipe_file(character: str) -> Path:
    """Return the file of a character's recipe, given its name or the path of a `.toml` file.

    Variants, which follow an @, are ignored. For a folder of samples it is the face.toml in it or its only point
    cache, for a face of shapes the glTF or the folder itself. Raises InputError for several caches without a face.toml.
    """
    if place := shape_file(character):
        return place
    if folder := sample_folder(character):
        if _is_there(folder / FACE_FILE):
            return folder / FACE_FILE
        from data_recipes.sampled.point_caches import lone_cache

        return lone_cache(folder) or folder / FACE_FILE
    name, _ = split_character(character)
    if name.endswith(".toml"):
        return Path(os.path.abspath(name))
    inner = RECIPES / name / f"{name}.toml"  # of a character whose data lies elsewhere
    return inner if name in OUTSIDE and inner.is_file() else RECIPES / f"{name}.toml"


def check_function(characters: Sequence[str], command: str, purpose: str) -> None:
    """Raise InputError for a character that is known by its samples alone, for a command that needs a function."""
    for character in characters:
        if sample_folder(character):
            raise InputError(
                f"{character_label(character)} is known by its samples alone, and {command} asks the rig {purpose}; "
                "use a character whose rig has a function"
            )


def drags_file(character: str) -> Path:
    """Return the file of a character's drags of control points, drags/<name>.csv beside its recipe.

    It may not exist. All variants share it.
    """
    recipe = recipe_file(character)
    return recipe.parent / "drags" / f"{recipe.stem}.csv"
