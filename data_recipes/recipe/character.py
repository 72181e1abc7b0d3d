"""A recipe: one character as numbers and choices, section by section."""
# ruff: noqa: RUF009 — what stands as a default is a `dataclasses.field`, or frozen

from dataclasses import dataclass

from data_recipes.acting.procedural_acting import Acting
from data_recipes.recipe.sections import (
    PARTS,
    Controls,
    Ears,
    Eyes,
    Frills,
    Limits,
    Mouth,
    Props,
    Teeth,
    Template,
    Tongue,
)
from data_recipes.recipe.skull import Nose, Skull
from replicate.engine.schema import Checked, groups, identifier, names, number

VERTICES_MOST = 1_000_000


@dataclass(frozen=True)
class Recipe(Checked):
    """One character.

    vertices: the exact count that the built head must have. clip_files: animation of one's own as CSV (see
    `clip_file`), beside the invented acting or, with acting.clips = 0, instead of it; in the file their paths are
    relative to its folder. A recipe with neither has no animation, and its poses are drawn uniformly. segments: which
    parts of the head share a segment, and so a chart, by the segment's name; every other part is a segment.
    """

    name: str = identifier()
    vertices: int = number(lower=1, upper=VERTICES_MOST)
    file: str = "<memory>"
    clip_files: tuple[str, ...] = names(what="paths of CSV files")
    segments: dict[str, tuple[str, ...]] = groups({"lids_inner": ("lid_inner_left", "lid_inner_right")}, PARTS, "parts")
    skull: Skull = Skull()
    nose: Nose = Nose()
    eyes: Eyes = Eyes()
    mouth: Mouth = Mouth()
    ears: Ears = Ears()
    frills: Frills = Frills()
    teeth: Teeth = Teeth()
    tongue: Tongue = Tongue()
    template: Template = Template()
    props: Props = Props()
    controls: Controls = Controls()
    limits: Limits = Limits()
    acting: Acting = Acting()
