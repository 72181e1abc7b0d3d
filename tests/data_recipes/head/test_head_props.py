"""Eyes, brows, lashes and hair sit where they belong on the head: display only, but seen in every picture."""

from dataclasses import replace

import heads
import numpy as np
import pytest

from data_recipes.head import hair
from data_recipes.head.hair_locks import head_centre
from data_recipes.head.head_props import BROW_COLUMNS, BROW_ROWS, CREST, HORN_COLUMNS, PAIRS, build_props
from data_recipes.head.shape import lidded_distance, skull_distance
from data_recipes.head.topology import build_layout
from data_recipes.recipe.reading import load_recipe

ZONES = ("white", "limbus", "iris", "pupil")
EYES = {f"eye_{zone}_{side}" for zone in ZONES for side in ("left", "right")}


def props_with(head, **changes):
    """Return the props by name of the tiny head with another `[props]`."""
    recipe = replace(head.recipe, props=replace(head.recipe.props, **changes))
    return {prop.name: prop for prop in build_props(recipe, build_layout(recipe), head.vertices)}


def brow_shade(brow):
    """Return the sheet under a brow's hairs, (rows, columns, 3) from below."""
    return brow.vertices[: BROW_ROWS * BROW_COLUMNS].reshape(BROW_ROWS, BROW_COLUMNS, 3)


@pytest.fixture
def head():
    return heads.head("tiny")


@pytest.fixture
def props(head):
    return {prop.name: prop for prop in head.props}


