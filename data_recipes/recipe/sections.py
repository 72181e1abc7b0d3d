"""The sections of a recipe: what a head is made of, each number with its default (a neutral adult) and its range.

Lengths in mm, angles in degrees. `recipe.reading` reads them from TOML and checks them against what stands here.
"""
# ruff: noqa: RUF009 — what stands as a default is a `dataclasses.field`

from __future__ import annotations

from dataclasses import dataclass, field

Triple = tuple[float, float, float]

# What a head is made of besides its teeth. Each part has a chart of its own unless a recipe puts several into one.
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


def _number(default: float, lower: float, upper: float):
    return field(default=default, metadata={"kind": "number", "range": (lower, upper)})


def _count(default: int, lower: int, upper: int, even: bool = False):
    return field(default=default, metadata={"kind": "count", "range": (lower, upper), "even": even})


def _triple(default: Triple, lower: float = -300.0, upper: float = 300.0):
    return field(default=default, metadata={"kind": "tuple", "length": 3, "range": (lower, upper)})


def _colour(red: float, green: float, blue: float):
    return _triple((red, green, blue), 0.0, 1.0)


def _share(default: float):
    return _number(default, 0.0, 1.0)


def _list(default: tuple[float, ...], lower: float, upper: float):
    return field(default=default, metadata={"kind": "list", "range": (lower, upper)})


def _span(default: tuple[int, ...], lower: int, upper: int):
    """A range of template rows or columns, [first, last]."""
    return field(default=default, metadata={"kind": "span", "range": (lower, upper)})


def _choice(default: str, *options: str):
    return field(default=default, metadata={"kind": "choice", "options": options})


def _table(default: tuple[tuple[float, ...], ...], width: int, lower: float = -400.0, upper: float = 400.0):
    return field(default=default, metadata={"kind": "table", "width": width, "range": (lower, upper)})


@dataclass(frozen=True)
class Skull:
    """The primitives of the head's signed distance function: centres, radii (mm)."""

    cranium: Triple = _triple((0.0, 44.0, -12.0))
    cranium_radii: Triple = _triple((75.0, 74.0, 86.0), 5.0)
    forehead: Triple = _triple((0.0, 42.0, 34.0))
    forehead_radii: Triple = _triple((60.0, 52.0, 48.0), 5.0)
    face: Triple = _triple((0.0, -18.0, 20.0))
    face_radii: Triple = _triple((61.0, 66.0, 64.0), 5.0)
    jaw_ramus: Triple = _triple((54.0, -8.0, -6.0))
    jaw_angle: Triple = _triple((37.0, -52.0, 8.0))
    jaw_radius: float = _number(15.0, 2.0, 60.0)
    jaw_bow: Triple = _triple((7.0, -5.0, 3.0))
    chin: Triple = _triple((0.0, -95.0, 68.0))
    chin_radii: Triple = _triple((19.0, 14.0, 15.0), 2.0)
    chin_blend: float = _number(16.0, 1.0, 60.0)
    chin_corner: Triple = _triple((9.0, -93.0, 64.0))
    neck_top: Triple = _triple((0.0, -70.0, -10.0))
    neck_bottom: Triple = _triple((0.0, -200.0, -30.0))
    neck_radii: tuple[float, float, float] = _triple((40.0, 45.0, 22.0), 5.0)
    cheekbone: Triple = _triple((40.0, -22.0, 57.0))
    cheekbone_radii: Triple = _triple((21.0, 18.0, 20.0), 2.0)
    cheek: Triple = _triple((28.0, -50.0, 58.0))
    cheek_radii: Triple = _triple((27.0, 27.0, 25.0), 2.0)
    muzzle: Triple = _triple((0.0, -62.0, 68.0))
    muzzle_radii: Triple = _triple((30.0, 28.0, 24.0), 2.0)
    brow_inner: Triple = _triple((11.0, 23.0, 80.0))
    brow_outer: Triple = _triple((50.0, 26.0, 54.0))
    brow_radii: Triple = _triple((7.0, 8.5, 20.0), 1.0)
    socket: Triple = _triple((33.0, 1.0, 97.0))
    socket_radii: Triple = _triple((28.0, 20.0, 20.0), 2.0)
    socket_yaw_deg: float = _number(-20.0, -80.0, 80.0)
    jaw_pivot: Triple = _triple((0.0, -14.0, 2.0))


