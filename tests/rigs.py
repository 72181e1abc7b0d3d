"""Rigs for the tests: the first process that asks for one builds it, and the others read what it has saved."""

import os
import shutil
from functools import cache
from pathlib import Path

import pytest
from filelock import FileLock

from data_recipes.catalogue import build_rig, character_parts, load_rig, save_rig, with_face_landmarks
from data_recipes.face_rig import FaceRig
from replicate.config import resolve
from replicate.engine.scheduler import run
from replicate.methods import artefacts
from replicate.methods.plan import Plan


@cache
def rig(name: str) -> FaceRig:
    return _shared(name, lambda: build_rig(name))


@cache
def landmark_rig(name: str) -> FaceRig:
    """Return a rig whose control points are the landmarks of performance capture."""
    return _shared(f"{name}-landmarks", lambda: with_face_landmarks(rig(name), character_parts(name)[0]))


def put_into(cache: Path, name: str = "tiny") -> None:
    """Put a rig into a folder for a cache, as the first stage of a run leaves it there."""
    shared = Path(os.environ["REPLICATE_TEST_RIGS"]) / "cache"
    with pytest.MonkeyPatch.context() as patch, FileLock(f"{shared}.lock"):
        patch.setenv("REPLICATE_CACHE", str(shared))
        (folder,) = run([artefacts.rig_stage(Plan(resolve(name, "quick")))], workers=1).values()
    shutil.copytree(folder, cache / folder.name)


def _shared(name, build) -> FaceRig:
    folder = Path(os.environ["REPLICATE_TEST_RIGS"]) / name
    with FileLock(f"{folder}.lock"):
        if not folder.exists():
            save_rig(build(), folder)
        return load_rig(folder)
