"""Samples of a rig that nobody here made: Blender's Rigify face rig, on a head of ours, as a folder for `CHARACTERS`.

`python -m data_recipes.rigify.rigify_face samples/rigify` makes the rig in a Blender file beside the folder, unless it
is there, and runs the exporter for Blender to write the folder. Called again, it goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data_recipes.deformers.face_points import control_points
from data_recipes.deformers.sculpting import Sculptor
from data_recipes.exporters.blender_python import blender_python, run_scripts
from data_recipes.head.neutral_head import Head, build_head
from data_recipes.recipe.reading import Recipe, load_recipe
from data_recipes.rigify.head_file import write_head_file
from replicate.base.command_line import guard
from replicate.base.exceptions import InputError
from replicate.base.user_files import shown_path

BUILDER = Path(__file__).with_name("rigify_rig.py")
EXPORTER = Path(__file__).parents[1] / "exporters" / "blender_samples.py"
SOURCE = "Blender's add-on Rigify generated the rig, its metarig of the human face; the head is '{head}' of this suite"
LICENCE = "head: MIT, as the suite; Rigify, the program: GPL 2 or later, of which nothing is in this folder"


def make_blend(head: Head, blend: Path, python: Path) -> None:
    """Write a Blender file with Rigify's face rig on a head of ours (half a minute). Raises InputError."""
    blend.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        joints, head_file = Path(folder) / "metarig.json", Path(folder) / "head.npz"
        part = Path(folder) / blend.name
        run_scripts(python, BUILDER, [["metarig", str(joints)]], quiet=True)
        metarig = {name: np.array(place) for name, place in json.loads(joints.read_text("utf-8")).items()}
        write_head_file(head, metarig, head_file)
        run_scripts(python, BUILDER, [["build", str(head_file), str(part)]], quiet=True)
        beside = blend.with_name(f".{blend.name}.part")
        beside.write_bytes(part.read_bytes())
        os.replace(beside, blend)


def points_text(head: Head) -> str:
    """Return more lines for the face.toml of a head: the place of the eyes, in Blender's axes, and its points."""
    _, vertices, region_of_point = control_points(Sculptor(head), head.recipe.control_points)
    regions: dict[str, list[int]] = {}
    for region, vertex in zip(region_of_point, vertices.tolist(), strict=True):
        regions.setdefault(region, []).append(vertex)
    _, y, z = (float(value) / 1000.0 for value in head.eyes["left"].centre)
    landmarks = list(head.landmarks.values())
    lines = [f"eyes = {[0.0, -z, y]}", "[points]", f"landmarks = {landmarks}", "[points.control_points]"]
    return "\n".join([*lines, *(f"{region} = {vertices}" for region, vertices in regions.items())]) + "\n"


def _recipe(character: str) -> Recipe:
    """Return a character's recipe. Raises InputError for one whose head isn't built here."""
    recipe = load_recipe(character)
    if not isinstance(recipe, Recipe):
        raise InputError(f"'{character}' has no head of ours: name a character that has one, such as woman or teen")
    return recipe


def write_folder(
    folder: Path, character: str, poses: int, seed: int, jobs: int, name: str | None, clips: str = "*"
) -> None:
    """Write the samples of Rigify's face rig on a character's head into a folder.

    A .blend beside it is used as it is. Raises InputError if that has the rig on another head, or without Blender.

    poses: to draw, in addition to all frames.
    jobs: processes side by side.
    name: of the character in tables, else the folder's.
    clips: a pattern of names of `face_acting.clips`.
    """
    python = blender_python()
    head = build_head(_recipe(character))
    blend = folder.with_name(f"{folder.name}.blend")
    if not blend.exists():
        blend.parent.mkdir(parents=True, exist_ok=True)
        write_stamp(head, character, blend)  # first, so that no rig is without one
        print(f"making {blend}: Rigify's face rig on the head of {character}, in half a minute", flush=True)
        make_blend(head, blend, python)
    elif not check_stamp(head, character, blend):
        print(f"{blend}: there is no {stamp_of(blend).name} to say whose head this is: using it as {character}'s")
    with tempfile.TemporaryDirectory() as temporary:
        points = Path(temporary) / "points.toml"
        points.write_text(points_text(head), "utf-8")
        options = [str(blend), "--mesh", "Head", "--collections", "Face*", "--keyed", "--out", str(folder)]
        options += ["--name", name or folder.name, "--points", str(points)]
        options += ["--poses", str(poses), "--seed", str(seed), "--actions", clips]
        options += ["--source", SOURCE.format(head=character), "--licence", LICENCE]
        run_scripts(python, EXPORTER, [[*options, "--share", f"{i + 1}/{jobs}"] for i in range(jobs)], quiet=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the folder that the command line names; return the exit code, 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m data_recipes.rigify.rigify_face", description=__doc__.split("\n\n")[0]
    )
    parser.add_argument("folder", type=Path, help="the folder that is written; beside it, the .blend")
    parser.add_argument("--character", default="woman", help="whose head it is: a character of ours (default: woman)")
    parser.add_argument("--poses", type=int, default=3_000, help="poses to draw, beside all frames (default: 3000)")
    parser.add_argument("--seed", type=int, default=0, help="where random numbers start (default: 0)")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="processes side by side")
    parser.add_argument("--name", help="the character's name in tables (default: the folder's)")

    def body() -> None:
        options = parser.parse_args(arguments)
        if options.poses < 0 or options.seed < 0:
            raise InputError(f"--poses and --seed: expected numbers of at least 0, got {options.poses}, {options.seed}")
        if not 1 <= options.jobs <= 64:
            raise InputError(f"--jobs: expected a number from 1 to 64, got {options.jobs}")
        write_folder(options.folder, options.character, options.poses, options.seed, options.jobs, options.name)
        folder = shlex.quote(str(options.folder.absolute()))
        print(f"written to {options.folder}: make table2 CHARACTERS={folder} PROFILE=quick")

    return guard(body)


# A small file beside a Blender file, `rigify.head.npz` beside `rigify.blend`, tells whose head its rig is on.

SAME_MM = 0.01  # a head that two machines build differs by less


def stamp_of(blend: Path) -> Path:
    """Return the file beside a .blend that tells whose head is in it."""
    return blend.with_suffix(".head.npz")


def write_stamp(head: Head, character: str, blend: Path) -> None:
    """Record whose head the rig of a .blend is on, and the vertices of this head, mm."""
    np.savez_compressed(stamp_of(blend), character=character, vertices_mm=head.vertices.astype(np.float32))


def check_stamp(head: Head, character: str, blend: Path) -> bool:
    """Return whether it is known whose head a .blend has. Raises InputError if it is another head than this one."""
    try:
        with np.load(stamp_of(blend)) as stamp:
            stamped, vertices = str(stamp["character"]), stamp["vertices_mm"]
    except FileNotFoundError:
        return False
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        raise InputError(f"{shown_path(stamp_of(blend))} can't be read: remove it to use the .blend as it is") from None
    if vertices.shape == head.vertices.shape and np.abs(vertices - head.vertices).max() < SAME_MM:
        return True
    other = f"the head of {stamped}" if stamped != character else f"{character}'s head before its recipe changed"
    remedy = "name another folder, or remove the .blend, so that it is made anew"
    raise InputError(f"{shown_path(blend)} has the rig on {other}: {remedy}")


if __name__ == "__main__":
    sys.exit(main())