@dataclass(frozen=True)
class Nose:
    """The nose's cones and the nostrils (mm).

    Nostrils open towards `nostril_facing`, are longest along `nostril_long` and lead on to `nostril_inwards`, three
    directions.
    """

    root: Triple = _triple((0.0, 12.0, 77.0))
    root_radius: float = _number(8.0, 1.0, 40.0)
    tip: Triple = _triple((0.0, -31.0, 104.0))
    tip_radius: float = _number(9.0, 1.0, 40.0)
    sidewall: Triple = _triple((0.0, 4.0, 69.0))
    sidewall_radii: Triple = _triple((7.0, 6.0, 9.0), 1.0)
    columella: Triple = _triple((0.0, -41.0, 97.0))
    columella_radii: Triple = _triple((6.5, 5.0, 7.0), 1.0)
    wing: Triple = _triple((11.0, -36.5, 94.0))
    wing_radii: Triple = _triple((8.0, 7.2, 9.5), 1.0)
    blend: float = _number(20.0, 1.0, 60.0)
    wing_blend: float = _number(8.0, 1.0, 40.0)
    nostril_axes: Triple = _triple((2.5, 3.5, 5.0), 0.3, 30.0)
    nostril_place: Triple = _triple((0.74, 0.73, 0.0), -30.0, 30.0)
    nostril_facing: Triple = _triple((0.0, -1.0, 0.0), -1.0, 1.0)
    nostril_long: Triple = _triple((0.25, 0.0, 1.0), -1.0, 1.0)
    nostril_inwards: Triple = _triple((0.0, 0.8, -0.1), -1.0, 1.0)


@dataclass(frozen=True)
class Eyes:
    """Eyeballs and lids. Angles are measured on the lid ball."""

    centre: Triple = _triple((33.5, 0.0, 62.0))
    radius: float = _number(20.5, 3.0, 60.0)
    yaw_deg: float = _number(6.0, -60.0, 80.0)
    tilt_deg: float = _number(4.0, -40.0, 40.0)
    lid_thickness: float = _number(2.2, 0.2, 10.0)
    half_width_deg: float = _number(50.0, 5.0, 80.0)
    upper_deg: float = _number(23.0, 1.0, 80.0)
    lower_deg: float = _number(18.0, 1.0, 80.0)
    crease: float = _number(1.5, 0.0, 6.0)
    under_eye: float = _number(0.5, 0.0, 6.0)
    gaze_yaw_deg: float = _number(0.0, -80.0, 80.0)
    iris_deg: float = _number(28.5, 2.0, 80.0)
    pupil_deg: float = _number(12.0, 1.0, 79.0)
    pupil: str = _choice("round", "round", "slit")
    iris_colour: Triple = _colour(0.20, 0.55, 0.30)


@dataclass(frozen=True)
class Mouth:
    """Lips and mouth bag.

    Curves live in wrapped coordinates: (a, b) is a ray from (0, b, axis_z) at the angle a/axis_radius.
    bag_wrap: how far the bag follows the lips' own outline (1) instead of a circle (0).
    corner_reach: how far past the lips' ends their border runs, as a share of the half width.
    travel: how far actions move the lips across, up and out, as shares of what they do to a human mouth of this width.
    """

    y: float = _number(-57.0, -300.0, 0.0)
    half_width: float = _number(24.0, 2.0, 120.0)
    upper_fullness: float = _number(1.0, 0.05, 4.0)
    lower_fullness: float = _number(1.0, 0.05, 4.0)
    corner_curl: float = _number(0.0, -12.0, 12.0)
    axis_z: float = _number(26.0, -100.0, 100.0)
    axis_radius: float = _number(62.0, 10.0, 200.0)
    half_gap: float = _number(0.06, 0.005, 2.0)
    philtrum: float = _number(1.0, 0.0, 4.0)
    corner_reach: float = _number(0.10, 0.0, 0.5)
    travel: Triple = _triple((1.0, 1.0, 1.0), 0.05, 4.0)
    bag_wrap: float = _number(0.0, 0.0, 1.0)
    bag_rings: tuple[tuple[float, ...], ...] = _table(
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
    )


