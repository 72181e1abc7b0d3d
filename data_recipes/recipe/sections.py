"""The sections of a recipe: what a head is made of, each number with its default (a neutral adult) and its range.

Lengths in mm, angles in degrees. Skull and nose are in `recipe.character`; `recipe.reading` reads all of it from TOML.
"""

from dataclasses import dataclass
from typing import Any, Literal

from replicate.base.schema import Checked, groups, names, number, numbers, span, table

# Declarations of fields that several sections have: points, directions and radii, colours, shares.

Triple = tuple[float, float, float]


def triple(default: Triple, lower: float = -300.0, upper: float = 300.0) -> Any:
    """Declare three numbers: a point or radii in mm, a direction."""
    return numbers(default, 3, lower, upper)


def colour(red: float, green: float, blue: float) -> Any:
    """Declare a colour, RGB from 0 to 1."""
    return numbers((red, green, blue), 3, 0.0, 1.0)


def share(default: float) -> Any:
    """Declare a share, 0 to 1."""
    return number(default, 0.0, 1.0)


# ruff: noqa: RUF009 — defaults are `dataclasses.field`s


# The parts of a head besides its teeth. Each has its chart unless a recipe puts several into one.
PARTS = (
    "face",
    "cranium",
    "neck",
    "ear_left",
    "ear_right",
    "lid_inner_left",
    "lid_inner_right",
    "mouth_bag",
    "gum_upper",
    "gum_lower",
    "tongue",
)


@dataclass(frozen=True)
class Eyes(Checked):
    """Eyeballs and lids. Angles are measured on the lid ball."""

    centre: Triple = triple((33.5, 0.0, 62.0))
    radius: float = number(20.5, 3.0, 60.0)
    yaw_deg: float = number(6.0, -60.0, 80.0)
    tilt_deg: float = number(4.0, -40.0, 40.0)
    lid_thickness: float = number(2.2, 0.2, 10.0)
    half_width_deg: float = number(50.0, 5.0, 80.0)
    upper_deg: float = number(23.0, 1.0, 80.0)
    lower_deg: float = number(18.0, 1.0, 80.0)
    crease: float = number(1.5, 0.0, 6.0)
    under_eye: float = number(0.5, 0.0, 6.0)
    gaze_yaw_deg: float = number(0.0, -80.0, 80.0)
    iris_deg: float = number(28.5, 2.0, 80.0)
    pupil_deg: float = number(12.0, 1.0, 79.0)
    pupil: Literal["round", "slit"] = "round"
    iris_colour: Triple = colour(0.20, 0.55, 0.30)


@dataclass(frozen=True)
class Mouth(Checked):
    """Lips and mouth bag.

    Curves live in wrapped coordinates: (a, b) is a ray from (0, b, axis_z) at the angle a/axis_radius.

    bag_wrap: how far the bag follows the lips' outline (1) instead of a circle (0).
    corner_reach: how far past the lips' ends their border runs, as a share of the half width.
    travel: how far actions move the lips across, up and out, as shares of what they do to a human mouth of this width.
    """

    y: float = number(-57.0, -300.0, 0.0)
    half_width: float = number(24.0, 2.0, 120.0)
    upper_fullness: float = number(1.0, 0.05, 4.0)
    lower_fullness: float = number(1.0, 0.05, 4.0)
    corner_curl: float = number(0.0, -12.0, 12.0)
    axis_z: float = number(26.0, -100.0, 100.0)
    axis_radius: float = number(62.0, 10.0, 200.0)
    half_gap: float = number(0.06, 0.005, 2.0)
    philtrum: float = number(1.0, 0.0, 4.0)
    corner_reach: float = number(0.10, 0.0, 0.5)
    travel: Triple = triple((1.0, 1.0, 1.0), 0.05, 4.0)
    bag_wrap: float = number(0.0, 0.0, 1.0)
    bag_rings: tuple[tuple[float, ...], ...] = table(
        (
            (0.0, 0.04, 1.6),
            (0.0, 0.1, 3.4),
            (0.03, 3.0, 5.0),
            (0.10, 9.0, 6.2),
            (0.20, 15.0, 7.6),
            (0.33, 19.0, 10.5),
            (0.46, 21.0, 14.5),
            (0.58, 21.0, 20.5),
            (0.70, 19.0, 28.5),
            (0.82, 15.0, 37.5),
            (0.90, 9.0, 46.0),
        ),
        3,
        0.0,
        400.0,
    )


