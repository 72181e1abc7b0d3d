"""Whose head the rig in a Blender file is on: a small file beside it, `rigify.head.npz` beside `rigify.blend`.

The rig in the .blend may be posed, painted and keyed; its head stays the one that it was made for.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from data_recipes.head.neutral_head import Head
from replicate.engine.exceptions import InputError
from replicate.engine.user_files import shown_path

SAME_MM = 0.01  # heads that differ by less are one, built by two machines


def stamp_of(blend: Path) -> Path:
    """Return the file beside a .blend that says whose head is in it."""
    return blend.with_suffix(".head.npz")


def write_stamp(head: Head, character: str, blend: Path) -> None:
    """Write down whose head the rig of a .blend is made on, and where its vertices are, mm."""
    np.savez_compressed(stamp_of(blend), character=character, vertices_mm=head.vertices.astype(np.float32))


def check_stamp(head: Head, character: str, blend: Path) -> bool:
    """Return whether a .blend says whose head it has. Raises InputError where that is another head than this one."""
    try:
        with np.load(stamp_of(blend)) as stamp:
            whose, vertices = str(stamp["character"]), stamp["vertices_mm"]
    except FileNotFoundError:
        return False
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        allowed = "remove it, and the .blend is taken as it is"
        raise InputError(f"{shown_path(stamp_of(blend))} can't be read: {allowed}") from None
    if vertices.shape == head.vertices.shape and np.abs(vertices - head.vertices).max() < SAME_MM:
        return True
    other = f"the head of {whose}" if whose != character else f"{character}'s head as it was before its recipe changed"
    allowed = "name another folder, or remove the .blend, so that it is made anew"
    raise InputError(f"{shown_path(blend)} has the rig on {other}: {allowed}")