@dataclass(frozen=True)
class Ears:
    """The outer ears: lofts over an egg-shaped outline; `flare_deg` turns them outwards, `point` lifts their tops."""

    centre: Triple = _triple((70.0, -4.0, -8.0))
    height: float = _number(58.0, 5.0, 200.0)
    width: float = _number(33.0, 5.0, 150.0)
    lean_deg: float = _number(14.0, -90.0, 90.0)
    flare_deg: float = _number(34.0, 0.0, 85.0)
    point: float = _number(0.0, 0.0, 5.0)


def _frill():
    return field(default=(), metadata={"kind": "tuple", "length": 12, "range": (-300.0, 300.0)})


@dataclass(frozen=True)
class Frills:
    """Pairs of leaf-shaped shells that stand out of the skin, none by default.

    Each has twelve numbers: its root (x, y, z on the left, brought onto the skin), its direction (3), what its front
    looks at (3), its length and width (mm), and by how much it bends towards its front (deg).
    """

    crown: tuple[float, ...] = _frill()
    temple: tuple[float, ...] = _frill()
    cheek: tuple[float, ...] = _frill()
    jaw: tuple[float, ...] = _frill()
    thickness: float = _number(5.0, 0.5, 40.0)
    rows: int = _count(8, 3, 40)
    ring: int = _count(10, 8, 60, even=True)


@dataclass(frozen=True)
class Teeth:
    """Two arches of teeth; `widths` runs from the middle outwards (mm).

    lengths_upper, lengths_lower: factors in the same order, 1 where the list ends.
    overlap: each row reaches half of it past the other's edge. follow: how far the rows rise and fall with the seam.
    """

    style: str = _choice("human", "human", "cone", "strip")
    upper: int = _count(14, 2, 80, even=True)
    lower: int = _count(12, 2, 80, even=True)
    ring: int = _count(10, 6, 64, even=True)
    rings: int = _count(5, 2, 12)
    widths_upper: tuple[float, ...] = _list((8.4, 6.6, 7.6, 7.0, 7.0, 9.8, 9.6), 0.5, 60.0)
    widths_lower: tuple[float, ...] = _list((5.4, 5.8, 6.8, 6.9, 7.1, 10.4, 10.0), 0.5, 60.0)
    lengths_upper: tuple[float, ...] = _list((1.0,), 0.2, 4.0)
    lengths_lower: tuple[float, ...] = _list((1.0,), 0.2, 4.0)
    overlap: float = _number(0.0, -10.0, 40.0)
    follow: float = _number(0.0, 0.0, 1.0)
    length: float = _number(9.0, 0.5, 40.0)
    thickness: float = _number(7.0, 0.5, 40.0)
    setback: float = _number(10.0, 1.0, 60.0)
    arch_half_width: float = _number(27.0, 3.0, 100.0)
    arch_depth: float = _number(42.0, 3.0, 160.0)
    arch_power: float = _number(2.3, 1.2, 6.0)
    overbite: float = _number(1.6, -5.0, 12.0)
    bite_y: float = _number(-1.5, -40.0, 40.0)


@dataclass(frozen=True)
class Tongue:
    """Gums and tongue."""

    rows: int = _count(12, 2, 60)
    cap: tuple[int, ...] = _span((2, 6), 1, 40)
    length: float = _number(42.0, 3.0, 160.0)
    width: float = _number(36.0, 3.0, 120.0)
    height: float = _number(11.0, 1.0, 60.0)
    gum_rows: int = _count(5, 3, 20)
    gum_columns_upper: int = _count(41, 3, 121)
    gum_columns_lower: int = _count(39, 3, 121)
    gum_height: float = _number(7.0, 0.5, 40.0)
    gum_thickness: float = _number(9.0, 0.5, 40.0)


