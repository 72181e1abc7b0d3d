"""The dragon: his counts, his health under Eq. 5, and what he has that a human face lacks."""

import numpy as np
import pytest
import rigs
from rig_poses import augmented_poses, flipped_share, skin_faces
from scipy.spatial import cKDTree

from data_recipes.acting.motion import pose
from data_recipes.catalogue import expression_poses


@pytest.fixture(scope="module")
def dragon():
    return rigs.rig("dragon")


@pytest.fixture(scope="module")
def poses(dragon):
    return dragon(augmented_poses(dragon, 300, seed=1))


def part(rig, start):
    segments = [i for i, name in enumerate(rig.mesh.segment_names) if name.startswith(start)]
    return np.isin(rig.mesh.segment, segments)


def pose_of(rig, **amounts):
    columns = {control.name: i for i, control in enumerate(rig.controls)}
    return pose(columns, {name.replace("_both", "_*"): amount for name, amount in amounts.items()})


def test_he_has_14080_vertices_286_controls_19_soft_segments_and_110_teeth(dragon):
    names = dragon.mesh.segment_names
    assert dragon.mesh.neutral.shape == (14080, 3) and len(dragon.controls) == 286
    teeth = [name for name in names if name.startswith("tooth")]
    assert len(teeth) == 110 and sum("upper" in name for name in teeth) == 56
    assert len(names) - len(teeth) == 19
    assert sum(name.startswith("frill") for name in names) == 8


def test_augmented_poses_are_faces_and_not_explosions(dragon, poses):
    assert np.isfinite(poses).all()
    faces = skin_faces(dragon.mesh)
    shares = np.array([flipped_share(v, faces) for v in poses])
    assert flipped_share(dragon.mesh.neutral, faces) < 4e-3  # in the corners of the mouth and where ears fold
    assert shares.mean() < 0.005 and shares.max() < 0.03


def test_every_tooth_is_rigid_to_a_micrometre(dragon, poses):
    for i, name in enumerate(dragon.mesh.segment_names):
        if name.startswith("tooth"):
            ids = np.flatnonzero(dragon.mesh.segment == i)
            rest = dragon.mesh.neutral[ids].astype(np.float64)
            posed = poses[:6, ids].astype(np.float64)
            gap = np.linalg.norm(rest[:, None] - rest[None], axis=2)
            assert np.abs(np.linalg.norm(posed[:, :, None] - posed[:, None], axis=3) - gap).max() < 2e-3


def test_lips_cover_his_teeth_at_rest_and_a_snarl_bares_them(dragon):
    rest, marks = dragon.mesh.neutral, dict(zip(dragon.landmark_names, dragon.landmarks.tolist(), strict=True))
    upper = rest[part(dragon, "tooth_upper")]
    assert upper[:, 2].max() < rest[marks["lip_upper_mid"], 2] - 3
    assert upper[:, 1].min() < rest[marks["lip_lower_mid"], 1] - 2  # they reach down behind the lower lip
    snarl = dragon(pose_of(dragon, snarl_both=1.0))
    lift = (snarl - rest)[:, 1]
    assert lift[part(dragon, "face")].max() > 7
    assert np.abs(lift[part(dragon, "tooth")]).max() < 1e-3


def test_a_blink_closes_lids_that_look_aside(dragon):
    marks = dict(zip(dragon.landmark_names, dragon.landmarks.tolist(), strict=True))
    closed = dragon(pose_of(dragon, blink_both=1.0))
    for side in ("left", "right"):
        upper, lower = (marks[f"lid_{which}_{side}"] for which in ("upper", "lower"))
        assert np.linalg.norm(dragon.mesh.neutral[upper] - dragon.mesh.neutral[lower]) > 15
        assert np.linalg.norm(closed[upper] - closed[lower]) < 1.5


def test_frills_turn_by_their_own_controls_and_go_with_the_jaw(dragon):
    rest = dragon.mesh.neutral
    for name in ("crown", "temple", "cheek", "jaw"):
        mine = part(dragon, f"frill_{name}_left")
        for action in ("raise", "spread"):
            far = np.linalg.norm(dragon(pose_of(dragon, **{f"frill_{name}_{action}_left": 1.0})) - rest, axis=1)
            assert far[mine].max() > 8
            assert far[~mine].max() < 1e-3
    opening = dragon(pose_of(dragon, jaw_open=1.0)) - rest
    moved = np.linalg.norm(opening[part(dragon, "frill_jaw_left")], axis=1)
    assert moved.max() - moved.min() < 1e-3


def test_each_of_his_own_controls_moves_something_by_a_millimetre(dragon):
    own = [i for i, c in enumerate(dragon.controls)][-28:]
    moved = np.abs(dragon(np.eye(286)[own]) - dragon.mesh.neutral).max(axis=(1, 2))
    assert (moved > 1).all(), [dragon.controls[own[i]].name for i in np.flatnonzero(moved <= 1)]


def test_left_and_right_are_images_of_each_other_but_for_the_folds(dragon):
    poses = [pose_of(dragon, **{f"snarl_{s}": 0.8, f"ear_fold_{s}": 0.7}) for s in ("left", "right")]
    left, right = (np.asarray(dragon.run_nodes(p[None], skip=["wrinkles"]))[0] for p in poses)
    flip = np.array([-1, 1, 1])
    assert cKDTree(right).query(left * flip)[0].max() < 2e-2
    assert cKDTree(left).query(left * flip)[0].max() > 2


def test_his_shots_use_every_control_and_his_anger_is_a_snarl(dragon):
    used = np.array([(np.abs(clip.values) > 0.02).any(axis=0) for clip in dragon.clips]).sum(axis=0)
    assert used.min() >= 4, dragon.controls[int(used.argmin())].name
    columns = {control.name: i for i, control in enumerate(dragon.controls)}
    assert expression_poses(dragon)["anger"][columns["snarl_left"]] > 0.5
    assert sum("dialogue" in clip.name for clip in dragon.clips) == len(dragon.clips) // 10


def test_however_he_laughs_his_nostrils_stay_above_his_upper_lip(dragon):
    marks = dict(zip(dragon.landmark_names, dragon.landmarks.tolist(), strict=True))
    posed = dragon(pose_of(dragon, smile_both=2.5, upper_lip_raise_both=1.2, nose_up_down=1.9, jaw_open=1.1))
    rise = (posed - dragon.mesh.neutral)[marks["lip_upper_mid"], 1]
    assert 8 < rise < 16


def test_his_lips_shift_aside_by_no_more_than_a_persons_do(dragon):
    marks = dict(zip(dragon.landmark_names, dragon.landmarks.tolist(), strict=True))
    aside = (dragon(pose_of(dragon, mouth_sideways=1.0)) - dragon.mesh.neutral)[marks["lip_lower_mid"], 0]
    assert 5 < aside < 15  # 13 mm where his snout is broadest; growing with his mouth it would be 29


def test_pressed_lips_over_a_raised_chin_stay_behind_the_snout(dragon):
    p = dragon.default.copy()
    for k, control in enumerate(dragon.controls):
        if control.name.startswith(("lip_press", "lip_roll_lower", "chin_raise")):
            p[k] = 0.6
    ahead = dragon(p)[:, 2].max() - dragon.mesh.neutral[:, 2].max()
    assert ahead < 10.0
