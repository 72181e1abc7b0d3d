"""The artefact "landmark_rig": a character's rig whose control points are the 54 landmarks of a face (§5.3.2).

So the IK networks of §4 take landmarks without knowing of them.
"""

from collections.abc import Mapping
from pathlib import Path

from data_recipes.catalogue import character_parts
from data_recipes.recipe_paths import sample_folder
from data_recipes.rig import Rig
from replicate.artefacts import built_rig
from replicate.artefacts.built_rig import Character
from replicate.artefacts.plan import Plan
from replicate.engine.exceptions import InputError
from replicate.engine.stage import Stage, StageContext

NAME = "landmark_rig"


def stage(plan: Plan) -> Stage:
    """Return the stage that finds the landmarks on the plan's character."""
    if NAME in plan:
        return plan[NAME]
    if sample_folder(plan.config.character):
        raise InputError(
            f"{plan.character} is known by its samples alone: allowed are characters whose 54 landmarks are known"
        )
    recipe, files = character_parts(plan.config.character)
    return plan.stage(NAME, make, Character(recipe), built_rig.stage(plan), files=files, per_seed=False)


def make(context: StageContext) -> None:
    """Write the rig once more, with its landmarks as control points."""
    from data_recipes.catalogue import save_rig, with_face_landmarks

    rig = with_face_landmarks(built_rig.load(context.inputs), context.config.recipe)
    save_rig(rig, context.out / "rig")
    rig.mesh.save(context.out / "mesh.npz")
    context.note(landmarks=len(rig.control_points))


def load(inputs: Mapping[str, Path]) -> Rig:
    """Return the rig with landmarks as its control points."""
    return built_rig.load(as_rig(inputs))


def as_rig(inputs: Mapping[str, Path]) -> dict[str, Path]:
    """Return the inputs with this rig in the place of the other: for stages that ask for control points."""
    return {**inputs, "rig": inputs[NAME]}
