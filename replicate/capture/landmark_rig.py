"""The artefact "landmark_rig": a character's rig whose control points are the 54 landmarks of a face (§5.3.2).

So the IK networks of §4 work on landmarks unchanged.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from data_recipes.catalogue import character_parts, save_rig, with_face_landmarks
from data_recipes.recipe_paths import sample_folder
from data_recipes.rig import Rig
from replicate.base.exceptions import InputError
from replicate.engine.stage import Stage, StageContext
from replicate.inverse import ik_stage
from replicate.methods import artefacts
from replicate.methods.artefacts import Character
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference

if TYPE_CHECKING:
    import replicate.inverse.ik_network


NAME = "landmark_rig"


def stage(plan: Plan) -> Stage:
    """Return the stage that finds the landmarks on the plan's character."""
    if NAME in plan:
        return plan[NAME]
    if sample_folder(plan.config.character):
        raise InputError(
            f"{plan.character} is known by its samples alone: choose a character whose 54 landmarks are known"
        )
    recipe, files = character_parts(plan.config.character)
    return plan.stage(NAME, make, Character(recipe), artefacts.rig_stage(plan), files=files, per_seed=False)


def make(context: StageContext) -> None:
    """Write the rig once more, with its landmarks as control points."""
    rig = with_face_landmarks(artefacts.load_rig(context.inputs), context.config.recipe)
    save_rig(rig, context.out / "rig")
    rig.mesh.save(context.out / "mesh.npz")
    context.note(landmarks=len(rig.control_points))


def load_landmark_rig(inputs: Mapping[str, Path]) -> Rig:
    """Return the rig with landmarks as its control points."""
    return artefacts.load_rig(as_rig(inputs))


def as_rig(inputs: Mapping[str, Path]) -> dict[str, Path]:
    """Return the inputs with this rig as "rig", for stages that read its control points."""
    return {**inputs, "rig": inputs[NAME]}


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
    ik_stage.train(replace(context, inputs=as_rig(context.inputs)))


def load_networks(inputs: Mapping[str, Path], approximation: str) -> "replicate.inverse.ik_network.IkModel":
    """Return the networks that were trained through a method of that name."""
    from replicate.inverse.ik_network import load_ik

    return load_ik(inputs[stage_name(approximation)])
