"""Nudges of the fine controls."""

import numpy as np

from data_recipes.acting.procedural_acting import FAMILIES, deal, family_columns, gesture
from data_recipes.controls import control_groups

COLUMNS = {c.name: i for i, c in enumerate(c for group in control_groups().values() for c in group)}


def test_families_hold_every_fine_control():
    names = {name for members in family_columns(COLUMNS).values() for name in members}
    fine = {c.name for group in ("lids", "lips", "handles", "wrinkles") for c in control_groups()[group]}
    assert fine <= names


def test_a_rig_without_a_family_has_no_such_family():
    assert set(family_columns({"tongue_out": 0})) == {"tongue"}


def test_decks_deal_every_family_equally_often_and_none_twice_to_a_shot():
    hands = deal(list(FAMILIES), 44, 5, np.random.default_rng(0))
    counts = {family: sum(family in hand for hand in hands) for family in FAMILIES}
    assert all(len(set(hand)) == 5 for hand in hands)
    assert max(counts.values()) - min(counts.values()) <= 1


def test_a_gesture_moves_its_members_only_and_together():
    members = family_columns(COLUMNS)["upper lip"]
    generator = np.random.default_rng(3)
    gestures = np.stack([gesture(members, len(COLUMNS), 0.3, generator) for _ in range(800)])
    outside = np.setdiff1d(np.arange(len(COLUMNS)), list(members.values()))
    assert not gestures[:, outside].any()
    heights = gestures[:, [column for name, column in members.items() if name.endswith("_y")]]
    assert np.corrcoef(heights.T)[np.triu_indices(5, 1)].min() > 0.15


def test_even_gestures_mirror_sideways_axes():
    members = {name: COLUMNS[name] for name in ("handle_cheek_left_01_x", "handle_cheek_right_01_x")}
    generator = np.random.default_rng(1)
    pairs = np.stack([gesture(members, len(COLUMNS), 0.3, generator)[list(members.values())] for _ in range(2_000)])
    assert np.corrcoef(pairs.T)[0, 1] < -0.2


def test_lip_points_have_sides():
    members = {name: COLUMNS[name] for name in ("lip_upper_05_y", "lip_upper_01_y", "lip_upper_03_y")}
    generator = np.random.default_rng(2)
    lips = np.stack([gesture(members, len(COLUMNS), 0.3, generator) for _ in range(3_000)])[:, list(members.values())]
    only_left = (lips[:, 0] != 0) & (lips[:, 1] == 0)
    assert only_left.mean() > 0.22  # 0.19 · 6/7 from controls left out, and 0.75 / 7 from gestures of one side