@dataclass(frozen=True)
class Ears(Checked):
    """The outer ears: lofts over an egg-shaped outline; `flare_deg` turns them outwards, `point` lifts their tops."""

    centre: Triple = triple((70.0, -4.0, -8.0))
    height: float = number(58.0, 5.0, 200.0)
    width: float = number(33.0, 5.0, 150.0)
    lean_deg: float = number(14.0, -90.0, 90.0)
    flare_deg: float = number(34.0, 0.0, 85.0)
    point: float = number(0.0, 0.0, 5.0)


def _frill() -> Any:
    return numbers((), 12, -300.0, 300.0, optional=True)


@dataclass(frozen=True)
class Frills(Checked):
    """Pairs of leaf-shaped shells that stand out of the skin, none by default.

    Each has twelve numbers: its root (x, y, z on the left, brought onto the skin), its direction (3), the direction
    that its front faces (3), its length and width (mm), and by how much it bends towards its front (deg).
    """

    crown: tuple[float, ...] = _frill()
    temple: tuple[float, ...] = _frill()
    cheek: tuple[float, ...] = _frill()
    jaw: tuple[float, ...] = _frill()
    thickness: float = number(5.0, 0.5, 40.0)
    rows: int = number(8, 3, 40)
    ring: int = number(10, 8, 60, even=True)


@dataclass(frozen=True)
class Teeth(Checked):
    """Two arches of teeth.

    widths_upper, widths_lower: from the middle outwards, mm.
    lengths_upper, lengths_lower: factors in the same order, 1 where the list ends.
    overlap: each row reaches half of it past the other's edge.
    follow: how far the rows rise and fall with the lips' seam.
    """

    style: Literal["human", "cone", "strip"] = "human"
    upper: int = number(14, 2, 80, even=True)
    lower: int = number(12, 2, 80, even=True)
    ring: int = number(10, 6, 64, even=True)
    rings: int = number(5, 2, 12)
    widths_upper: tuple[float, ...] = number((8.4, 6.6, 7.6, 7.0, 7.0, 9.8, 9.6), 0.5, 60.0)
    widths_lower: tuple[float, ...] = number((5.4, 5.8, 6.8, 6.9, 7.1, 10.4, 10.0), 0.5, 60.0)
    lengths_upper: tuple[float, ...] = number((1.0,), 0.2, 4.0)
    lengths_lower: tuple[float, ...] = number((1.0,), 0.2, 4.0)
    overlap: float = number(0.0, -10.0, 40.0)
    follow: float = number(0.0, 0.0, 1.0)
    length: float = number(9.0, 0.5, 40.0)
    thickness: float = number(7.0, 0.5, 40.0)
    setback: float = number(10.0, 1.0, 60.0)
    arch_half_width: float = number(27.0, 3.0, 100.0)
    arch_depth: float = number(42.0, 3.0, 160.0)
    arch_power: float = number(2.3, 1.2, 6.0)
    overbite: float = number(1.6, -5.0, 12.0)
    bite_y: float = number(-1.5, -40.0, 40.0)


@dataclass(frozen=True)
class Tongue(Checked):
    """Gums and tongue."""

    rows: int = number(12, 2, 60)
    cap: tuple[int, ...] = span((2, 6), 1, 40)
    length: float = number(42.0, 3.0, 160.0)
    width: float = number(36.0, 3.0, 120.0)
    height: float = number(11.0, 1.0, 60.0)
    gum_rows: int = number(5, 3, 20)
    gum_columns_upper: int = number(41, 3, 121)
    gum_columns_lower: int = number(39, 3, 121)
    gum_height: float = number(7.0, 0.5, 40.0)
    gum_thickness: float = number(9.0, 0.5, 40.0)


@dataclass(frozen=True)
class Template(Checked):
    """The grid around the head, its holes (rows and half-columns), and their rings."""

    half_columns: int = number(42, 6, 120)
    neck_rows: int = number(9, 1, 60)
    face_columns: int = number(24, 2, 119)
    hair_row: int = number(79, 4, 300)
    anchors: tuple[tuple[float, ...], ...] = table((), 6, -400.0, 400.0)
    angles: tuple[tuple[float, ...], ...] = table((), 2, -400.0, 400.0)
    crown_across: int = number(22, 2, 100, even=True)
    mouth_rows: tuple[int, ...] = span((18, 26), 0, 300)
    mouth_columns: int = number(11, 1, 60)
    mouth_rings: int = number(11, 2, 40)
    lip_rings: int = number(4, 1, 20)
    corner_rings: int = number(2, 0, 20)  # rings beyond the lips that are pinned at the mouth's corners
    eye_rows: tuple[int, ...] = span((35, 47), 0, 300)
    eye_columns: tuple[int, ...] = span((6, 20), 1, 119)
    eye_rings: int = number(11, 1, 40)
    lid_rings: int = number(4, 1, 10)
    nostril_rows: tuple[int, ...] = span((28, 32), 0, 300)
    nostril_columns: tuple[int, ...] = span((2, 5), 1, 119)
    nostril_rings: int = number(4, 1, 10)
    ear_rows: tuple[int, ...] = span((33, 44), 0, 300)
    ear_columns: tuple[int, ...] = span((26, 31), 1, 119)
    ear_rings: int = number(11, 3, 30)
    coarse_rows: tuple[int, ...] = span((31, 85), 0, 300)
    coarse_from: int = number(32, 1, 119)
    nose_weight: float = number(2.5, 0.0, 30.0)  # how much more densely the nose is covered than the back of the head
    iterations: int = number(140, 1, 2000)


