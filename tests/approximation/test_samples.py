"""Samples on disk: what is stored, what a kill leaves, and how batches are drawn from it."""

import json
import signal
import subprocess
import sys
import textwrap
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from damage import flip_a_bit
from plain_rig import PlainRig

from replicate.approximation import samples
from replicate.approximation.samples import SampleSet, write_samples
from replicate.base.exceptions import InputError
from replicate.base.files import read_sealed
from replicate.base.paths import ROOT
from replicate.config import SamplesConfig


@dataclass
class Waves(PlainRig):
    """A small stand-in that keeps the Rig contract: sines of the controls on random vertices."""

    clips: tuple | None = None
    broken_above: float = np.inf
    calls: list = field(default_factory=list)
    name = "waves"
    controls = tuple("abcd")
    lower, default, upper = -np.ones(4, np.float32), np.zeros(4, np.float32), np.ones(4, np.float32)
    landmarks = np.array([0, 7, 19], dtype=np.int32)

    def __post_init__(self):
        rng = np.random.default_rng(11)
        self.mesh = SimpleNamespace(neutral=rng.normal(scale=50, size=(40, 3)).astype(np.float32))
        self.fields = rng.normal(scale=10, size=(4, 40, 3)).astype(np.float32)

    def __call__(self, params):
        self.calls.append(params.shape)
        vertices = self.mesh.neutral + np.tensordot(np.sin(params), self.fields, 1)
        vertices[params[:, 0] > self.broken_above, 23] = np.nan
        return vertices


def clips(count=6, frames=50):
    rng = np.random.default_rng(4)
    return tuple(SimpleNamespace(values=rng.uniform(-1, 1, (frames, 4)).astype(np.float32)) for _ in range(count))


def config(**changes):
    values = {"count": 600, "split": "frames", "held_out": 0.1, "validation": 20, "low": 0.25, "high": 3.0, "bins": 16}
    return SamplesConfig(**({"uniform_test": 50} | values | changes))


def rng(stream):
    return np.random.default_rng([5, *stream.encode()])


@contextmanager
def quiet(total, label, initial=0):
    yield SimpleNamespace(update=lambda k: None)


def write(tmp_path, rig=None, settings=None, folder="out"):
    (tmp_path / folder).mkdir(exist_ok=True)
    write_samples(rig or Waves(clips()), settings or config(), tmp_path / folder, rng, tmp_path / "scratch", quiet)
    return SampleSet.open(tmp_path / folder)


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_offsets_come_back_within_half_a_step(tmp_path):
    rig = Waves(clips())
    data = write(tmp_path, rig)
    true = rig(data.params) - rig.mesh.neutral
    error = np.abs(data.offsets(np.arange(600)) - true)
    assert (error <= data.steps_mm[:, None, None] * 0.51 + 1e-5).all()
    assert data.facts["largest_step_mm"] < 80 / 32767
    assert data.facts["quantisation_rms_mm"] == pytest.approx(np.sqrt((error.astype(float) ** 2).mean()), rel=0.05)


def test_test_offsets_are_not_quantised(tmp_path):
    rig = Waves(clips())
    data = write(tmp_path, rig)
    assert data.test_offsets.dtype == np.float32
    assert np.array_equal(data.test_offsets, rig(np.array(data.test_params)) - rig.mesh.neutral)


def test_no_test_pose_is_a_frame_of_training(tmp_path):
    rig = Waves(clips())
    animation = np.concatenate([clip.values for clip in rig.clips])
    test = write(tmp_path, rig).test_params
    assert len(test) == 30
    assert {pose.tobytes() for pose in test} <= {pose.tobytes() for pose in animation}


def test_validation_poses_are_frames_that_neither_training_nor_test_holds(tmp_path):
    rig = Waves(clips())
    data = write(tmp_path, rig, config(low=1.0, high=1.0, count=5_000))  # frames stay themselves
    animation = {pose.tobytes() for clip in rig.clips for pose in clip.values}
    sets = [{pose.tobytes() for pose in poses} for poses in (data.validation_params, data.test_params, data.params)]
    assert [len(poses) for poses in sets[:2]] == [20, 30] and set.union(*sets) == animation
    assert sum(map(len, sets)) == len(animation)
    assert np.array_equal(data.validation_offsets, rig(np.array(data.validation_params)) - rig.mesh.neutral)


