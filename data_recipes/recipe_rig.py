"""A rig from a recipe of ours: head, controls, deformers and acting put together."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from data_recipes.acting.clip_file import read_clip
from data_recipes.acting.procedural_acting import act
from data_recipes.deformers.face_build import build_step
from data_recipes.deformers.face_points import control_points, face_marks
from data_recipes.deformers.posed_props import rest_props
from data_recipes.deformers.sculpting import Sculptor
from data_recipes.early_checks import recipe_controls
from data_recipes.face_check import check_face
from data_recipes.face_rig import FaceParts, FaceRig
from data_recipes.head.neutral_head import build_head
from data_recipes.recipe.character import Recipe
from data_recipes.rig import Clip, check_rig
from replicate.base.exceptions import InputError
from replicate.base.schema import cut, naming
from replicate.geometry.mesh import Mesh


def build_recipe_rig(recipe: Recipe) -> FaceRig:
    """Build a character from its recipe.

    Raises InputError, naming the recipe or the clip, for anything in the recipe that cannot be.
    """
    controls = recipe_controls(recipe)
    clips = [Clip(Path(file).stem, read_clip(Path(file), controls)) for file in recipe.clip_files]
    clips = [Clip(name, values) for name, values in act(controls, recipe.acting)] + clips
    with naming(recipe.file), _as_bad_input():
        head = build_head(recipe)
        mesh = Mesh(
            neutral=head.vertices.astype(np.float32),
            faces=head.faces.astype(np.int32),
            uv=np.clip(head.uv, 0, 1).astype(np.float32),
            segment=head.segment.astype(np.int32),
            segment_names=head.segment_names,
        )
        sculptor = Sculptor(head)
        names, points, regions = control_points(sculptor, recipe.control_points)
        marks, mark_regions = face_marks(sculptor)
        chain, constants = build_step(head, controls, recipe.step)
        teeth = tuple(name for name in mesh.segment_names if name.startswith(("tooth", "teeth")))
        face = FaceParts(constants, rest_props(head), head.paint, chain, teeth)
    rig = FaceRig(
        name=recipe.name,
        mesh=mesh,
        controls=controls,
        landmarks=np.array(list(head.landmarks.values()), np.int32),
        landmark_names=tuple(head.landmarks),
        control_points=points,
        control_point_regions=regions,
        control_point_names=names,
        face_marks=marks,
        face_mark_regions=mark_regions,
        clips=tuple(clips) or None,
        face=face,
    )
    check_rig(rig)
    with naming(recipe.file):
        check_face(rig, recipe)
    return rig


@contextmanager
def _as_bad_input() -> Iterator[None]:
    """Turn the errors of geometry into an InputError: each number was within its range, but they fit no head."""
    try:
        yield
    except InputError:
        raise
    except (ArithmeticError, LookupError, ValueError) as error:
        raise InputError(f"no head can be built from these sections: {cut(str(error))}") from error
