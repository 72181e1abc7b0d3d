"""Which trainings the comparison makes: each method's rates and changes, the raw animation, and a choice of them."""

import pytest

from replicate.benchmarks.bench_training import CHANGES, RATES, SECTIONS, selected, variants
from replicate.benchmarks.training_table import BALANCED, RAW_ANIMATION
from replicate.config import resolve
from replicate.engine.exceptions import InputError

TRAININGS = variants(4_000)


def test_every_method_is_tried_with_every_change_at_the_same_length():
    assert [(v.method, v.change) for v in TRAININGS[:-1]] == [(m, c) for m in SECTIONS for c in CHANGES]
    for variant in TRAININGS:
        config = resolve("teen", "laptop", variant.overrides)
        assert getattr(config, SECTIONS[variant.method]).training.steps == 4_000
    rates = [resolve("teen", "laptop", v.overrides).dense.training.peak_rate for v in TRAININGS if v.method == "dense"]
    assert rates[: len(RATES)] == list(RATES)


def test_raw_animation_takes_each_frame_as_it_is():
    raw = TRAININGS[-1]
    config = resolve("teen", "laptop", raw.overrides)
    assert raw.change == RAW_ANIMATION and (config.samples.low, config.samples.high) == (1, 1)


def test_a_choice_may_name_several_trainings():
    chosen = selected(TRAININGS, f"coarse, {BALANCED}|coarse, raw")
    assert [(v.method, v.change) for v in chosen] == [("coarse", BALANCED), ("coarse", RAW_ANIMATION)]
    assert selected(TRAININGS, "") == TRAININGS
    with pytest.raises(InputError, match="only is 'sparse': no training is called so; there are coarse, peak rate"):
        selected(TRAININGS, "sparse")
