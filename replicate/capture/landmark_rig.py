"""The artefact "landmark_rig": a character's rig whose control points are the 54 landmarks of a face (§5.3.2).

So the IK networks of §4 work on landmarks unchanged. Of a rig that is known by its samples only the points are written.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from data_recipes.catalogue import character_parts, sampled_parts, save_rig, with_face_landmarks, without_landmarks
from data_recipes.recipe_paths import sample_folder
from data_recipes.rig import AlteredRig, Rig, has_function
from replicate.base.exceptions import InputError
from replicate.base.files import write_text
from replicate.engine.stage import Stage, StageContext
from replicate.inverse import ik_stage
from replicate.methods import artefacts
from replicate.methods.artefacts import Character
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference

if TYPE_CHECKING:
    import replicate.inverse.ik_network


NAME, POINTS = "landmark_rig", "points.json"
FIELDS = ("control_points", "control_point_names", "control_point_regions")


def stage(plan: Plan) -> Stage:
    """Return the stage that finds the landmarks on the plan's character, or takes those that its face.toml names.

    Raises InputError for a face whose landmarks nobody named and that has no shapes to find them by.
    """
    if NAME in plan:
        return plan[NAME]
    folder = sample_folder(plan.config.character)
    recipe, files = sampled_parts(folder) if folder else character_parts(plan.config.character)
    if sentence := without_landmarks(recipe, files):
        raise InputError(f"{plan.character}: {sentence}")
    return plan.stage(NAME, make, Character(recipe), artefacts.rig_stage(plan), files=files, per_seed=False)


def make(context: StageContext) -> None:
    """Write the rig once more, with its landmarks as control points."""
    rig = with_face_landmarks(artefacts.load_rig(context.inputs), context.config.recipe)
    if has_function(rig):
        save_rig(rig, context.out / "rig")
        rig.mesh.save(context.out / "mesh.npz")
    else:
        values = (rig.control_points.tolist(), rig.control_point_names, rig.control_point_regions)
        write_text(context.out / POINTS, json.dumps(dict(zip(FIELDS, values, strict=True))) + "\n")
    context.note(landmarks=len(rig.control_points))


def load_landmark_rig(inputs: Mapping[str, Path], character: str = "") -> Rig:
    """Return the rig with landmarks as its control points. character: whose, where the inputs have several."""
    folder = inputs[f"{NAME}-{character}" if character else NAME]
    if not (folder / POINTS).is_file():
        return artefacts.load_rig({"rig": folder})
    vertices, *labels = (json.loads((folder / POINTS).read_text(encoding="utf-8"))[name] for name in FIELDS)
    points = [np.array(vertices, np.int32), *map(tuple, labels)]
    return AlteredRig(artefacts.load_rig(inputs), **dict(zip(FIELDS, points, strict=True)))


# The artefacts "capture_ik_…": the IK networks of §4 with landmarks as their control points (§5.3.2).

PREFIX = "capture_ik"


def stage_name(approximation: str) -> str:
    """Return the name of the stage for a method's name."""
    return f"{PREFIX}_{approximation}"


def ik_stage_of(plan: Plan, method: Method) -> Stage:
    """Return the stage that trains the networks through a method's model, as `ik_stage` does."""
    through_rig_points = ik_stage.stage(plan, method)
    functions = ",".join([reference(train_networks), reference(method.model)])
    return plan.stage(
        stage_name(method.name), functions, through_rig_points.config, *through_rig_points.inputs, stage(plan)
    )


def train_networks(context: StageContext) -> None:
    """Train the IK networks (§4.2) on the landmarks of the samples."""
    ik_stage.train(context, load_landmark_rig(context.inputs))


def load_networks(inputs: Mapping[str, Path], approximation: str) -> "replicate.inverse.ik_network.IkModel":
    """Return the networks that were trained through a method of that name."""
    from replicate.inverse.ik_network import load_ik

    return load_ik(inputs[stage_name(approximation)])