def test_a_split_by_clips_keeps_clips_whole(tmp_path):
    rig = Waves(clips())
    test = {pose.tobytes() for pose in write(tmp_path, rig, config(split="clips", held_out=0.2)).test_params}
    test_clips = [clip for clip in rig.clips if clip.values[0].tobytes() in test]
    assert len(test_clips) == 1 and {pose.tobytes() for pose in test_clips[0].values} == test


def test_a_rig_without_clips_is_sampled_uniformly(tmp_path):
    data = write(tmp_path, Waves(None))
    assert len(data.test_params) == 50
    assert np.abs(data.params).max() <= 1 and np.abs(data.params).max(axis=0).min() > 0.95


def test_a_subset_reads_the_same_offsets(tmp_path):
    data = write(tmp_path)
    rows, vertices = np.array([3, 599, 3]), np.array([39, 0, 7, 8])
    assert np.array_equal(data.vertices_subset(rows, vertices), data.offsets(rows)[:, vertices])


def test_every_rig_call_has_one_shape(tmp_path):
    rig = Waves(clips())
    write(tmp_path, rig)
    assert set(rig.calls) == {(samples.BATCH, 4)}


def test_a_batch_is_as_large_as_rigs_evaluate_at_once_so_that_it_is_filled_up_once():
    from box import foreign, lift  # here: the killed process of another test doesn't find it

    seen = []

    def counted(params):
        seen.append(len(params))
        return lift(params)

    found = [vertices for _, vertices in samples.evaluate(foreign(function=counted), np.zeros((100, 2), np.float32))]
    assert sum(map(len, found)) == 100 and sum(seen) < 100 + samples.BATCH
    assert samples.CHUNK % samples.BATCH == 0


def test_draws_are_balanced_and_a_function_of_the_step(tmp_path):
    data = write(tmp_path)
    rows = np.concatenate([data.draw_for_step(1, "coarse", step, 8) for step in range(4_000)])
    share = np.bincount(data.bins[rows], minlength=16) / len(rows)
    nonempty = np.bincount(data.bins, minlength=16) > 0
    assert np.allclose(share[nonempty], 1 / nonempty.sum(), atol=0.01)
    again = data.draw_for_step(1, "coarse", 77, 8)
    assert np.array_equal(again, data.draw_for_step(1, "coarse", 77, 8))
    others = [data.draw_for_step(2, "coarse", 77, 8), data.draw_for_step(1, "dense", 77, 8)]
    assert not any(np.array_equal(again, other) for other in others)


def test_uniform_draws_take_every_sample_as_often_as_any_other(tmp_path):
    data = write(tmp_path)
    rows = np.concatenate([data.draw_for_step(1, "coarse", step, 8, "uniform") for step in range(4_000)])
    counts = np.bincount(rows, minlength=len(data))
    assert counts.std() < 1.2 * np.sqrt(counts.mean())
    balanced = np.concatenate([data.draw_for_step(1, "coarse", step, 8) for step in range(4_000)])
    assert np.bincount(balanced, minlength=len(data)).std() > 2 * counts.std()


def test_nan_names_pose_and_vertex_and_writes_nothing(tmp_path):
    rig = Waves(clips(), broken_above=2.5)
    first = np.flatnonzero(samples.choose_poses(rig, config(), rng)["training"][:, 0] > 2.5)[0]
    with pytest.raises(InputError, match=f"rig 'waves': vertex 23 of training pose {first}: expected finite mm, got "):
        write(tmp_path, rig)
    assert not list((tmp_path / "out").iterdir())


def test_a_missing_file_is_named(tmp_path):
    write(tmp_path)
    (tmp_path / "out" / "bins.npy").unlink()
    with pytest.raises(InputError, match=r"bins\.npy"):
        SampleSet.open(tmp_path / "out")


class Kill(Exception):
    pass


def stop_after(tmp_path, calls, settings):
    """Write samples until the rig has been called so often, as a kill would end it."""
    rig = Waves(clips())

    class Mortal(Waves):
        def __call__(self, params):
            if len(rig.calls) == calls:
                raise Kill
            return rig(params)

    with pytest.raises(Kill):
        write(tmp_path, Mortal(clips()), settings)


