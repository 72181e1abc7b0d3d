"""Paint: every vertex has its colour, the same on both sides, and parts differ as they should. Display only."""

from dataclasses import replace

import heads
import numpy as np
import pytest

from data_recipes.head.head_paint import paint
from data_recipes.head.topology import build_layout


@pytest.fixture
def head():
    return heads.head("tiny")


def paint_with(head, **changes):
    recipe = replace(head.recipe, props=replace(head.recipe.props, **changes))
    return paint(recipe, build_layout(recipe), head.vertices).astype(int)


def test_paint_covers_every_vertex_and_is_as_symmetric_as_the_head(head):
    assert head.paint.shape == head.vertices.shape and head.paint.dtype == np.uint8
    np.testing.assert_array_equal(head.paint, head.paint[head.mirror])


def test_without_anything_on_it_skin_has_its_own_colour_alone(head):
    plain = paint_with(head, lip=0.0, blush=0.0, lid=0.0)
    skin = np.isin(head.part, [head.part_names.index(name) for name in ("cranium", "neck", "ear_left")])
    assert (plain[skin] == np.rint(255 * np.array(head.recipe.props.skin_colour))).all()


def test_lips_differ_from_the_skin_around_them_and_blend_on_their_border(head):
    colours = paint_with(head, lip=1.0, lip_colour=(0.8, 0.1, 0.2), blush=0.0)
    rings, t = head.grids["mouth"], head.recipe.template
    lip, border, skin = (colours[rings[i]] for i in (0, t.lip_rings, t.lip_rings + 1))
    np.testing.assert_allclose(lip, np.broadcast_to([204, 26, 51], lip.shape), atol=1)
    middle = border[len(border) // 4]
    assert (middle < skin[len(border) // 4])[1:].all() and (middle > lip[0])[1:].all()


def test_blush_reddens_cheeks_ears_and_the_tip_of_the_nose_alone(head):
    redder = np.diff(paint_with(head, blush=1.0)[:, :2] - paint_with(head, blush=0.0)[:, :2], axis=1)[:, 0]
    assert redder[head.landmarks["nose_tip"]] < -15 and redder[head.grids["ear_cap_left"]].max() < -15
    cheek = np.linalg.norm(head.vertices - head.vertices[head.landmarks["cheek_left"]], axis=1).argsort()[:5]
    assert redder[cheek].min() < -15
    assert redder[head.landmarks["forehead"]] > -3 and redder[head.part == head.part_names.index("neck")].min() > -3


def test_lids_nostrils_and_the_inside_of_the_mouth_are_darker_than_skin(head):
    bright = head.paint.astype(int).sum(1)
    skin = bright[head.landmarks["forehead"]]
    assert bright[head.grids["eye_left"][0]].max() < skin - 20
    assert bright[np.setdiff1d(head.grids["nostril_cap_left"], head.grids["nostril_left"][1:])].max() < skin - 200
    assert bright[head.grids["mouth_bag"][-1]].max() < 150
    assert bright[head.grids["teeth"]].min() > 550
    tongue = head.paint[head.grids["tongue"]].astype(int)
    assert (tongue[..., 0] > tongue[..., 1] + 40).all()


def test_a_dark_back_and_a_light_throat_leave_the_cheeks_as_they_are(head):
    plain = paint_with(head)
    dark = paint_with(head, back=1.0, back_colour=(0.0, 0.0, 0.0))
    light = paint_with(head, throat=1.0, throat_colour=(1.0, 1.0, 1.0))
    crown, chin = head.grids["crown"], head.landmarks["chin"]
    assert dark[crown].max() < 40 and (light[crown] == plain[crown]).all()
    assert light[chin].sum() > plain[chin].sum() + 50 and (dark[chin] == plain[chin]).all()
