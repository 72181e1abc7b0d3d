"""Training the IK networks: the losses by hand, and that points of poses are found again through a known function."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from plain_rig import PlainRig
from small_face import M, SmallSamples, pose_offsets, small_influence, small_mesh

from data_recipes.controls import Control
from data_recipes.rig import Clip
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.config import TrainingConfig
from replicate.inverse.control_points import InverseConfig, control_points, targets_of_drags
from replicate.inverse.ik_network import amplitude, parameter_ranges, point_loss, read_truth, train_ik

MESH = small_mesh()
POINTS = np.array([40, 100, 170, 220, 290, 310])


class SmallRig(PlainRig):
    """The stand-in face as a rig: six control points, four on the face and two on the neck."""

    name, mesh = "small", MESH
    controls = tuple(Control(f"c{i}", -1.0, 0.0, 1.0, "face") for i in range(M))
    lower, default, upper = (np.full(M, value, np.float32) for value in (-1, 0, 1))
    control_points, control_point_regions = POINTS, ("face",) * 4 + ("neck",) * 2


def linear_samples(count=400):
    """Samples of a face that moves linearly, so that points decide a pose up to what they don't see."""
    rng = np.random.default_rng(2)
    basis = pose_offsets(MESH, np.eye(M) * 0.5) * 2

    def offsets(params):
        return np.einsum("bm,mnd->bnd", params, basis).astype(np.float32)

    training, fresh = (rng.uniform(-1, 1, (n, M)).astype(np.float32) for n in (count, 24))
    steps, bins = np.ones(count, np.float32), np.zeros(count, np.int16)
    samples = SmallSamples(training, offsets(training), steps, bins, *(fresh, offsets(fresh)) * 2, {})
    points = torch.from_numpy(basis[:, POINTS])
    neutral = torch.from_numpy(MESH.neutral[POINTS])
    return samples, lambda params: neutral + torch.einsum("bm,mcd->bcd", params, points)


SECTION = InverseConfig((64, 64), axes="xyz", noise_mm=0.2, regularisation=0.0,
                        training=TrainingConfig("one_cycle", 1_500, 32, "uniform", peak_rate=5e-3))  # fmt: skip


def trained(tmp_path, **changes):
    samples, positions = linear_samples()
    rig = SmallRig()
    points = control_points(rig, small_influence(MESH))
    truth = read_truth(samples, MESH.neutral, points)
    section = replace(SECTION, **changes)
    model, log = train_ik(positions, rig, points, truth, samples, section, 0, tmp_path, progress, "inverse")
    return model, log, truth, positions


def test_points_of_poses_are_found_again(tmp_path):
    model, log, truth, positions = trained(tmp_path)
    with torch.no_grad():
        reached = positions(model(torch.from_numpy(truth.validation))).numpy()
    moved = np.linalg.norm(truth.validation - MESH.neutral[POINTS], axis=-1).mean()
    apart = np.linalg.norm(reached - truth.validation, axis=-1).mean()
    assert log[-1]["mm"] == pytest.approx(apart, rel=1e-3)
    assert apart < 0.1 * moved


def test_regularisation_shrinks_the_parameters(tmp_path):
    free, log, truth, _ = trained(tmp_path / "free")
    held, held_log, *_ = trained(tmp_path / "held", regularisation=1.0)
    assert np.abs(held.solve(truth.validation)).sum() < 0.7 * np.abs(free.solve(truth.validation)).sum()
    assert held_log[-1]["amplitude"] < 0.7 * log[-1]["amplitude"]
    assert held_log[-1]["mm"] > log[-1]["mm"]


def test_targets_that_no_pose_reaches_give_finite_parameters(tmp_path):
    model, *_ = trained(tmp_path, training=replace(SECTION.training, steps=200))
    far = MESH.neutral[POINTS][None] + np.random.default_rng(0).normal(size=(20, 6, 3)) * 1_000
    assert np.isfinite(model.solve(far)).all()


