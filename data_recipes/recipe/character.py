"""A recipe: one character as numbers and choices, section by section."""
# ruff: noqa: RUF009 — what stands as a default is a `dataclasses.field`, or frozen

from dataclasses import dataclass
from typing import Literal

from data_recipes.acting.procedural_acting import Acting
from data_recipes.recipe.sections import (
    ChartLayout,
    Controls,
    Ears,
    Eyes,
    Frills,
    Layouts,
    Limits,
    Mouth,
    Props,
    Teeth,
    Template,
    Tongue,
    Wrinkles,
)
from data_recipes.recipe.skull import Nose, Skull
from replicate.engine.schema import Checked, groups, identifier, names, number

VERTICES_MOST = 1_000_000
CONTROL_POINTS = {  # of a human face
    "brows": ("brow_left_01", "brow_left_03", "brow_right_01", "brow_right_03"),
    "eye_left": ("lid_upper_left", "lid_lower_left"),
    "eye_right": ("lid_upper_right", "lid_lower_right"),
    "cheeks": ("cheek_left_02", "cheek_right_02"),
    "nose": ("nose_tip", "nose_wing_left", "nose_wing_right"),
    "mouth": (
        "mouth_corner_left",
        "mouth_corner_right",
        "lip_upper_02",
        "lip_upper_03",
        "lip_upper_04",
        "lip_lower_02",
        "lip_lower_03",
        "lip_lower_04",
    ),
    "jaw": ("chin",),
}


@dataclass(frozen=True)
class Recipe(Checked):
    """One character.

    vertices: the exact count that the built head must have. clip_files: animation of one's own as CSV (see
    `clip_file`), beside the invented acting or, with acting.clips = 0, instead of it; in the file their paths are
    relative to its folder. A recipe with neither has no animation, and its poses are drawn uniformly. layout: which of
    the layouts counts. control_points: the points that inverse kinematics drags (§4), by the region whose network they
    feed. step: how many of the deformers the rig has, 5 for the whole face (see `deformers.face_chain`).
    """

    name: str = identifier()
    vertices: int = number(lower=1, upper=VERTICES_MOST)
    file: str = "<memory>"
    clip_files: tuple[str, ...] = names(what="paths of CSV files")
    layout: Literal["one_face", "fine"] = "one_face"
    step: int = number(5, 1, 6)
    control_points: dict[str, tuple[str, ...]] = groups(CONTROL_POINTS, (), "names of control points")
    layouts: Layouts = Layouts()
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
    wrinkles: Wrinkles = Wrinkles()
    acting: Acting = Acting()

    @property
    def charts(self) -> ChartLayout:
        """The layout that counts."""
        return getattr(self.layouts, self.layout)