def normals(prop):
    a, b, c = (prop.vertices[prop.faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def test_a_head_has_eyes_brows_lashes_and_hair_in_pairs(props):
    parts = ("eye_white", "eye_limbus", "eye_iris", "eye_pupil", "brow", "lashes")
    assert set(props) == {f"{part}_{side}" for part in parts for side in ("left", "right")} | {"hair", "bust"}
    for part in parts:
        left, right = props[f"{part}_left"], props[f"{part}_right"]
        np.testing.assert_array_equal(left.vertices * (-1, 1, 1), right.vertices)
        assert left.vertices[:, 0].min() > 0
        assert left.follow == ("eye_left" if part.startswith("eye") else "skin")
        assert right.follow == ("eye_right" if part.startswith("eye") else "skin")


def test_eyeballs_fill_their_lids_and_do_not_come_through(head, props):
    eye = head.eyes["left"]
    rings = np.linalg.norm(head.vertices[head.grids["lid_inner_left"]] - eye.centre, axis=-1)
    for part in ("white", "limbus", "iris", "pupil"):
        radius = np.linalg.norm(props[f"eye_{part}_left"].vertices - eye.centre, axis=1)
        assert 0.99 * eye.radius < radius.min() and radius.max() < rings.min()
    assert rings.min() - eye.radius < 1.0


def test_the_pupil_looks_ahead_within_the_iris(head, props):
    eye = head.eyes["left"]
    pupil, iris = (props[f"eye_{part}_left"].vertices - eye.centre for part in ("pupil", "iris"))
    assert np.hypot(pupil[:, 0], pupil[:, 1]).max() < 1.01 * np.hypot(iris[:, 0], iris[:, 1]).min()
    assert pupil[:, 2].min() > 0.95 * eye.radius


def test_parts_face_outwards(head, props):
    centres = {"eye": head.eyes["left"].centre, "hair": np.array([0.0, 30.0, -10.0]), "brow": np.array([0.0, 0, 0])}
    for name, prop in props.items():
        part = name.split("_")[0]
        if part in centres and not name.endswith("right"):
            outwards = prop.vertices[prop.faces].mean(1) - centres[part]
            share = ((normals(prop) * outwards).sum(1) > 0).mean()
            assert share > (0.999 if part == "eye" else 0.9), name


def test_right_hand_parts_are_turned_over_with_their_mirror_image(props):
    left, right = props["brow_left"], props["brow_right"]
    np.testing.assert_allclose(np.sort(normals(left)[:, 2]), np.sort(normals(right)[:, 2]))


def test_brows_lie_on_the_skin_between_eye_and_hair(head, props):
    brow, eye = props["brow_left"].vertices, head.eyes["left"]
    distance = lidded_distance(head.recipe, brow)
    assert -0.6 < distance.min() and 0.4 < distance.max() < 2.0
    assert brow[:, 1].min() > eye.centre[1] + 0.6 * eye.radius
    assert brow[:, 1].max() < props["hair"].vertices[np.abs(props["hair"].vertices[:, 0]) < 60, 1].max()


def test_hair_covers_the_crown_and_leaves_face_and_ears_free(head, props):
    locks = props["hair"].vertices
    distance = skull_distance(head.recipe, locks)
    assert -1.5 < distance.min() and 8 < distance.max() < 14
    crown = head.vertices[head.grids["crown"]]
    assert locks[:, 1].max() > crown[..., 1].max() + 2
    front = locks[(np.abs(locks[:, 0]) < 30) & (locks[:, 2] > 0)]
    assert front[:, 1].min() > props["brow_left"].vertices[:, 1].max() + 5


def test_hair_grows_out_of_the_skin_thin_and_in_its_colour_at_the_hair_line(head, props):
    count = hair.ROWS * hair.COLUMNS
    sheet = props["hair"].vertices[:count].reshape(hair.ROWS, hair.COLUMNS, 3)
    colours = props["hair"].colours[:count].reshape(sheet.shape)
    height = skull_distance(head.recipe, sheet.reshape(-1, 3)).reshape(sheet.shape[:2])
    assert -1 < height[0].max() < 0.5 and height[hair.ROWS // 2].min() > 2
    styles = head.recipe.props
    off = [np.abs(colours - np.array(colour)).max(-1) for colour in (styles.skin_colour, styles.hair_colour)]
    assert (off[0][0] < off[1][0]).all() and (off[1][hair.ROWS // 2] < off[0][hair.ROWS // 2]).all()


@pytest.mark.parametrize("style", ["cap", "short"])
def test_strands_hang_over_the_edge_of_the_hair_all_along_the_forehead(head, style):
    p, count = props_with(head, hair=style)["hair"].vertices, hair.ROWS * hair.COLUMNS
    edge, locks = p[:count].reshape(hair.ROWS, hair.COLUMNS, 3)[1], p[count:]
    front = edge[np.abs(np.arctan2(edge[:, 0], edge[:, 2])) < np.radians(40)]
    for place in front:
        over = (np.abs(locks[:, 0] - place[0]) < 7) & (locks[:, 2] > 0)
        assert locks[over, 1].min() < place[1], place


def test_a_bobs_parting_is_a_valley(head):
    """Along the parting the hair lies lower than on both sides of it."""
    p = props_with(head, hair="bob")["hair"].vertices
    centre = head_centre(head.recipe)
    angle = np.degrees(np.arctan2(p[:, 0], p[:, 2] - centre[2])) - hair.STYLES["bob"].part_deg
    height, up = (
        skull_distance(head.recipe, p),
        np.degrees(np.arcsin((p - centre)[:, 1] / np.linalg.norm(p - centre, axis=1))),
    )
    for level in (52, 58, 64, 70):
        near = np.abs(up - level) < 4
        sides = ((-2, 2), (-25, -10), (10, 25))
        middle, *beside = (height[near & (angle > a) & (angle < b)].max() for a, b in sides)
        assert middle < min(beside) - 2, level


def test_props_can_be_left_out(head):
    assert set(props_with(head, hair="none", brows="none", lashes="none", bust="none")) == EYES


def test_a_slit_pupil_is_narrow():
    recipe = load_recipe("tiny")
    slit = replace(recipe, eyes=replace(recipe.eyes, pupil="slit"), props=replace(recipe.props, hair="none"))
    layout = build_layout(slit)
    parts = build_props(slit, layout, np.zeros((len(layout.part), 3)))
    pupil = next(prop for prop in parts if prop.name == "eye_pupil_left").vertices - recipe.eyes.centre
    assert np.ptp(pupil[:, 0]) < 0.5 * np.ptp(pupil[:, 1])


def test_every_vertex_of_a_prop_has_a_colour(head):
    for prop in props_with(head, hair="bob", horns="crown", lashes="long").values():
        assert prop.colours.shape == prop.vertices.shape and np.isfinite(prop.vertices).all(), prop.name
        assert 0 <= prop.colours.min() and prop.colours.max() <= 1, prop.name


def test_irises_have_a_dark_rim_and_eyes_lie_in_the_shade_of_the_upper_lid(props):
    bright = {zone: props[f"eye_{zone}_left"].colours.mean() for zone in ZONES}
    assert bright["pupil"] < bright["limbus"] < 0.7 * bright["iris"] < bright["iris"] < bright["white"] < 0.93
    iris = props["eye_iris_left"]
    height = iris.vertices[:, 1]
    assert iris.colours[height > np.quantile(height, 0.9)].mean() < iris.colours[height < np.median(height)].mean()


@pytest.mark.parametrize("style", ["natural", "thin", "thick"])
def test_brows_at_rest_say_nothing(head, style):
    """Head and tail lie at one height, the arch is low: neither sad nor cross."""
    brow = props_with(head, brows=style, hair="none")["brow_left"]
    grid = brow_shade(brow)
    middle = grid[BROW_ROWS // 2, :, 1]
    assert abs(middle[2] - middle[-3]) < 3 and 0.5 < middle.max() - middle[[2, -3]].max() < 4.5
    assert 0.35 < middle.argmax() / BROW_COLUMNS < 0.75
    thickness = np.ptp(grid[..., 1], axis=0)
    assert thickness[8:20].min() > 1.5 * thickness[-3]


def test_thick_brows_are_thicker_than_natural_ones_and_these_than_thin_ones(head):
    high = [
        np.ptp(brow_shade(props_with(head, brows=style)["brow_left"])[..., 1], axis=0).max()
        for style in ("thick", "natural", "thin")
    ]
    assert high[0] > 1.2 * high[1] > 1.5 * high[2]


def test_short_hair_leaves_more_of_the_forehead_and_lies_closer(head, props):
    short = props_with(head, hair="short")["hair"].vertices

    def front(p):
        return p[(np.abs(p[:, 0]) < 20) & (p[:, 2] > 0), 1].min()

    assert front(short) > front(props["hair"].vertices) + 4
    assert skull_distance(head.recipe, short).max() < skull_distance(head.recipe, props["hair"].vertices).max() - 3


def test_a_bob_falls_to_the_jaw_over_the_ears_and_leaves_the_face_free(head):
    bob = props_with(head, hair="bob")["hair"]
    assert bob.follow == "hair"
    p = bob.vertices
    mouth = head.recipe.mouth.y
    assert p[:, 1].min() < mouth - 20
    behind = p[(p[:, 2] < -30)]
    assert np.ptp(behind[:, 1]) > 120
    face = (np.abs(p[:, 0]) < 45) & (p[:, 2] > 20)
    assert p[face, 1].min() > brow_shade(props_with(head)["brow_left"])[..., 1].max() + 5
    ears = head.vertices[np.isin(head.part, [head.part_names.index("ear_left")])]
    beside = p[(p[:, 0] > 0) & (np.abs(p[:, 1] - ears[:, 1].mean()) < 20) & (np.abs(p[:, 2] - ears[:, 2].mean()) < 15)]
    assert beside[:, 0].max() > ears[:, 0].max()


def test_horns_stand_in_pairs_and_a_crest_outside_the_skull_and_point_backwards(head):
    props = props_with(head, hair="none", horns="crown")
    horns = {name: prop for name, prop in props.items() if name.startswith("horn")}
    assert {name.replace("left", "right") for name in horns if "left" in name} <= set(horns)
    assert len(horns) == 2 * len(PAIRS) + len(CREST)
    for name, prop in horns.items():
        tip = prop.vertices.reshape(-1, HORN_COLUMNS, 3)[-1, 0]
        foot = prop.vertices.reshape(-1, HORN_COLUMNS, 3)[0].mean(0)
        assert skull_distance(head.recipe, tip[None])[0] > 4 and skull_distance(head.recipe, foot[None])[0] < 0, name
        assert tip[2] < foot[2] + 2, name
        axis = prop.vertices.reshape(-1, HORN_COLUMNS, 3)[:, :-1].mean(1)
        nearest = np.repeat(axis, HORN_COLUMNS, 0)[prop.faces].mean(1)
        assert ((normals(prop) * (prop.vertices[prop.faces].mean(1) - nearest)).sum(1) > 0).mean() > 0.95, name
    longer = props_with(head, hair="none", horns="crown", horn_length=2.0)["horn_left_3"].vertices
    assert np.ptp(longer, axis=0).max() > 1.6 * np.ptp(horns["horn_left_3"].vertices, axis=0).max()


def test_a_shirt_hides_where_the_neck_ends_and_widens_to_shoulders(head, props):
    end, shirt = head.vertices[head.grids["body"][0]], props["bust"].vertices
    middle = (end.min(0) + end.max(0)) / 2
    radius, turn = np.hypot(*(end - middle)[:, [0, 2]].T), np.arctan2(*(end - middle)[:, [0, 2]].T)
    reach, around = np.hypot(*(shirt - middle)[:, [0, 2]].T), np.arctan2(*(shirt - middle)[:, [0, 2]].T)
    for r, angle in zip(radius, turn, strict=True):
        beside = np.abs(np.angle(np.exp(1j * (around - angle)))) < 0.1
        collar = beside & (reach > r) & (reach < r + 6)
        assert shirt[collar, 1].max() > middle[1] + 2
    assert np.ptp(shirt[:, 0]) > 2.5 * np.ptp(end[:, 0]) and shirt[:, 1].min() < middle[1] - 80


def test_a_creatures_neck_goes_on_in_its_colours(head):
    neck = props_with(head, bust="neck", back=1.0, throat=1.0)["bust"]
    end = head.vertices[head.grids["body"][0]]
    top = neck.vertices[neck.vertices[:, 1] > end[:, 1].max() - 1]
    nearest = np.linalg.norm(top[:, None] - end, axis=-1).min(1)
    assert len(top) > 20 and nearest.max() < 25
    lowest = neck.vertices[neck.vertices[:, 1] < neck.vertices[:, 1].min() + 1]
    assert np.ptp(lowest[:, 0]) > 1.5 * np.ptp(end[:, 0])
    front, behind = neck.colours[neck.vertices[:, 2].argmax()], neck.colours[neck.vertices[:, 2].argmin()]
    assert front.sum() > behind.sum() + 0.3