@pytest.mark.parametrize("noise_mm", [0.0, 4.0])
def test_each_coordinate_of_a_target_is_off_by_half_of_the_noise(tmp_path, noise_mm):
    rig, rest = SmallRig(), torch.from_numpy(MESH.neutral[POINTS])
    nothing = np.zeros((8, M), np.float32), np.zeros((8, len(MESH.neutral), 3), np.float32)
    samples = SmallSamples(*nothing, np.ones(8, np.float32), np.zeros(8, np.int16), *nothing, *nothing, {})
    points = control_points(rig, small_influence(MESH))
    section = replace(SECTION, noise_mm=noise_mm, training=replace(SECTION.training, steps=25))
    truth = read_truth(samples, MESH.neutral, points)
    stiff = lambda params: rest + 0 * params.sum(1)[:, None, None]  # noqa: E731
    _, log = train_ik(stiff, rig, points, truth, samples, section, 0, tmp_path, progress, "inverse")
    assert np.mean([row["loss"] for row in log]) == pytest.approx(3 * noise_mm / 2, rel=0.02, abs=1e-6)


def test_the_losses_are_those_of_the_paper():
    reached = torch.tensor([[[1.0, 2.0, 9.0], [0.0, 0.0, 0.0]]])
    targets = torch.tensor([[[0.0, 0.0, 0.0], [-3.0, 0.0, 5.0]]])
    assert point_loss(reached, targets, 2) == pytest.approx((3 + 3) / 2)
    assert point_loss(reached, targets, 3) == pytest.approx((12 + 8) / 2)
    params, default = torch.tensor([[1.0, -1.0], [0.5, 0.0]]), torch.tensor([0.5, 0.0])
    assert amplitude(params, default, torch.tensor([1.0, 2.0])) == pytest.approx((0.5 + 0.5 + 0.0) / 2)


def test_ranges_are_those_of_the_animation_or_of_the_limits_where_it_rests():
    rig = SmallRig()
    np.testing.assert_array_equal(parameter_ranges(rig), np.full(M, 2.0))
    values = np.zeros((5, M), np.float32)
    values[2, 0], values[3, 0] = 0.6, -0.1
    rig.clips = (Clip("one", values),)
    assert parameter_ranges(rig)[0] == pytest.approx(0.7) and parameter_ranges(rig)[1] == 2.0


def test_a_region_drives_what_moves_one_of_its_points():
    points = control_points(SmallRig(), small_influence(MESH))
    assert [region.name for region in points.regions] == ["face", "neck"]
    assert points.regions[0].parameters.tolist() == list(range(8))
    assert points.regions[1].parameters.tolist() == [6, 7, 8, 9]
    assert points.driven().tolist() == list(range(10)) and points.names[0] == "point_01"


def test_a_region_that_stands_still_may_be_left_out():
    influence = small_influence(MESH)
    neck = [
        v
        for v, region in zip(SmallRig().control_points, SmallRig().control_point_regions, strict=True)
        if region == "neck"
    ]
    influence[neck] = False
    points = control_points(SmallRig(), influence, may_stand_still=True)
    assert [region.name for region in points.regions] == ["face"] and len(points.vertices) == len(
        SmallRig().control_points
    )
    with pytest.raises(InputError, match="no control moves a control point of the region 'neck'"):
        control_points(SmallRig(), influence)
    with pytest.raises(InputError, match="no control moves a control point of the region 'face'"):
        control_points(SmallRig(), np.zeros_like(influence), may_stand_still=True)


def test_a_rig_whose_points_nothing_moves_is_refused():
    with pytest.raises(InputError, match="no control moves a control point of the region 'face'"):
        control_points(SmallRig(), np.zeros((len(MESH.neutral), M), bool))
    with pytest.raises(InputError, match="no control points"):
        control_points(PlainRig(), np.zeros((0, 0), bool))


def test_drags_move_the_points_that_they_name():
    neutral, names = np.zeros((2, 3), np.float32), ("chin", "brow")
    moved = targets_of_drags(neutral, names, [("brow", (1.0, 2.0)), ("chin", (0.0, 0.0, 3.0))])
    assert moved.tolist() == [[0, 0, 3], [1, 2, 0]]
    with pytest.raises(InputError, match="no control point 'nose'; there are chin, brow"):
        targets_of_drags(neutral, names, [("nose", (0.0, 0.0))])
    with pytest.raises(InputError, match="finite lengths"):
        targets_of_drags(neutral, names, [("chin", (float("nan"), 0.0))])
