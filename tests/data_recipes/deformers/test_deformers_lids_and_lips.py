"""Lids on the lid ball, lips on each other and on the teeth: identities at rest and known contacts."""

import jax.numpy as jnp
import numpy as np

from data_recipes.deformers import lids, lips
from data_recipes.deformers.jaw import JawMotion

RNG = np.random.default_rng(8)
STILL = JawMotion(jnp.zeros((1, 3)), jnp.zeros((1, 3)))


def test_raising_on_the_ball_changes_the_elevation_alone():
    q = RNG.normal(size=(1, 3, 40)) * 20 + np.array([0, 0, 30])[:, None]
    angle = RNG.uniform(-0.6, 0.6, (1, 40))
    length = np.linalg.norm(q, axis=1)
    moved = np.asarray(lids.raise_on_ball(jnp.asarray(q), jnp.asarray(angle), jnp.asarray(length)), np.float64)
    elevation = lambda p: np.arctan2(p[:, 1], np.hypot(p[:, 0], p[:, 2]))  # noqa: E731
    low = np.abs(elevation(q) + angle) < 1.4  # short of the pole
    np.testing.assert_allclose((elevation(moved) - elevation(q))[low], angle[low], atol=1e-5)
    np.testing.assert_allclose(np.arctan2(moved[:, 0], moved[:, 2])[low], np.arctan2(q[:, 0], q[:, 2])[low], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), length, rtol=1e-5)


def test_closing_is_linear_at_first_and_exactly_shut_from_a_full_blink_on():
    closure = np.asarray(lids.closing(jnp.array([[0.0], [0.2], [0.97], [1.3]])))[:, 0]
    np.testing.assert_allclose(closure, [0, 0.228, 1, 1], atol=1e-3)


def eye(k: int = 16) -> tuple[np.ndarray, lids.LidPatch]:
    """A rim at ±20° around the gaze on a ball of 20 mm, 12 mm of it on each lid, and a ring further out."""
    u = np.linspace(-0.8, 0.8, k)
    parts = []
    for sign in (1, -1):
        for elevation, distance in ((0.35, 21.0), (0.7, 24.0)):
            across = distance * np.cos(elevation)
            y = sign * distance * np.sin(elevation) + 0 * u
            parts.append(np.stack([across * np.sin(u), y, across * np.cos(u)], 1))
    zero = np.zeros((1, 4 * k))
    patch = lids.LidPatch(
        vertices=np.arange(4 * k, dtype=np.int32),
        share=np.tile(np.repeat([1.0, 0.5], k), 2),
        upper=np.repeat([1.0, 0.0], 2 * k),
        edge_upper=np.full(4 * k, 0.35),
        edge_lower=np.full(4 * k, -0.35),
        moves_upper=zero.copy(),
        moves_lower=zero.copy(),
        lifts=zero.copy(),
        swells=zero.copy(),
    )
    return np.concatenate(parts), patch


def test_a_blink_brings_the_rims_together_and_keeps_every_lid_vertex_off_the_eyeball():
    x, patch = eye()
    constants = lids.prepare(x, patch, np.eye(3), np.zeros(3), 20.0, 0)
    rest = jnp.asarray(x.T[None], jnp.float32)
    np.testing.assert_allclose(lids.close_lids(constants, rest, jnp.zeros((1, 1))), rest, atol=1e-5)
    closed = np.asarray(lids.close_lids(constants, rest, jnp.ones((1, 1))))[0].T
    np.testing.assert_allclose(closed[:16], closed[32:48], atol=0.1)
    pressed = lids.close_lids(constants, rest * 0.8, jnp.ones((1, 1)))
    assert np.linalg.norm(np.asarray(pressed)[0], axis=0).min() > 20.2


