"""Table 2's measurement: the right numbers for known errors, each pose once, every part of the mesh accounted for."""

import numpy as np
import pytest
from plane import flat_grid

from replicate.approximation.metrics import evaluate, load_errors, normal_error, unique_poses, vertex_error
from replicate.geometry.mesh import Mesh
from replicate.methods.coarse import texels
from replicate.report.results import error_rows, find


@pytest.fixture
def grid() -> Mesh:
    """A 6 × 6 grid of 10 mm squares; its right half is "ear", its last two columns a rigid "tooth"."""
    vertices, faces = flat_grid(10 * np.arange(6), 10 * np.arange(6))
    segment = np.digitize(vertices[:, 0], [30, 40]).astype(np.int32)
    return Mesh(
        vertices,
        faces,
        (vertices[:, :2] / 50).astype(np.float32),
        segment,
        ("face", "ear", "tooth"),
    )


@pytest.fixture
def poses(grid):
    rng = np.random.default_rng(3)
    params = rng.normal(size=(11, 4)).astype(np.float32)
    params[7] = params[2]
    offsets = rng.normal(size=(11, 36, 3)).astype(np.float32) * 2
    offsets[7] = offsets[2]
    return params, offsets


def test_each_distinct_pose_is_measured_once(poses):
    params, _ = poses
    assert unique_poses(params).tolist() == [0, 1, 2, 3, 4, 5, 6, 8, 9, 10]


def test_the_neutral_row_is_the_mean_motion_and_the_truth_has_no_error(grid, poses):
    params, offsets = poses
    methods = {
        "neutral": lambda p, v: np.broadcast_to(grid.neutral, v.shape),
        "floor": lambda p, v: v,
    }
    errors = evaluate(grid, params, offsets, methods, batch=3)
    rows = error_rows("teen", errors, "quick", "run")
    others = np.delete(np.arange(11), 7)
    motion = np.linalg.norm(offsets[others], axis=-1)
    angle = normal_error(
        np.broadcast_to(grid.neutral, (10, 36, 3)),
        grid.neutral + offsets[others],
        grid.faces,
    )
    assert find(rows, "table2", "teen", "neutral", "vertex_error_mean").value == pytest.approx(motion.mean(), rel=1e-5)
    assert find(rows, "table2", "teen", "neutral", "vertex_error_max").value == pytest.approx(motion.max(), rel=1e-5)
    assert find(rows, "table2", "teen", "neutral", "normal_error_mean").value == pytest.approx(angle.mean(), rel=1e-5)
    assert find(rows, "table2", "teen", "floor", "vertex_error_max").value == 0
    assert find(rows, "table2", "teen", "neutral", "vertex_error_mean").poses == 10
    np.testing.assert_allclose(errors["neutral"].pose_mm, motion.mean(1), rtol=1e-5)
    np.testing.assert_allclose(errors["neutral"].pose_deg, angle.mean(1), rtol=1e-5)


def test_the_batch_size_does_not_change_a_number(grid, poses):
    methods = {"wrong": lambda p, v: v + p[:, None, :3]}
    one, all_ = (error_rows("teen", evaluate(grid, *poses, methods, batch=b), "quick", "r") for b in (1, 64))
    for a, b in zip(one, all_, strict=True):
        assert a.key == b.key and a.value == pytest.approx(b.value, rel=1e-6)


def test_an_error_is_seen_in_its_own_segment_only(grid, poses):
    params, offsets = poses

    def ear_moved(p, truth):
        moved = truth.copy()
        moved[:, grid.segment == 1] += np.float32([3, 0, 4])
        return moved

    rows = error_rows(
        "teen",
        evaluate(grid, params, offsets, {"dense": ear_moved}, rigid=[2]),
        "quick",
        "r",
    )
    means = {
        name: find(rows, "table2_segments", "teen", "dense", f"vertex_error_mean[{name}]").value
        for name in ("face", "ear", "rigid")
    }
    assert means == {"face": 0, "ear": pytest.approx(5, rel=1e-5), "rigid": 0}
    overall = find(rows, "table2", "teen", "dense", "vertex_error_mean").value
    assert overall == pytest.approx(5 * (grid.segment == 1).mean(), rel=1e-5)


def test_a_collapsed_face_is_left_out_and_reported(grid, poses):
    params, offsets = poses

    def collapse(p, truth):
        flat = truth.copy()
        flat[:, grid.faces[0, 1]] = flat[:, grid.faces[0, 0]]
        return flat

    errors = evaluate(grid, params, offsets, {"dense": collapse})
    rows = error_rows("teen", errors, "quick", "r")
    touching = (grid.faces == grid.faces[0, 0]).any(1) & (grid.faces == grid.faces[0, 1]).any(1)
    assert find(rows, "table2", "teen", "dense", "normal_faces_left_out").value == 10 * touching.sum()
    assert np.isfinite(errors["dense"].pose_deg).all()


def test_a_predictor_gets_the_params_of_its_poses(grid, poses):
    params, _ = poses
    offsets = np.repeat(params[:, None, :3], 36, axis=1)
    errors = evaluate(
        grid,
        params,
        offsets,
        {"exact": lambda p, v: grid.neutral + p[:, None, :3]},
        batch=4,
    )
    assert errors["exact"].pose_mm.max() < 1e-5
    assert vertex_error(grid.neutral + offsets, grid.neutral).mean() > 0.5


def test_texels_per_vertex_count_each_map_and_the_method_as_a_whole():
    ratios = {metric: (unit, value) for metric, unit, value in texels({"face": (32, 4096), "ear": (32, 512)})}
    assert ratios["texels_per_vertex[face]"] == ("ratio", 0.25) and ratios["texels_per_vertex[ear]"] == ("ratio", 2)
    assert ratios["texels_per_vertex"] == ("ratio", pytest.approx(2048 / 4608))


def test_errors_come_back_from_disk_with_the_same_rows(grid, poses, tmp_path):
    errors = evaluate(grid, *poses, {"dense": lambda p, v: v + p[:, None, :3]}, rigid=[2])
    errors["dense"].save(tmp_path / "errors.npz")
    back = {"dense": load_errors(tmp_path / "errors.npz")}
    assert error_rows("teen", back, "quick", "r") == error_rows("teen", errors, "quick", "r")
    np.testing.assert_array_equal(back["dense"].pose_deg, errors["dense"].pose_deg)
