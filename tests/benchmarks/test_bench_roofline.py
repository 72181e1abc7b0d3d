"""The roofline: what it counts, on models that are known, its table and its figure."""

import numpy as np
import pytest
from sample_rows import roofline_rows
from untrained_models import MESH, MODELS

from replicate.baselines import multiplications
from replicate.benchmarks.bench_roofline import architecture_work, roofline_figure, roofline_table, ways_of
from replicate.methods.method import Method
from replicate.report.results import Row

POSES = np.random.default_rng(0).uniform(-1, 1, (3, 12)).astype(np.float32)


def test_all_ways_give_the_models_offsets_and_the_fast_one_does_less():
    model = MODELS["refined"]()
    method = Method("refined", "Refined", lambda plan: (), model=lambda inputs: model)
    ways, works = ways_of([method], {}, MESH, POSES)
    assert list(ways) == [f"refined{ending}" for ending in ("_plain", "", "_jax", "_onnx", "_fast", "_half")]
    assert list(works) == list(ways)
    expected = model.offsets(POSES[:1])
    np.testing.assert_allclose(ways["refined_fast"](POSES[:1]) - MESH.neutral, expected[0], atol=1e-3)
    for way in ("refined_jax", "refined_onnx"):
        np.testing.assert_allclose(ways[way](POSES[:1]) - MESH.neutral, expected, atol=1e-3)
    assert works["refined"] == works["refined_plain"] == works["refined_jax"] == works["refined_onnx"]
    assert works["refined"].multiplications == multiplications.of_model(model)
    assert works["refined_fast"].multiplications < 0.6 * works["refined"].multiplications
    assert works["refined_half"].read_bytes < works["refined_fast"].read_bytes


def test_a_second_pose_is_placed_from_rest():
    method = Method("linear", "Linear", lambda plan: (), model=lambda inputs: MODELS["linear"]())
    evaluate = ways_of([method], {}, MESH, POSES)[0]["linear_fast"]
    first = evaluate(POSES[:1]).copy()
    evaluate(POSES[1:2])
    np.testing.assert_array_equal(evaluate(POSES[:1]), first)


@pytest.mark.parametrize("name", ["dense", "regional"])
def test_every_weight_of_a_dense_layer_is_read_once(name):
    count, size = architecture_work(MODELS[name]())
    assert 3.5 * count < size < 5 * count


def test_the_table_has_shares_and_a_rule_between_methods():
    given = roofline_rows()
    more = [Row(**{**vars(row), "method": "linear"}) for row in given if row.method == "dense"]
    table = roofline_table([*given, *more], "teen")
    assert [line and line[0] for line in table.body] == [
        "Dense: the suite's",
        "Dense: fast",
        None,
        "Linear: the suite's",
    ]
    assert table.body[1][1:] == ("1.00", "4.0", "10.0", "40.0", "10.0", "20 %", "40 %")
    assert "50.0 billion" in table.notes[0] and "100 GB/s" in table.notes[0]


def test_the_figure_has_both_roofs_and_every_dot():
    figure, words = roofline_figure(roofline_rows(), "teen")
    (axes,) = figure.axes
    texts = {text.get_text() for text in axes.texts}
    assert {"caches, 100 GB/s", "memory, 10 GB/s", "peak: 50 billion a second", "Dense"} == texts
    assert "Dense, fast: 10 billion a second at 0.25 a byte" in words.alt
    low, high = axes.get_ylim()
    assert low < 2.5 and high > 50


def test_labels_of_dots_that_lie_together_are_moved_apart():
    given = [row for row in roofline_rows() if row.method != "dense"]
    near = [Row(**{**vars(row), "method": "coarse_fast", "value": row.value * 1.02}) for row in given]
    figure, _ = roofline_figure(
        [*given, *(row for row in near if row.metric in {"network", "multiplications", "read"})], "teen"
    )
    boxes = {text.get_text(): text.get_window_extent() for text in figure.axes[0].texts}
    assert not boxes["Dense"].overlaps(boxes["Coarse"])
