"""The training loop: its schedules, and that a killed run ends with the same bits."""

import csv
import math

import numpy as np
import pytest
import torch
from damage import flip_a_bit
from small_face import small_mesh, small_samples, train_small

from replicate.approximation import cnn, training
from replicate.config import CoarseConfig, TrainingConfig


def test_the_papers_schedule_goes_through_three_rates():
    config = TrainingConfig("paper", steps=70)
    rates = [training.learning_rate(config, step) for step in range(70)]
    assert rates == [1e-3] * 50 + [1e-4] * 10 + [1e-5] * 10


def test_one_cycle_warms_up_and_comes_down_as_a_cosine():
    config = TrainingConfig("one_cycle", steps=1000, peak_rate=2e-3, warm_up=0.05)
    rates = [training.learning_rate(config, step) for step in range(1000)]
    assert rates[0] == pytest.approx(2e-3 / 50) and max(rates) == pytest.approx(2e-3)
    assert rates[49] == pytest.approx(2e-3) and rates[50] == pytest.approx(2e-3)
    assert rates[525] == pytest.approx(1e-3, rel=1e-3)
    assert rates[-1] == pytest.approx(2e-3 * (1 - math.cos(math.pi / 950)) / 2)


def test_a_warm_restart_goes_through_the_shorter_schedule_twice():
    once = TrainingConfig("one_cycle", steps=500)
    twice = TrainingConfig("two_cycles", steps=1000)
    rates = [training.learning_rate(once, step) for step in range(500)]
    assert [training.learning_rate(twice, step) for step in range(1000)] == rates * 2


class Kill(Exception):
    pass


def run(scratch, kill_at=None):
    """Train a small coarse model; with kill_at, stop with an exception in the middle of that step."""
    mesh = small_mesh()
    samples = small_samples(mesh)
    config = CoarseConfig(map_size=16, training=TrainingConfig("one_cycle", steps=30))
    draw = type(samples).draw_for_step

    def draw_or_die(self, seed, stream, step, batch, draws):
        if step == kill_at:
            raise Kill
        return draw(self, seed, stream, step, batch, draws)

    mortal = type("Mortal", (type(samples),), {"draw_for_step": draw_or_die})(**vars(samples))
    _, model, log = train_small(cnn, config, scratch, 4, mortal)
    return {name: value.clone() for name, value in model.state_dict().items()}, log


def test_a_run_killed_twice_ends_with_the_same_bits(tmp_path, monkeypatch):
    undisturbed, log = run(tmp_path / "a")
    monkeypatch.setattr(training, "CHECKPOINT_S", 0.0)  # a checkpoint after every step
    for kill_at in (11, 23):
        with pytest.raises(Kill):
            run(tmp_path / "b", kill_at)
    resumed, resumed_log = run(tmp_path / "b")
    assert resumed.keys() == undisturbed.keys()
    for name, value in undisturbed.items():
        assert torch.equal(resumed[name], value), name
    assert resumed_log == log


@pytest.mark.parametrize("place", [0.0, 0.3, 0.6, 0.99])
def test_a_checkpoint_with_one_flipped_bit_is_named_and_trained_over(tmp_path, monkeypatch, capfd, place):
    undisturbed, log = run(tmp_path / "a")
    monkeypatch.setattr(training, "CHECKPOINT_S", 0.0)
    with pytest.raises(Kill):
        run(tmp_path / "b", kill_at=11)
    checkpoint = tmp_path / "b" / "checkpoint.sealed"
    flip_a_bit(checkpoint, place)
    capfd.readouterr()
    again, again_log = run(tmp_path / "b")
    errors = capfd.readouterr().err
    assert str(checkpoint) in errors and "damaged" in errors and errors.count("\n") == 1
    assert all(torch.equal(again[name], value) for name, value in undisturbed.items()) and again_log == log


def test_half_a_checkpoint_is_trained_over(tmp_path):
    undisturbed, _ = run(tmp_path / "a")
    (tmp_path / "b").mkdir()
    whole = (tmp_path / "a" / "checkpoint.sealed").read_bytes()
    (tmp_path / "b" / "checkpoint.sealed").write_bytes(whole[: len(whole) // 2])
    again, _ = run(tmp_path / "b")
    assert all(torch.equal(again[name], value) for name, value in undisturbed.items())


def test_a_resumed_run_does_not_start_again(tmp_path):
    run(tmp_path)
    with pytest.raises(Kill):
        run(tmp_path / "fresh", kill_at=0)
    run(tmp_path, kill_at=0)  # finished: no step is drawn again


def test_different_seeds_give_different_draws():
    samples = small_samples(small_mesh())
    draws = [tuple(samples.draw_for_step(seed, "coarse", step, 8)) for seed in (0, 1) for step in (0, 1)]
    assert len(set(draws)) == 4


def test_the_log_is_a_csv_of_steps_and_errors(tmp_path):
    rows = [{"step": 10, "loss": 0.5, "mm": 1.25, "degrees": 3.0}]
    training.write_log(rows, tmp_path / "log.csv")
    with open(tmp_path / "log.csv", newline="") as file:
        assert list(csv.reader(file)) == [["step", "loss", "mm", "degrees"], ["10", "0.5", "1.25", "3.0"]]
    assert b"\r" not in (tmp_path / "log.csv").read_bytes()


def test_the_log_has_its_rows_and_the_loss_falls(tmp_path):
    _, log = run(tmp_path)
    assert [row["step"] for row in log] == list(range(1, 31))
    assert np.mean([row["loss"] for row in log[-5:]]) < 0.8 * np.mean([row["loss"] for row in log[:5]])
