"""A recipe: one character as numbers and choices, section by section."""

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
    Triple,
    Wrinkles,
    triple,
)
from replicate.base.schema import Checked, groups, identifier, names, number

# ruff: noqa: RUF009 — defaults are `dataclasses.field`s, or frozen

# The sections of a recipe that give a head its solid shape: the skull and the nose. Lengths in mm, angles in deg.


@dataclass(frozen=True)
class Skull(Checked):
    """The primitives of the head's signed distance function: centres, radii (mm)."""

    cranium: Triple = triple((0.0, 44.0, -12.0))
    cranium_radii: Triple = triple((75.0, 74.0, 86.0), 5.0)
    forehead: Triple = triple((0.0, 42.0, 34.0))
    forehead_radii: Triple = triple((60.0, 52.0, 48.0), 5.0)
    face: Triple = triple((0.0, -18.0, 20.0))
    face_radii: Triple = triple((61.0, 66.0, 64.0), 5.0)
    jaw_ramus: Triple = triple((54.0, -8.0, -6.0))
    jaw_angle: Triple = triple((37.0, -52.0, 8.0))
    jaw_radius: float = number(15.0, 2.0, 60.0)
    jaw_bow: Triple = triple((7.0, -5.0, 3.0))
    chin: Triple = triple((0.0, -95.0, 68.0))
    chin_radii: Triple = triple((19.0, 14.0, 15.0), 2.0)
    chin_blend: float = number(16.0, 1.0, 60.0)
    chin_corner: Triple = triple((9.0, -93.0, 64.0))
    neck_top: Triple = triple((0.0, -70.0, -10.0))
    neck_bottom: Triple = triple((0.0, -200.0, -30.0))
    neck_radii: tuple[float, float, float] = triple((40.0, 45.0, 22.0), 5.0)
    cheekbone: Triple = triple((40.0, -22.0, 57.0))
    cheekbone_radii: Triple = triple((21.0, 18.0, 20.0), 2.0)
    cheek: Triple = triple((28.0, -50.0, 58.0))
    cheek_radii: Triple = triple((27.0, 27.0, 25.0), 2.0)
    muzzle: Triple = triple((0.0, -62.0, 68.0))
    muzzle_radii: Triple = triple((30.0, 28.0, 24.0), 2.0)
    brow_inner: Triple = triple((11.0, 23.0, 80.0))
    brow_outer: Triple = triple((50.0, 26.0, 54.0))
    brow_radii: Triple = triple((7.0, 8.5, 20.0), 1.0)
    socket: Triple = triple((33.0, 1.0, 97.0))
    socket_radii: Triple = triple((28.0, 20.0, 20.0), 2.0)
    socket_yaw_deg: float = number(-20.0, -80.0, 80.0)
    jaw_pivot: Triple = triple((0.0, -14.0, 2.0))


@dataclass(frozen=True)
class Nose(Checked):
    """The nose's cones and the nostrils (mm).

    Three directions: nostrils open towards `nostril_facing`, are longest along `nostril_long` and lead on to
    `nostril_inwards`.
    """

    root: Triple = triple((0.0, 12.0, 77.0))
    root_radius: float = number(8.0, 1.0, 40.0)
    tip: Triple = triple((0.0, -31.0, 104.0))
    tip_radius: float = number(9.0, 1.0, 40.0)
    sidewall: Triple = triple((0.0, 4.0, 69.0))
    sidewall_radii: Triple = triple((7.0, 6.0, 9.0), 1.0)
    columella: Triple = triple((0.0, -41.0, 97.0))
    columella_radii: Triple = triple((6.5, 5.0, 7.0), 1.0)
    wing: Triple = triple((11.0, -36.5, 94.0))
    wing_radii: Triple = triple((8.0, 7.2, 9.5), 1.0)
    blend: float = number(20.0, 1.0, 60.0)
    wing_blend: float = number(8.0, 1.0, 40.0)
    nostril_axes: Triple = triple((2.5, 3.5, 5.0), 0.3, 30.0)
    nostril_place: Triple = triple((0.74, 0.73, 0.0), -30.0, 30.0)
    nostril_facing: Triple = triple((0.0, -1.0, 0.0), -1.0, 1.0)
    nostril_long: Triple = triple((0.25, 0.0, 1.0), -1.0, 1.0)
    nostril_inwards: Triple = triple((0.0, 0.8, -0.1), -1.0, 1.0)


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

    vertices: how many the built head must have.
    clip_files: animation as CSV (see `clip_file`), beside the invented acting or, with acting.clips = 0, instead of it;
    paths are relative to the recipe's folder. Without either there is no animation, and poses are drawn uniformly.
    layout: the one of the layouts that is used.
    step: how many of the deformers the rig has, 5 for the whole face (see `deformers.face_chain`).
    control_points: the points that inverse kinematics drags (§4), by the region whose network they feed.
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
        """The layout in use."""
        return getattr(self.layouts, self.layout)
