"""SSDR end to end on meshes whose bones are known, and on meshes that leave it little to hold."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from damage import flip_a_bit
from skinned_sheets import known_skin, moved, noisy_problem, sheet

from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT
from replicate.baselines.skinning import ssdr
from replicate.baselines.skinning.ssdr import Skin, fit, refit
from replicate.geometry.alignment import nearest_rotation


def rms_mm(a, b):
    return float(np.sqrt(((a.astype(float) - b) ** 2).sum(-1).mean()))


def convex(skin):
    return (
        (skin.weights >= 0).all()
        and np.allclose(skin.weights.sum(1, dtype=float), 1, atol=1e-6)
        and (np.bincount(skin.bone_index.ravel(), skin.weights.ravel(), skin.bones) > 0).all()
    )


def proper(rotation):
    orthogonal = np.allclose(rotation @ rotation.swapaxes(-1, -2), np.eye(3), atol=1e-9)
    return orthogonal and (np.linalg.det(rotation) > 0).all()


def test_a_mesh_made_from_known_bones_is_recovered_to_a_thousandth_of_a_millimetre():
    truth, rng = known_skin(sheet())
    train, held_out = moved(truth, rng), moved(truth, rng, 8)
    skin = fit(truth.neutral, train, 4, np.random.default_rng(0), influences=4, iterations=300)
    assert convex(skin) and skin.weights.dtype == np.float32 and skin.bone_index.dtype == np.int32
    for poses in (train, held_out):
        rotation, translation = refit(skin, poses, sweeps=5000)
        assert proper(rotation)
        assert rms_mm(skin.deform(rotation, translation), poses) < 1e-3
    match = np.argmax(truth.dense_weights().T @ skin.dense_weights(), axis=1)
    np.testing.assert_allclose(skin.dense_weights()[:, match], truth.dense_weights(), atol=2e-3)


def test_permuting_vertices_or_poses_changes_nothing_but_order():
    truth, rng = known_skin(sheet(), bones=6)
    poses = moved(truth, rng) + rng.normal(size=(24, 256, 3)).astype(np.float32)
    plain = fit(truth.neutral, poses, 5, np.random.default_rng(1), influences=3, iterations=12)
    vertex, pose = rng.permutation(256), rng.permutation(24)
    mixed = fit(truth.neutral[vertex], poses[pose][:, vertex], 5, np.random.default_rng(1), influences=3, iterations=12)
    np.testing.assert_array_equal(mixed.weights, plain.weights[vertex])
    np.testing.assert_array_equal(mixed.bone_index, plain.bone_index[vertex])
    assert (plain.weights > 0).sum(1).max() == 3


def test_more_bones_and_more_iterations_fit_better():
    truth, rng = known_skin(sheet(), bones=8)
    poses = moved(truth, rng, 40) + rng.normal(size=(40, 256, 3)).astype(np.float32) * 0.1
    errors = {}
    for bones, iterations in ((2, 20), (5, 1), (5, 20), (8, 40)):
        skin = fit(truth.neutral, poses, bones, np.random.default_rng(0), iterations=iterations, relaxed=0)
        errors[bones, iterations] = rms_mm(skin.deform(*refit(skin, poses)), poses)
    assert errors[2, 20] > 1.5 * errors[5, 20] and errors[5, 1] > 1.1 * errors[5, 20]
    assert 0.1 < errors[8, 40] < 0.5 * errors[5, 20]  # the noise cannot be fitted


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_separate_tooth_gets_a_bone_of_its_own_and_fits_as_well_as_the_skin_around_it(seed):
    truth, rng = known_skin(sheet(), bones=3, seed=seed)
    tooth = np.array([10, 10, 0]) + np.array([[i, j, k] for i in (0, 4) for j in (0, 4) for k in (0, 4)])
    neutral = np.concatenate([truth.neutral, tooth]).astype(np.float32)
    turn = nearest_rotation(np.eye(3) + 0.2 * rng.normal(size=(30, 3, 3)))
    shift = rng.normal(size=(30, 1, 3)) * 5
    poses = np.concatenate([moved(truth, rng, 30), (tooth @ turn + shift).astype(np.float32)], 1)
    skin = fit(neutral, poses, 4, np.random.default_rng(0), iterations=100)
    placed = skin.deform(*refit(skin, poses, sweeps=2000))
    assert rms_mm(placed[:, -8:], poses[:, -8:]) < 0.05 and rms_mm(placed, poses) < 0.05
    assert len(np.unique(skin.bone_index[-8:][skin.weights[-8:] > 0.9])) == 1


@pytest.mark.parametrize("bones", [1, 7, 256])
def test_a_mesh_that_never_moves_gives_still_bones_all_of_them_used(bones):
    neutral = sheet()
    skin = fit(neutral, np.repeat(neutral[None], 5, 0), bones, np.random.default_rng(0), iterations=3)
    assert convex(skin)
    np.testing.assert_allclose(skin.deform(*refit(skin, neutral[None])), neutral[None], atol=1e-4)


def test_one_bone_is_the_rigid_alignment():
    from replicate.geometry.alignment import align

    truth, rng = known_skin(sheet())
    poses = moved(truth, rng)
    skin = fit(truth.neutral, poses, 1, np.random.default_rng(0), iterations=5)
    rotation, translation = refit(skin, poses, sweeps=2000)
    expected = align(truth.neutral, poses)
    np.testing.assert_allclose(rotation[:, 0], expected[0], atol=1e-6)
    np.testing.assert_allclose(translation[:, 0], expected[1], atol=1e-4)


def test_as_many_bones_as_vertices_reproduce_any_poses():
    rng = np.random.default_rng(3)
    neutral = sheet(5)
    poses = neutral + rng.normal(size=(12, 25, 3)).astype(np.float32) * 5
    skin = fit(neutral, poses, 25, np.random.default_rng(0), iterations=30)
    assert convex(skin)
    assert rms_mm(skin.deform(*refit(skin, poses)), poses) < 1e-3


def test_a_pose_repeated_five_hundred_times_is_fitted_like_any_other():
    truth, rng = known_skin(sheet())
    poses = moved(truth, rng)
    poses = np.concatenate([poses, np.repeat(poses[:1], 500, 0)])
    skin = fit(truth.neutral, poses, 4, np.random.default_rng(0), influences=4, iterations=60)
    assert convex(skin)
    assert rms_mm(skin.deform(*refit(skin, poses[:24])), poses[:24]) < 0.5


def test_one_pose_and_a_segment_that_never_moves_give_finite_bones():
    truth, rng = known_skin(sheet())
    still = truth.neutral + np.float32([0, 0, 200])
    neutral = np.concatenate([truth.neutral, still])
    for count in (1, 10):
        poses = np.concatenate([moved(truth, rng, count), np.repeat(still[None], count, 0)], 1)
        skin = fit(neutral, poses, 5, np.random.default_rng(0), iterations=40)
        rotation, translation = refit(skin, poses)
        assert convex(skin) and proper(rotation) and np.isfinite(translation).all()
        assert rms_mm(skin.deform(rotation, translation)[:, 256:], poses[:, 256:]) < 0.1


def test_a_flat_mesh_keeps_proper_rotations():
    truth, rng = known_skin(sheet() * np.float32([1, 1, 0]))
    poses = moved(truth, rng)
    skin = fit(truth.neutral, poses, 4, np.random.default_rng(0), iterations=30)
    rotation, _ = refit(skin, poses)
    assert proper(rotation) and convex(skin)


class Stop(Exception):
    pass


class StopAfter:
    """A progress bar that ends the fit after some iterations, as a kill would."""

    def __init__(self, count):
        self.count, self.beginning = count, None

    def __call__(self, total, label, initial=0):
        self.beginning = initial
        return self

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        return False

    def update(self, k):
        self.count -= k
        if self.count == 0:
            raise Stop


def test_a_fit_stopped_anywhere_goes_on_and_ends_with_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr(ssdr, "SECONDS", 0.0)
    neutral, poses = noisy_problem()
    whole = fit(neutral, poses, 5, np.random.default_rng(2), iterations=20)
    for stop in (1, 7, 12):
        with pytest.raises(Stop):
            fit(neutral, poses, 5, np.random.default_rng(2), iterations=20, scratch=tmp_path, progress=StopAfter(stop))
    bar = StopAfter(-1)
    again = fit(neutral, poses, 5, np.random.default_rng(9), iterations=20, scratch=tmp_path, progress=bar)
    assert bar.beginning == 1 + 7 + 12 == 20
    np.testing.assert_array_equal(again.weights, whole.weights)
    np.testing.assert_array_equal(again.bone_index, whole.bone_index)


def test_a_scratch_of_another_fit_or_a_damaged_one_is_not_used(tmp_path):
    neutral, poses = noisy_problem()
    whole = fit(neutral, poses, 5, np.random.default_rng(2), iterations=6)
    fit(neutral, poses * np.float32(1.01), 5, np.random.default_rng(2), iterations=6, scratch=tmp_path)
    other = fit(neutral, poses, 5, np.random.default_rng(2), iterations=6, scratch=tmp_path)
    np.testing.assert_array_equal(other.weights, whole.weights)
    state = tmp_path / "state.sealed"
    state.write_bytes(state.read_bytes()[:-100])
    (tmp_path / "compressed.sealed").write_bytes(b"not an archive")
    again = fit(neutral, poses, 5, np.random.default_rng(2), iterations=6, scratch=tmp_path)
    np.testing.assert_array_equal(again.weights, whole.weights)


@pytest.mark.parametrize("name", ["compressed.sealed", "state.sealed"])
@pytest.mark.parametrize("place", [0.001, 0.02, 0.5, 0.97, 0.999])
def test_a_flipped_bit_in_a_stopped_fits_scratch_is_named_and_changes_no_bit(tmp_path, monkeypatch, capfd, name, place):
    monkeypatch.setattr(ssdr, "SECONDS", 0.0)
    neutral, poses = noisy_problem()
    whole = fit(neutral, poses, 5, np.random.default_rng(2), iterations=12)
    with pytest.raises(Stop):
        fit(neutral, poses, 5, np.random.default_rng(2), iterations=12, scratch=tmp_path, progress=StopAfter(5))
    flip_a_bit(tmp_path / name, place)
    again = fit(neutral, poses, 5, np.random.default_rng(2), iterations=12, scratch=tmp_path)
    errors = capfd.readouterr().err
    assert str(tmp_path / name) in errors and errors.count("\n") == 1
    np.testing.assert_array_equal(again.weights, whole.weights)
    np.testing.assert_array_equal(again.bone_index, whole.bone_index)


FIT_FOR_LONG = """
import sys
from pathlib import Path

