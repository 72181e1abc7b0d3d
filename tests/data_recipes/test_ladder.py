"""The steps of the ladder: the same head and controls, with fewer deformers or with finer wrinkles."""

import numpy as np
import pytest
import rigs
from rig_poses import augmented_poses, pose_of

from data_recipes.catalogue import build_rig, load_rig, save_rig
from replicate.approximation.rigid import segment_errors

STEPS = ("1", "2", "3", "4", "6")


@pytest.fixture(scope="module")
def ladder(tiny):
    """Tiny on every step, by the step's name."""
    return {step: rigs.rig(f"tiny@{step}") for step in STEPS} | {"5": tiny}


def teeth_of(rig):
    return [k for k, name in enumerate(rig.mesh.segment_names) if name.startswith("tooth")]


def skin_of(rig):
    return ~np.isin(rig.mesh.segment, teeth_of(rig))


@pytest.mark.parametrize("step", STEPS)
def test_a_step_has_the_same_head_rests_in_neutral_and_keeps_its_teeth_rigid(ladder, step):
    rig, whole = ladder[step], ladder["5"]
    np.testing.assert_array_equal(rig.mesh.neutral, whole.mesh.neutral)
    assert rig.controls == whole.controls
    np.testing.assert_allclose(rig(rig.default), rig.mesh.neutral, atol=1e-4)
    vertices = rig(augmented_poses(whole, 24))
    assert np.isfinite(vertices).all()
    assert np.asarray(segment_errors(rig.mesh, vertices))[:, teeth_of(rig)].max() < 1e-3


def test_on_the_first_step_controls_add_up_and_on_the_second_two_have_a_combination(ladder):
    pairs = {step: [] for step in "12"}
    for step, mixed in pairs.items():
        rig = ladder[step]
        smile, jaw = pose_of(rig, smile_left=0.6), pose_of(rig, jaw_open=0.6)
        both, first, second, rest = rig(np.stack([smile + jaw, smile, jaw, rig.default]))
        mixed.append(np.abs(both - first - second + rest)[skin_of(rig)].max())
    assert pairs["1"][0] < 1e-3 and pairs["2"][0] > 0.3


def test_targets_are_the_shapes_of_the_third_step_and_parabolas_lead_through_half_of_it(ladder):
    def offsets(step, amount):  # the limit bends both alike
        rig = ladder[step]
        return (rig(pose_of(rig, jaw_open=amount)) - rig.mesh.neutral)[skin_of(rig)]

    full, half = offsets("3", 1.0), offsets("3", 0.5)
    for step, miss in (("1", 0.15), ("2", 0.01)):
        assert np.abs(offsets(step, 1.0) - full).max() < 0.1 * np.abs(full).max()
        assert np.abs(offsets(step, 0.5) - half).max() < miss * np.abs(half).max()
    assert np.abs(offsets("1", 0.5) - half).max() > 2 * np.abs(offsets("2", 0.5) - half).max()


def test_folds_come_with_the_fifth_step_and_are_other_ones_on_the_sixth(ladder):
    pose = pose_of(ladder["5"], brow_inner_up_left=1.0, brow_inner_up_right=1.0)
    smooth, folded, short = (ladder[step](pose) for step in "456")
    assert ladder["4"].wrinkle_states(pose) == {}
    assert np.abs(folded - smooth).max() > 0.1 and np.abs(short - folded).max() > 0.05


def test_a_step_comes_back_from_disk(ladder, tmp_path):
    rig = ladder["2"]
    save_rig(rig, tmp_path / "rig")
    poses = augmented_poses(ladder["5"], 3)
    np.testing.assert_array_equal(load_rig(tmp_path / "rig")(poses), rig(poses))


def test_uniform_has_no_clips_and_limits_that_are_closer():
    rig = build_rig("tiny@uniform")
    uppers = {control.name: control.upper for control in rig.controls}
    assert rig.clips is None and {name for name, upper in uppers.items() if upper > 0.5} == {
        "blink_left",
        "blink_right",
    }