@dataclass(frozen=True)
class Template:
    """The grid around the head, its holes (rows and half-columns), and their rings."""

    half_columns: int = _count(42, 6, 120)
    neck_rows: int = _count(9, 1, 60)
    face_columns: int = _count(24, 2, 119)
    hair_row: int = _count(79, 4, 300)
    anchors: tuple[tuple[float, ...], ...] = _table((), 6)
    angles: tuple[tuple[float, ...], ...] = _table((), 2)
    crown_across: int = _count(22, 2, 100, even=True)
    mouth_rows: tuple[int, ...] = _span((18, 26), 0, 300)
    mouth_columns: int = _count(11, 1, 60)
    mouth_rings: int = _count(11, 2, 40)
    lip_rings: int = _count(4, 1, 20)
    corner_rings: int = _count(2, 0, 20)  # rings beyond the lips that are pinned at the mouth's corners
    eye_rows: tuple[int, ...] = _span((35, 47), 0, 300)
    eye_columns: tuple[int, ...] = _span((6, 20), 1, 119)
    eye_rings: int = _count(11, 1, 40)
    lid_rings: int = _count(4, 1, 10)
    nostril_rows: tuple[int, ...] = _span((28, 32), 0, 300)
    nostril_columns: tuple[int, ...] = _span((2, 5), 1, 119)
    nostril_rings: int = _count(4, 1, 10)
    ear_rows: tuple[int, ...] = _span((33, 44), 0, 300)
    ear_columns: tuple[int, ...] = _span((26, 31), 1, 119)
    ear_rings: int = _count(11, 3, 30)
    coarse_rows: tuple[int, ...] = _span((31, 85), 0, 300)
    coarse_from: int = _count(32, 1, 119)
    nose_weight: float = _number(2.5, 0.0, 30.0)  # how much more densely the nose is covered than the back of the head
    iterations: int = _count(140, 1, 2000)


@dataclass(frozen=True)
class Props:
    """Display-only things: they ride along in pictures and are no part of the approximated mesh.

    Colours are RGB from 0 to 1. `lip`, `blush`, `lid`, `back` and `throat` are how much of a part's colour covers the
    skin: lips; cheeks, nose tip and ears; lids and what lies under the eyes; crown, nape and snout ridge; throat.
    horn_length: 1 gives horns of 11 to 38 mm on a cranium 74 mm high.
    """

    hair: str = _choice("cap", "cap", "short", "bob", "none")
    brows: str = _choice("natural", "natural", "thin", "thick", "none")
    lashes: str = _choice("short", "short", "long", "none")
    horns: str = _choice("none", "crown", "none")
    horn_length: float = _number(1.0, 0.1, 3.0)
    horn_colour: Triple = _colour(0.16, 0.17, 0.20)
    hair_colour: Triple = _colour(0.50, 0.28, 0.14)
    skin_colour: Triple = _colour(0.90, 0.71, 0.59)
    lip_colour: Triple = _colour(0.80, 0.45, 0.42)
    lip: float = _share(0.75)
    blush_colour: Triple = _colour(0.87, 0.47, 0.40)
    blush: float = _share(0.40)
    lid_colour: Triple = _colour(0.74, 0.48, 0.41)
    lid: float = _share(0.35)
    back_colour: Triple = _colour(0.12, 0.16, 0.22)
    back: float = _share(0.0)
    throat_colour: Triple = _colour(0.42, 0.50, 0.58)
    throat: float = _share(0.0)


@dataclass(frozen=True)
class Controls:
    """How many controls of each group the rig has: the first ones of the lists in `data_recipes.controls`."""

    face: int = _count(52, 0, 57)
    jaw: int = _count(16, 0, 16)
    lids: int = _count(24, 0, 24)
    lips: int = _count(36, 0, 36)
    handles: int = _count(96, 0, 96)
    wrinkles: int = _count(14, 0, 14)
    head: int = _count(12, 0, 12)
    lid_follow: int = _count(8, 0, 10)
    creature: int = _count(0, 0, 28)


@dataclass(frozen=True)
class Limits:
    """How far the controls go.

    reach: their limits, as a share of a full performance; a rig whose poses are drawn uniformly has all of its controls
    on at once. full: those that keep their whole range, such as "blink_*", for both sides.
    """

    reach: float = _number(1.0, 0.05, 1.0)
    full: tuple[str, ...] = field(default=(), metadata={"kind": "names"})