sys.path.insert(0, sys.argv[2])
import numpy as np
from replicate.baselines.skinning import ssdr
from skinned_sheets import noisy_problem

ssdr.SECONDS = 0.0
ssdr.fit(*noisy_problem(), 5, np.random.default_rng(2), iterations=100_000, scratch=Path(sys.argv[1]))
"""


def test_a_killed_process_leaves_a_scratch_that_the_next_one_ends_with_the_same_bits(tmp_path):
    neutral, poses = noisy_problem()
    settings = {"generator": np.random.default_rng(2), "iterations": 60}
    whole = fit(neutral, poses, 5, **settings)
    tests, state = Path(__file__).parents[2], tmp_path / "state.sealed"
    for _ in range(2):
        before = state.stat().st_mtime_ns if state.exists() else 0
        command = [sys.executable, "-c", FIT_FOR_LONG, str(tmp_path), str(tests)]
        child = subprocess.Popen(command, cwd=ROOT)
        while child.poll() is None and not (state.exists() and state.stat().st_mtime_ns > before):
            time.sleep(0.001)
        child.kill()
        assert child.wait() == -signal.SIGKILL
    again = fit(neutral, poses, 5, **settings, scratch=tmp_path)
    np.testing.assert_array_equal(again.weights, whole.weights)
    np.testing.assert_array_equal(again.bone_index, whole.bone_index)


def test_a_skin_comes_back_from_disk_as_it_was(tmp_path):
    skin, _ = known_skin(sheet())
    skin.save(tmp_path / "skin.npz")
    again = Skin.load(tmp_path / "skin.npz")
    assert again.bones == skin.bones
    for name in ("neutral", "bone_index", "weights"):
        np.testing.assert_array_equal(getattr(again, name), getattr(skin, name))


def test_what_cannot_be_fitted_is_told_in_one_sentence():
    neutral = sheet(4)
    poses = np.repeat(neutral[None], 3, 0)
    generator = np.random.default_rng(0)
    for bones in (0, 17):
        with pytest.raises(InputError, match=rf"expected 1 to 16 bones \(as many as vertices\), got {bones}"):
            fit(neutral, poses, bones, generator)
    with pytest.raises(InputError, match=r"at least one pose.*got poses \(0, 16, 3\)"):
        fit(neutral, poses[:0], 2, generator)
    with pytest.raises(InputError, match="expected at least 1 influence a vertex, got 0"):
        fit(neutral, poses, 2, generator, influences=0)
    poses[1, 5, 2] = np.nan
    with pytest.raises(InputError, match="pose 1 has a coordinate that is not finite"):
        fit(neutral, poses, 2, generator)