FILES = ["offsets.npy", "steps.npy", "squared_error.npy", "landmarks.npy", "state.sealed", "test_offsets.npy"]


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("place", [0.0, 0.01, 0.3, 0.9])
def test_a_flipped_bit_in_a_stopped_sets_scratch_changes_no_byte(tmp_path, capfd, name, place):
    settings = config(count=2_000)
    whole = tmp_path / "whole"
    whole.mkdir()
    undisturbed = Waves(clips())
    write(whole, undisturbed, settings)
    stop_after(tmp_path, len(undisturbed.calls) - 1, settings)  # all but the last of the test poses
    flip_a_bit(tmp_path / "scratch" / name, place)
    write(tmp_path, settings=settings)
    errors = capfd.readouterr().err
    assert contents(tmp_path / "out") == contents(whole / "out")
    harmless = name == "test_offsets.npy" and place > 0  # rows that are evaluated after that anyway
    assert errors.count("\n") == (0 if harmless else 1) and (harmless or str(tmp_path / "scratch") in errors)


def test_only_what_follows_the_damage_is_evaluated_again(tmp_path, capfd):
    settings = config(count=2_000)
    stop_after(tmp_path, 2_000 // samples.BATCH, settings)
    flip_a_bit(tmp_path / "scratch" / "offsets.npy", 0.5)
    rig = Waves(clips())
    write(tmp_path, rig, settings)
    assert "training poses from 960 on differ" in capfd.readouterr().err
    assert len(rig.calls) < 50


def test_no_file_is_ever_in_two_places(tmp_path, monkeypatch):
    write(tmp_path)
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert all(file.stat().st_nlink == 1 for file in files)
    assert not (tmp_path / "scratch" / "offsets.npy").exists()


def test_a_kill_after_the_last_move_ends_with_the_same_bytes(tmp_path):
    write(tmp_path)
    before = contents(tmp_path / "out")
    for file in (tmp_path / "out").iterdir():
        file.unlink()  # as the store does with what a killed process has filled
    write(tmp_path)
    assert contents(tmp_path / "out") == before


def test_other_poses_start_afresh_in_the_same_scratch(tmp_path):
    write(tmp_path)
    before = contents(tmp_path / "out")
    write(tmp_path, settings=config(low=0.5), folder="other")
    (tmp_path / "alone").mkdir()
    write(tmp_path / "alone", settings=config(low=0.5))
    assert contents(tmp_path / "other") == contents(tmp_path / "alone" / "out")
    assert contents(tmp_path / "out") == before


def chunk_count(state_file):
    return read_sealed(state_file, lambda stream: len(json.load(stream)["sums"]["training"]))


@pytest.mark.parametrize("chunks", [0, 1, 3])
def test_a_kill_at_any_moment_changes_no_byte(tmp_path, chunks):
    script = textwrap.dedent("""
        import sys, time, pathlib
        sys.path[:0] = sys.argv[2:]
        import test_samples
        calm = test_samples.Waves.__call__
        def slow(self, params):
            time.sleep(0.01)
            return calm(self, params)
        test_samples.Waves.__call__ = slow
        test_samples.write(pathlib.Path(sys.argv[1]), settings=test_samples.config(count=2_000))
    """)
    tests, folder, whole = Path(__file__).parent, tmp_path / "killed", tmp_path / "whole"
    folder.mkdir()
    whole.mkdir()
    process = subprocess.Popen([sys.executable, "-c", script, *map(str, (folder, tests, tests.parent, ROOT))])
    scratch_file = folder / "scratch" / ("state.sealed" if chunks else "test_offsets.npy")
    while not (scratch_file.exists() and (not chunks or chunk_count(scratch_file) >= chunks)):
        assert process.poll() is None
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    rig = Waves(clips())
    write(folder, rig, config(count=2_000))
    undisturbed = Waves(clips())
    write(whole, undisturbed, config(count=2_000))
    assert contents(folder / "out") == contents(whole / "out")
    savings = len(undisturbed.calls) - len(rig.calls)
    assert savings >= chunks * samples.CHUNK // samples.BATCH  # it went on rather than starting again
