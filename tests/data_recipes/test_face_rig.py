"""Our own rigs: nodes one by one, derivatives, props."""

import numpy as np
import pytest
from rig_poses import augmented_poses, strained_pose

from replicate.base.exceptions import InputError


def test_the_default_pose_is_the_neutral(tiny):
    assert np.abs(tiny(tiny.default) - tiny.mesh.neutral).max() < 1e-4


def test_a_batch_gives_what_single_poses_give(tiny):
    p = augmented_poses(tiny, 37)
    batch = tiny(p)
    assert batch.shape == (37, *tiny.mesh.neutral.shape)
    assert batch.dtype == np.float32
    for i in (0, 31, 32, 36):
        np.testing.assert_allclose(tiny(p[i]), batch[i], atol=2e-3)


def test_the_nodes_one_by_one_give_the_compiled_rig(tiny):
    p = augmented_poses(tiny, 5)
    np.testing.assert_allclose(tiny.run_nodes(p), tiny(p), atol=2e-3)
    assert len({node.name for node in tiny.nodes}) == len(tiny.nodes) >= 10


def test_a_node_that_is_switched_off_moves_nothing_and_those_after_it_see_it_at_rest(tiny):
    p = strained_pose(tiny)
    jaw = next(k for k, node in enumerate(tiny.nodes) if node.name == "jaw")
    without = {name: np.asarray(state["x"]) for name, state in tiny.node_steps(p, skip=("jaw",))}
    before = tiny.nodes[jaw - 1].name
    np.testing.assert_array_equal(without["jaw"], without[before])
    np.testing.assert_allclose(tiny.run_nodes(p, upto=before), without[before].transpose(0, 2, 1))
    lower = [i for i, name in enumerate(tiny.mesh.segment_names) if name.startswith("tooth_lower")]
    teeth = np.isin(tiny.mesh.segment, lower)
    still = tiny.run_nodes(p, skip=("jaw", "head_shape"))[0]
    np.testing.assert_allclose(still[teeth], tiny.mesh.neutral[teeth], atol=1e-3)
    everything = [node.name for node in tiny.nodes]
    np.testing.assert_allclose(tiny.run_nodes(p, skip=everything)[0], tiny.mesh.neutral, atol=1e-3)


def test_without_the_limits_a_control_of_three_is_three(tiny):
    p = 3 * strained_pose(tiny)
    states = [dict(tiny.node_steps(p, skip=skip)) for skip in ((), ("limit",))]
    limited, free = (np.asarray(state["limit"]["u"]) for state in states)
    np.testing.assert_allclose(free, p)
    assert np.abs(limited).max() < 1.5 < np.abs(free).max()


@pytest.mark.parametrize("choice", [{"skip": ["jaw", "wrinkle"]}, {"skip": "wrinkle"}, {"upto": "wrinkle"}])
def test_a_node_that_there_is_not_is_refused_with_those_that_there_are(tiny, choice):
    with pytest.raises(InputError, match=r"rig 'tiny': there is no node 'wrinkle'; there are limit, pose_curves, .*"):
        tiny.run_nodes(tiny.default[None], **choice)


def test_the_jacobian_agrees_with_central_differences(tiny):
    generator = np.random.default_rng(3)
    p = (tiny.default + 0.3 * generator.uniform(-1, 1, len(tiny.controls)) * (tiny.upper - tiny.lower)).astype(
        np.float32
    )
    exact = tiny.jacobian(p)
    assert exact.shape == (*tiny.mesh.neutral.shape, len(p))
    some = np.arange(len(p))[::-1][:40]
    np.testing.assert_allclose(tiny.jacobian(p, some), exact[:, :, some], atol=1e-2)
    step = 4e-3
    moved = np.repeat(p[None], 2 * len(p), axis=0)
    moved[: len(p)] += step * np.eye(len(p), dtype=np.float32)
    moved[len(p) :] -= step * np.eye(len(p), dtype=np.float32)
    vertices = tiny(moved).astype(np.float64)
    central = np.moveaxis((vertices[: len(p)] - vertices[len(p) :]) / (2 * step), 0, 2)
    # float32 gives differences of millimetres an error of about 2e-5 / step = 5e-3 mm; folds start with a root.
    off = np.abs(exact - central)
    assert np.quantile(off, 0.999) < 0.02
    assert off.max() < 0.05 * np.abs(exact).max()
    assert np.linalg.norm(exact - central) < 2e-3 * np.linalg.norm(central)


def test_eyeballs_turn_with_the_gaze_and_brows_ride_on_the_skin(tiny):
    names = [control.name for control in tiny.controls]
    rest = {name: vertices for name, vertices, _, _ in tiny.pose_props(tiny.default)}
    raised = tiny.default.copy()
    raised[names.index("brow_outer_up_left")] = raised[names.index("brow_inner_up_left")] = 1
    raised[names.index("look_y_left")] = 1
    posed = {name: vertices for name, vertices, _, _ in tiny.pose_props(raised)}
    assert (posed["brow_left"] - rest["brow_left"])[:, 1].mean() > 1.5
    assert np.abs(posed["brow_right"] - rest["brow_right"]).max() < 1.5
    assert (posed["eye_pupil_left"] - rest["eye_pupil_left"])[:, 1].mean() > 3
    np.testing.assert_allclose(posed["eye_pupil_right"], rest["eye_pupil_right"], atol=1e-4)
