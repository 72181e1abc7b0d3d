"""Rigs for the tests, each built once in a process."""

from functools import cache

from data_recipes.catalogue import build_rig
from data_recipes.face_rig import FaceRig


@cache
def rig(name: str) -> FaceRig:
    return build_rig(name)
