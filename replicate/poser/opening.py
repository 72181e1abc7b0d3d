"""Faces to pose, from the artefacts that a folder of results was made with; nothing is trained for it."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.artefacts import built_rig, control_influence, rigid_segments
from replicate.engine.exceptions import InputError
from replicate.engine.paths import cache_folder, display_path
from replicate.engine.store import load
from replicate.inverse import ik_stage
from replicate.methods import coarse, refined, regional
from replicate.report.manifest import command_of, entries
from replicate.report.notebooks import folder_of

if TYPE_CHECKING:
    from replicate.poser.approximation_contents import Approximation
    from replicate.poser.contents import PosedFace
    from replicate.poser.notebook import Poser

NETWORKS = f"{ik_stage.PREFIX}_"
SHOWN = "figure11"  # whose networks pose a face; its IK networks are trained through the first method that it shows
EVALUATED = (regional.METHOD.name, coarse.METHOD.name, refined.METHOD.name)  # by the page's JavaScript


def open_poser(results: str, character: str) -> "Poser":
    """Return a widget to pose a character in, with the networks that its Figure 11 was made with.

    results: "reference", or the profile of a run of yours. Raises InputError as `open_face` does.
    """
    from replicate.poser.notebook import Poser

    return Poser(open_face(results, character))


def what_is_missing(results: str, character: str) -> str:
    """Return "" if `open_poser` can do its work, else a sentence with the command that makes what is missing."""
    try:
        artefacts(results, character)
    except InputError as error:
        return str(error)
    return ""


def open_face(results: str, character: str) -> "PosedFace":
    """Return what poses a character: the rig, our method's model and the IK networks.

    Raises InputError where the manifest names no such results, or the cache doesn't hold their artefacts.
    """
    inputs = artefacts(results, character)
    (networks,) = (name for name in inputs if name.startswith(NETWORKS))
    return read_face(inputs, regional.load_model(inputs), networks.removeprefix(NETWORKS))


def read_face(inputs: Mapping[str, Path], model: "Approximation", trained_through: str) -> "PosedFace":
    """Return what poses a character. trained_through: the method that the IK networks are trained through."""
    from replicate.poser.contents import PosedFace

    return PosedFace(
        built_rig.load(inputs),
        model,
        rigid_segments.load(inputs),
        ik_stage.load(inputs, trained_through),
        control_influence.load(inputs),
    )


def artefacts(results: str, character: str) -> dict[str, Path]:
    """Return the folders of what poses a character, by stage name, all of them verified.

    Raises InputError as `open_face` does; the sentence has the command that makes what is missing.
    """
    folder = folder_of(results)
    facts = entries(folder, SHOWN).get(character)
    if facts is None:
        command = f"make {command_of(SHOWN)} CHARACTERS={character}"
        raise InputError(f"{display_path(folder)}: there is no {SHOWN} of {character}; `{command}` makes it.")
    needed = ("rig", "rigid", "influence", regional.METHOD.name)
    found: dict[str, Path] = {}
    for title, stage in facts["stages"].items():
        name = title.partition("-")[0]
        if name in needed or name.startswith(NETWORKS):
            artefact = load(f"{title}-{stage['key']}")
            if artefact is None:
                command = f"make {command_of(SHOWN)} CHARACTERS={character} PROFILE={facts['profile']}"
                raise InputError(
                    f"The cache, {display_path(cache_folder())}, does not hold {title} as these results have it. "
                    f"`{command}` trains what is missing; then open the results of {facts['profile']!r}."
                )
            found[name] = artefact
    return found
