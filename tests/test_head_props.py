"""Eyes, brows, lashes and hair sit where they belong on the head: display only, but seen in every picture."""

from dataclasses import replace

import heads
import numpy as np
import pytest

from data_recipes.head.layout import build_layout
from data_recipes.head.props import build_props
from data_recipes.head.shape import build_shape, lidded_distance, skull_distance
from data_recipes.recipe import load_recipe


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
    assert set(props) == {f"{part}_{side}" for part in parts for side in ("left", "right")} | {"hair"}
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
    assert -0.6 < distance.min() and 0.8 < distance.max() < 2.0
    assert brow[:, 1].min() > eye.centre[1] + 0.6 * eye.radius
    assert brow[:, 1].max() < props["hair"].vertices[np.abs(props["hair"].vertices[:, 0]) < 60, 1].max()


def test_hair_covers_the_crown_and_leaves_face_and_ears_free(head, props):
    hair = props["hair"].vertices
    distance = skull_distance(head.recipe, hair)
    rim = distance < 0
    assert rim.sum() >= 145 and distance[~rim].min() > 1 and distance.max() < 9
    crown = head.vertices[head.grids["crown"]]
    assert hair[:, 1].max() > crown[..., 1].max() + 2
    front = hair[(np.abs(hair[:, 0]) < 30) & (hair[:, 2] > 0)]
    assert front[:, 1].min() > head.vertices[head.landmarks["forehead"], 1] - 5


def test_props_can_be_left_out():
    recipe = load_recipe("tiny")
    layout = build_layout(recipe)
    bare = replace(recipe, props=replace(recipe.props, hair="none", brows="none", lashes="none"))
    parts = build_props(build_shape(bare), layout, np.zeros((len(layout.part), 3)))
    zones = ("white", "limbus", "iris", "pupil")
    assert {prop.name for prop in parts} == {f"eye_{zone}_{side}" for zone in zones for side in ("left", "right")}


def test_a_slit_pupil_is_narrow():
    recipe = load_recipe("tiny")
    layout = build_layout(recipe)
    slit = replace(recipe, eyes=replace(recipe.eyes, pupil="slit"), props=replace(recipe.props, hair="none"))
    parts = build_props(build_shape(slit), layout, np.zeros((len(layout.part), 3)))
    pupil = next(prop for prop in parts if prop.name == "eye_pupil_left").vertices - recipe.eyes.centre
    assert np.ptp(pupil[:, 0]) < 0.5 * np.ptp(pupil[:, 1])
