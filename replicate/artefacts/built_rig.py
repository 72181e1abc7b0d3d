"""The artefact "rig": a character, built from its recipe or read from its samples, and its mesh alone."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from data_recipes.catalogue import character_parts, sampled_parts
from data_recipes.recipe_paths import sample_folder
from data_recipes.rig import Rig
from replicate.artefacts.plan import Plan
from replicate.config import resolve
from replicate.engine.provenance import as_lines, core_count, package_versions, provenance
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh


@dataclass(frozen=True)
class Character:
    """Which rig to build: a recipe, or what a folder of samples says, free of the place that it lies at."""

    recipe: object


def stage(plan: Plan) -> Stage:
    """Return the stage that builds the plan's character. Raises InputError for a bad recipe."""
    if "rig" in plan:
        return plan["rig"]
    if folder := sample_folder(plan.config.character):
        settings, files = sampled_parts(folder)
        return plan.stage("rig", make_sampled, Character(settings), files=files, per_seed=False)
    recipe, files = character_parts(plan.config.character)
    return plan.stage("rig", make, Character(recipe), files=files, per_seed=False)


def make(context: StageContext) -> None:
    """Build a character's rig, and write it with its mesh."""
    from data_recipes.catalogue import build_from_parts, save_rig

    rig = build_from_parts(context.config.recipe, context.files)
    save_rig(rig, context.out / "rig")
    rig.mesh.save(context.out / "mesh.npz")
    context.note(vertices=len(rig.mesh.neutral), faces=len(rig.mesh.faces), parameters=len(rig.controls))


def make_sampled(context: StageContext) -> None:
    """Read the samples of a rig that is known by these alone, and write them with its mesh."""
    from data_recipes.catalogue import import_sampled

    rig = import_sampled(context.config.recipe, context.files, context.out / "rig", context.progress)
    rig.mesh.save(context.out / "mesh.npz")
    sizes = {"vertices": len(rig.mesh.neutral), "faces": len(rig.mesh.faces), "parameters": len(rig.controls)}
    context.note(**sizes, poses=len(rig.known_poses), source=rig.source, licence=rig.licence)


def load(inputs: Mapping[str, Path]) -> Rig:
    """Return the rig. inputs: the folder of the artefact by its name, "rig", among others."""
    from data_recipes.catalogue import load_rig

    return load_rig(inputs["rig"] / "rig")


def load_mesh(inputs: Mapping[str, Path]) -> Mesh:
    """Return the rig's mesh, without the rig."""
    return Mesh.load(inputs["rig"] / "mesh.npz")


def rig_of(character: str) -> Rig:
    """Return a character's rig, which is built unless the store has it: for those who work outside a graph.

    Raises InputError for an unknown character or a bad recipe.
    """
    from replicate.engine.scheduler import run

    facts = provenance(["python", *sys.orig_argv[1:]], "any", [], core_count())
    own = stage(Plan(resolve(character)))
    return load({"rig": run([own], facts=facts)[own.title]})


def rig_identifier(character: str) -> str:
    """Return the name of a rig's artefact, which ends with a hash of its recipe and of all sources behind it."""
    return stage(Plan(resolve(character))).identifier


def rig_provenance_text(character: str) -> str:
    """Return a rig's name, artefact and packages, in a few lines."""
    packages = package_versions()
    return as_lines(
        {
            "rig": character,
            "artefact": rig_identifier(character),
            "packages": ", ".join(f"{name} {packages[name]}" for name in ("jax", "jaxlib", "numpy", "scipy")),
        }
    )
