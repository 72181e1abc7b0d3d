"""Weights in 16 bits: every one is a float16, half of the size is counted, and predictions hardly move."""

import json

import numpy as np
import pytest
from safetensors.torch import load_file
from small_artefacts import predicted, run_stage, write_artefacts

from replicate.base.exceptions import InputError
from replicate.config import CoarseConfig, TrainingConfig
from replicate.engine.store import MANIFEST
from replicate.methods import artefacts, coarse, half
from replicate.methods.method_registry import method_named
from replicate.methods.plan import TrainingSettings


@pytest.fixture(scope="module")
def rounded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("half")
    inputs = write_artefacts(folder)
    schedule = TrainingConfig("one_cycle", 30, 4, "uniform")
    section = CoarseConfig(hidden=(16, 256), map_size=16, training=schedule)
    inputs, trained = run_stage(coarse.train, inputs, "coarse", TrainingSettings(section, 0, "cpu"), folder)
    (inputs["coarse"] / MANIFEST).write_text(json.dumps({"notes": trained}))
    inputs, notes = run_stage(half.round_weights, inputs, "coarse_half", half.RoundedModel("coarse"), folder)
    return inputs, trained, notes


def test_every_weight_is_a_float16_and_half_of_the_size_is_counted(rounded):
    inputs, trained, notes = rounded
    before, after = (load_file(inputs[name] / half.WEIGHTS) for name in ("coarse", "coarse_half"))
    weights = [name for name in before if not name.startswith("segment.") and before[name].is_floating_point()]
    assert before.keys() == after.keys() and weights
    for name in weights:
        np.testing.assert_array_equal(after[name], before[name].numpy().astype(np.float16).astype(np.float32))
    assert any((before[name] != after[name]).any() for name in weights)
    assert notes["size_mb"] == trained["size_mb"] / 2


def test_predictions_move_by_less_than_rounding_can_explain(rounded):
    inputs = rounded[0]
    params = artefacts.load_samples(inputs).validation_params
    whole, short = (predicted(method_named(name), inputs, params) for name in ("coarse", "coarse_half"))
    moved = np.linalg.norm(short - whole, axis=2)
    assert 0 < moved.max() < 0.01 * np.linalg.norm(whole - whole.mean(0), axis=2).max()


def test_weights_beyond_float16_are_refused(rounded, tmp_path, monkeypatch):
    monkeypatch.setattr(half, "LARGEST", 1e-6)
    with pytest.raises(InputError, match="coarse: float16 holds numbers up to"):
        run_stage(half.round_weights, dict(rounded[0]), "again", half.RoundedModel("coarse"), tmp_path)
