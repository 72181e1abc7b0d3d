"""Frills: leaf-shaped shells that stand in the skin, each with a chart, and go where the skin at their roots goes."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from data_recipes.deformers import riders
from data_recipes.head.frills import frill_frame, frill_parts, frill_positions, frill_settings
from data_recipes.head.shape import build_shape, skull_distance
from data_recipes.head.topology import build_layout
from data_recipes.recipe.reading import load_recipe
from data_recipes.recipe.sections import PARTS

LEAF = (46.0, 56.0, -44.0, 0.45, 0.42, -0.8, 0.1, 0.8, 0.5, 54.0, 26.0, 0.0)


def with_frills(name: str, **frills):
    recipe = load_recipe(name)
    return dataclasses.replace(recipe, frills=dataclasses.replace(recipe.frills, **frills))


def test_heads_have_no_frills_unless_their_recipe_asks_for_them():
    assert frill_settings(load_recipe("tiny")) == {}
    assert build_layout(load_recipe("tiny")).part_names[: len(PARTS)] == PARTS
    assert frill_parts(with_frills("tiny", cheek=LEAF)) == ("frill_cheek_left", "frill_cheek_right")


def test_frills_come_between_the_other_parts_and_the_teeth_and_change_nothing_else():
    plain, with_two = build_layout(load_recipe("tiny")), build_layout(with_frills("tiny", cheek=LEAF, jaw=LEAF))
    assert with_two.part_names[len(PARTS) : len(PARTS) + 4] == frill_parts(with_frills("tiny", cheek=LEAF, jaw=LEAF))
    assert with_two.part_names[len(PARTS) + 4 :] == plain.part_names[len(PARTS) :]
    assert (with_two.grids["body"] == plain.grids["body"]).all()
    assert len(with_two.part) - len(plain.part) == 4 * 8 * 10


def test_a_straight_leaf_has_its_length_and_width_and_its_root_lies_under_the_skin():
    recipe = with_frills("dragon", cheek=LEAF)
    rings = frill_positions(build_shape(recipe), LEAF, 13, 12)
    along, across, _ = frill_frame(LEAF)
    assert np.ptp(rings @ along) == pytest.approx(54, abs=0.1)
    assert np.ptp(rings @ across) == pytest.approx(26 * np.cos(np.pi / 12), rel=0.03)
    assert skull_distance(recipe, rings[0]).max() < 0 < skull_distance(recipe, rings[-1]).min()
    bent = frill_positions(build_shape(recipe), (*LEAF[:11], 60.0), 13, 12)
    assert np.linalg.norm(np.diff(bent.mean(1), axis=0), axis=1).sum() == pytest.approx(54, rel=0.06)
    assert np.ptp(bent.mean(1) @ frill_frame(LEAF)[2]) > 15


def test_a_shell_goes_where_the_skin_at_its_root_goes_and_nothing_else_moves():
    generator = np.random.default_rng(0)
    neutral = generator.normal(size=(60, 3))
    skin, shell = np.arange(40), np.arange(40, 60).reshape(4, 5)
    constants = riders.prepare(neutral, [shell], skin)
    x = np.stack([neutral, neutral, neutral])
    x[1, :40] += (1, 2, 3)
    x[2, constants["around"][0][0]] += (0, 0, 12)
    moved = np.asarray(riders.ride(constants, jnp.asarray(x.transpose(0, 2, 1), jnp.float32))).transpose(0, 2, 1)
    np.testing.assert_allclose(moved[:, :40], x[:, :40], atol=1e-6)
    np.testing.assert_allclose(moved[0], neutral, atol=1e-6)
    np.testing.assert_allclose(moved[1, 40:] - neutral[40:], np.tile((1, 2, 3), (20, 1)), atol=1e-5)
    np.testing.assert_allclose(moved[2, 40:] - neutral[40:], np.tile((0, 0, 12 / riders.NEAREST), (20, 1)), atol=1e-5)


def test_a_head_without_shells_is_left_alone():
    x = jnp.ones((2, 3, 7))
    assert riders.ride(riders.prepare(np.ones((7, 3)), [], np.arange(7)), x) is x
