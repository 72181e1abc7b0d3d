"""Rigs for the tests: the first process that asks for one builds it, and the others read what it has saved."""

import os
from functools import cache
from pathlib import Path

from filelock import FileLock

from data_recipes.catalogue import build_rig, character_parts, load_rig, save_rig, with_face_landmarks
from data_recipes.face_rig import FaceRig


@cache
def rig(name: str) -> FaceRig:
    return _shared(name, lambda: build_rig(name))


@cache
def landmark_rig(name: str) -> FaceRig:
    """Return a rig whose control points are the landmarks of performance capture."""
    return _shared(f"{name}-landmarks", lambda: with_face_landmarks(rig(name), character_parts(name)[0]))


def _shared(name, build) -> FaceRig:
    folder = Path(os.environ["REPLICATE_TEST_RIGS"]) / name
    with FileLock(f"{folder}.lock"):
        if not folder.exists():
            save_rig(build(), folder)
        return load_rig(folder)