def mouth(k: int = 24) -> np.ndarray:
    """Three rings around a seam of half-width 25 mm in the x-y plane; ring 0 with a gap of 0.2 mm."""
    phase = np.pi * np.arange(k) / (k // 2)
    rings = [np.stack([w * np.cos(phase), h * np.sin(phase), 0 * phase], 1) for w, h in ((25, 0.1), (28, 5), (31, 10))]
    return np.stack(rings)


def lip_constants(rings: np.ndarray) -> dict[str, np.ndarray]:
    count, k, _ = rings.shape
    index = np.arange(count * k).reshape(count, k)
    headroom = np.full(k, 8.0)
    return lips.prepare(rings.reshape(-1, 3), index, np.array([1.0, 0.5, 0.0]), np.array([0, 1, 2]), 3, headroom)


def test_closed_lips_stay_and_overlapping_ones_part():
    rings = mouth()
    constants = lip_constants(rings)
    rest = jnp.asarray(rings.reshape(-1, 3).T[None], jnp.float32)
    np.testing.assert_allclose(lips.close_lips(constants, rest, jnp.zeros((1, 3))), rest, atol=1e-5)
    side = np.sign(np.round(np.sin(np.pi * np.arange(24) / 12), 6))
    crossed = rings.copy()
    crossed[0, :, 1] -= 4.0 * side  # the upper lip 4 mm too low, the lower one 4 mm too high
    x = jnp.asarray(crossed.reshape(-1, 3).T[None], jnp.float32)
    moved = np.asarray(lips.close_lips(constants, x, jnp.zeros((1, 3))))[0].T
    middle, below = 6, 18
    assert crossed[0, middle, 1] - crossed[0, below, 1] < -7
    assert moved[middle, 1] - moved[below, 1] > -0.5


def test_lips_together_closes_a_parted_mouth_and_sticky_corners_hold_only_the_corners():
    rings = mouth()
    constants = lip_constants(rings)
    parted = rings.copy()
    lower = np.sin(np.pi * np.arange(24) / 12) < -1e-6
    parted[0, lower, 1] += 12.0 * np.sin(np.pi * np.arange(24) / 12)[lower]
    x = jnp.asarray(parted.reshape(-1, 3).T[None], jnp.float32)
    gap = lambda y, column: float(y[0, 1, column] - y[0, 1, 24 - column])  # noqa: E731
    free = lips.close_lips(constants, x, jnp.zeros((1, 3)))
    closed = lips.close_lips(constants, x, jnp.array([[1.0, 0, 0]]))
    sticky = lips.close_lips(constants, x, jnp.array([[0.0, 0.4, 0.4]]))
    assert gap(x, 6) > 11
    assert gap(free, 6) > 11
    assert gap(closed, 6) < 0.5
    assert gap(sticky, 6) > 8
    assert gap(sticky, 1) < 0.5 * gap(x, 1)


def test_lips_pressed_into_the_teeth_are_pushed_out_to_their_clearance():
    angle = np.linspace(-1.2, 1.2, 80)
    teeth = np.stack([30 * np.sin(angle), np.repeat([-4.0, 4.0], 40), 30 * np.cos(angle)], 1)
    angle = np.linspace(-0.8, 0.8, 30)
    lip = np.stack([36 * np.sin(angle), 0 * angle, 36 * np.cos(angle)], 1)
    constants = lips.prepare_wall(lip, np.arange(30), teeth, 0.0, True, np.zeros(3))
    rest = jnp.asarray(lip.T[None], jnp.float32)
    np.testing.assert_array_equal(lips.roll_over_teeth(constants, rest, STILL), rest)
    pressed = lips.roll_over_teeth(constants, rest * 0.75, STILL)
    radius = np.linalg.norm(np.asarray(pressed)[0], axis=0)
    assert radius.min() > 30.6
    assert radius.max() < 31.6


def test_the_upper_lip_stops_under_the_nose_however_far_it_is_raised():
    rings = mouth()
    constants = lip_constants(rings)
    upper = np.sin(np.pi * np.arange(24) / 12) > 1e-6
    rise = []
    for raised_mm in (3.0, 12.0, 40.0):
        x = rings.copy()
        x[:, upper, 1] += raised_mm
        raised = jnp.asarray(x.reshape(-1, 3).T[None], jnp.float32)
        moved = np.asarray(lips.close_lips(constants, raised, jnp.zeros((1, 3))))
        rise.append(float(moved[0, 1, 6]) - rings[0, 6, 1])
    assert rise[0] > 2.7  # a small rise is free
    assert rise[0] < rise[1] <= rise[2] < 8.1


def test_a_lining_pressed_against_the_teeth_stays_behind_its_lip():
    angle = np.linspace(-1.2, 1.2, 80)
    teeth = np.stack([30 * np.sin(angle), np.repeat([-4.0, 4.0], 40), 30 * np.cos(angle)], 1)
    layers = np.array([[0, 0, 31.0], [0, 0, 33.0], [0, 0, 36.0]])
    constants = lips.prepare_wall(layers, np.arange(3), teeth, 0.0, True, np.zeros(3))
    pressed = np.asarray(lips.roll_over_teeth(constants, jnp.asarray(0.6 * layers.T[None], jnp.float32), STILL))
    assert (np.diff(pressed[0, 2]) > 0.15).all()


def test_a_corner_drawn_back_behind_the_last_tooth_goes_around_it():
    angle = np.linspace(-1.2, 1.2, 80)
    teeth = np.stack([30 * np.sin(angle), np.repeat([-4.0, 4.0], 40), 30 * np.cos(angle)], 1)
    corner = np.array([[36 * np.sin(1.0), 0, 36 * np.cos(1.0)], [0, 0, 36.0]])
    constants = lips.prepare_wall(corner, np.arange(2), teeth, 0.0, True, np.zeros(3))
    back = np.array([[27 * np.sin(1.22), 0, 27 * np.cos(1.22)], [0, 0, 36.0]])
    moved = np.asarray(lips.roll_over_teeth(constants, jnp.asarray(back.T[None], jnp.float32), STILL))
    assert np.linalg.norm(moved[0, :, 0]) > 30


def test_the_lower_teeth_carry_their_wall_with_the_jaw():
    angle = np.linspace(-1.2, 1.2, 80)
    teeth = np.stack([30 * np.sin(angle), np.repeat([-4.0, 4.0], 40), 30 * np.cos(angle)], 1)
    lip = np.array([[0, 0.0, 36.0], [5, 0, 35.6]])
    constants = lips.prepare_wall(lip, np.arange(2), teeth, 0.0, False, np.zeros(3))
    forward = JawMotion(jnp.zeros((1, 3)), jnp.array([[0.0, 0, 9.0]]))
    x = jnp.asarray(lip.T[None], jnp.float32)
    moved = np.asarray(lips.roll_over_teeth(constants, x, forward))
    np.testing.assert_allclose(moved[0, 2, 0], 40.0, atol=0.4)
    np.testing.assert_array_equal(lips.roll_over_teeth(constants, x, STILL), x)