@dataclass(frozen=True)
class Props(Checked):
    """Hair, clothes and colours, which are shown in pictures and not part of the approximated mesh.

    Colours are RGB from 0 to 1; each share says how much of a part's colour covers the skin there.

    lip: lips. blush: cheeks, nose tip and ears. lid: lids and the skin under the eyes.
    back: crown, nape and snout ridge. throat: throat.
    horn_length: 1 gives horns of 11 to 38 mm on a cranium 74 mm high.
    """

    hair: Literal["cap", "short", "bob", "none"] = "cap"
    brows: Literal["natural", "thin", "thick", "none"] = "natural"
    lashes: Literal["short", "long", "none"] = "short"
    horns: Literal["crown", "none"] = "none"
    bust: Literal["shirt", "neck", "none"] = "shirt"
    horn_length: float = number(1.0, 0.1, 3.0)
    horn_colour: Triple = colour(0.16, 0.17, 0.20)
    hair_colour: Triple = colour(0.50, 0.28, 0.14)
    shirt_colour: Triple = colour(0.44, 0.48, 0.52)
    skin_colour: Triple = colour(0.90, 0.71, 0.59)
    lip_colour: Triple = colour(0.80, 0.45, 0.42)
    lip: float = share(0.75)
    blush_colour: Triple = colour(0.87, 0.47, 0.40)
    blush: float = share(0.40)
    lid_colour: Triple = colour(0.74, 0.48, 0.41)
    lid: float = share(0.35)
    back_colour: Triple = colour(0.12, 0.16, 0.22)
    back: float = share(0.0)
    throat_colour: Triple = colour(0.42, 0.50, 0.58)
    throat: float = share(0.0)


@dataclass(frozen=True)
class Controls(Checked):
    """How many controls of each group the rig has: the first ones of the lists in `data_recipes.controls`."""

    face: int = number(52, 0, 57)
    jaw: int = number(16, 0, 16)
    lids: int = number(24, 0, 24)
    lips: int = number(36, 0, 36)
    handles: int = number(96, 0, 96)
    wrinkles: int = number(14, 0, 14)
    head: int = number(12, 0, 12)
    lid_follow: int = number(8, 0, 10)
    creature: int = number(0, 0, 28)


@dataclass(frozen=True)
class Limits(Checked):
    """How far the controls go.

    reach: their limits, as a share of a full performance; poses that are drawn uniformly use all controls at once and
    need less than 1.
    full: controls that keep their whole range, such as "blink_*", for both sides.
    """

    reach: float = number(1.0, 0.05, 1.0)
    full: tuple[str, ...] = names()


@dataclass(frozen=True)
class Wrinkles(Checked):
    """How the skin folds.

    unevenness: how far folds differ in spacing, depth and length, and branch; 0 gives even rows.
    tension: how far skin is stretched at rest, as a share of its length; if it shortens by less, it does not fold.
    """

    unevenness: float = share(1.0)
    tension: float = number(0.02, 0.012, 0.2)
    seed: int = number(0, 0, 1_000_000)


@dataclass(frozen=True)
class ChartLayout(Checked):
    """How the head is cut into segments, each with its chart.

    segments: which parts share a segment, by the segment's name; every other part is a segment by itself.
    face_bands: how many segments with equal numbers of vertices the face is cut into, from the chin upwards.
    evenness: how evenly a band's vertices are spread over its chart, along both axes; 0 leaves them where the whole
    face's chart has them.
    """

    segments: dict[str, tuple[str, ...]] = groups(
        {"lids_inner": ("lid_inner_left", "lid_inner_right")}, PARTS, "the parts"
    )
    face_bands: int = number(1, 1, 16)
    evenness: float = share(0.0)


@dataclass(frozen=True)
class Layouts(Checked):
    """The layouts that a recipe can choose: the face in one chart, as the paper's Fig. 13 implies, or in several."""

    one_face: ChartLayout = ChartLayout()
    fine: ChartLayout = ChartLayout(face_bands=4)
