"""Artefacts for those who work outside the graph: made by their stages if they are not there yet."""

import sys

from replicate.config import resolve
from replicate.engine.provenance import as_lines, core_count, package_versions, provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage, in_order
from replicate.engine.store import artefact_folder
from replicate.pipeline import table2_graph


def made_rig(character: str):
    """Return a character's rig. Raises InputError for an unknown one or a bad recipe."""
    from data_recipes.rig import load_rig

    stage = _rig_stage(character)
    run([stage], facts=provenance(["python", *sys.orig_argv[1:]], "any", [], core_count()))
    return load_rig(artefact_folder(stage.identifier) / "rig")


def rig_identifier(character: str) -> str:
    """Return the name of a rig's artefact, which ends with a hash of its recipe and of all sources behind it."""
    return _rig_stage(character).identifier


def rig_provenance_text(character: str) -> str:
    """Return what tells a rig from others, in a few lines.

    The artefact's name ends with a hash of the recipe and of all sources that the rig depends on.
    """
    packages = package_versions()
    facts = {
        "rig": character,
        "artefact": _rig_stage(character).identifier,
        "packages": ", ".join(f"{name} {packages[name]}" for name in ("jax", "jaxlib", "numpy", "scipy")),
    }
    return as_lines(facts)


def _rig_stage(character: str) -> Stage:
    return next(stage for stage in in_order(table2_graph(resolve(character))) if stage.name == "rig")
