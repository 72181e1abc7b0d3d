"""Dense networks at the size of the refined model: the rules for width and rank, and what the compacted ones keep."""

import numpy as np
import pytest
import torch
from small_artefacts import predicted, run_stage, write_artefacts
from small_face import small_mesh, small_samples

from replicate.approximation.model_size import MapShape, cnn_weights, dense_size_mb
from replicate.approximation.refinement import square_segments
from replicate.approximation.segments import save_segments
from replicate.base.exceptions import InputError
from replicate.baselines.low_rank_dense import choose_ranks, output_components
from replicate.config import DenseConfig, TrainingConfig
from replicate.methods import artefacts, dense_compact, dense_network, dense_small
from replicate.methods.dense_small import RefinedShapes, refined_size_mb
from replicate.methods.plan import TrainingSettings

TRAINING = TrainingConfig("one_cycle", 600, peak_rate=5e-3)
WIDE = DenseConfig((32, 64), training=TRAINING)


def shape(hidden: int) -> RefinedShapes:
    """Return the shapes of map networks with one dense layer before their maps, the wider the larger."""
    return RefinedShapes(MapShape(16, 2, (hidden, 64)), MapShape(16, 2, (hidden, 64)))


@pytest.fixture
def inputs(tmp_path):
    """The artefacts of the stand-in character, with one refinement square in its face."""
    inputs = write_artefacts(tmp_path, small_samples(small_mesh(), 600))
    first = artefacts.load_coarse_segments(inputs, small_mesh())[0]
    squares = square_segments(first, np.array([[0.3, 0.7]]), artefacts.load_influence(inputs), 0.4)
    inputs["selection"] = tmp_path / "selection"
    inputs["selection"].mkdir()
    save_segments(squares, inputs["selection"] / artefacts.SQUARES)
    return inputs


def test_the_size_that_counts_is_that_of_both_levels_of_networks(inputs):
    segments = artefacts.load_coarse_segments(inputs, small_mesh())
    seen = [len(s.parameters) for s in (*segments, *artefacts.load_squares(inputs))]
    assert len(seen) == 3
    weights = sum(cnn_weights(count, MapShape(16, 2, (8, 64))) for count in seen)
    assert refined_size_mb(inputs, shape(8)) == pytest.approx(4e-6 * weights)


def test_the_last_layer_is_as_wide_as_the_refined_models_size_allows(inputs):
    segments = artefacts.load_coarse_segments(inputs, small_mesh())
    sizes = [len(s.parameters) for s in segments], [len(s.vertices) for s in segments]
    room = refined_size_mb(inputs, shape(64))
    first, last = dense_small.narrow_widths(inputs, (32, 256), shape(64))
    assert first == 32 and 1 <= last < 256
    assert dense_size_mb(*sizes, (32, last)) <= room < dense_size_mb(*sizes, (32, last + 1))
    assert dense_small.narrow_widths(inputs, (32, 2), shape(64)) == (32, 2), "it is never wider than dense itself"
    with pytest.raises(InputError, match=r"dense.hidden is \[4096, 8\]: its layers before the last are as large as"):
        dense_small.narrow_widths(inputs, (4096, 8), shape(8))


def test_narrow_networks_are_trained_as_dense_ones_and_are_no_larger_than_the_refined_model(inputs, tmp_path):
    settings = dense_small.SmallSettings(WIDE, 0, "cpu", shape(32))
    inputs, notes = run_stage(dense_small.train, inputs, "dense_small", settings, tmp_path)
    room = refined_size_mb(inputs, shape(32))
    assert 0.9 * room < notes["size_mb"] <= room
    assert notes["hidden"] == list(dense_small.narrow_widths(inputs, (32, 64), shape(32)))
    assert dense_small.METHOD.model(inputs).networks[0].output.in_features == notes["hidden"][-1]
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    offsets = predicted(dense_small.METHOD, inputs, samples.test_params) - mesh.neutral
    moved = mesh.segment < 2
    error = np.abs(offsets - samples.test_offsets)[:, moved].mean()
    assert error < 0.4 * np.abs(samples.test_offsets)[:, moved].mean()


def test_components_are_principal_and_give_the_outputs_back():
    rng = np.random.default_rng(0)
    weight, bias = rng.normal(size=(12, 5)), rng.normal(size=12)
    activations = rng.normal(size=(400, 5)) * [5, 1, 0.5, 0.1, 0] + 2
    parts = output_components(weight, bias, activations)
    outputs = activations @ weight.T + bias
    assert len(parts.lengths) == 4, "an activation that rests adds no component"
    coefficients = (activations - parts.middle) @ parts.readers.T
    np.testing.assert_allclose(coefficients @ parts.shapes + parts.mean, outputs, atol=1e-9)
    np.testing.assert_allclose(coefficients.T @ coefficients / 400, np.eye(4), atol=1e-9)
    exact = np.linalg.svd(outputs - outputs.mean(0), compute_uv=False)[:4] / 400**0.5
    np.testing.assert_allclose(parts.lengths, exact, rtol=1e-9)


def test_ranks_fill_the_room_by_variance_and_want_room_for_the_first_layers():
    from replicate.baselines.dense import DenseNetwork
    from replicate.baselines.low_rank_dense import stored_bytes

    networks = [DenseNetwork(4, 30, (8,), 0.2), DenseNetwork(4, 30, (8,), 0.2)]
    rng = np.random.default_rng(1)
    hidden = rng.normal(size=(50, 8))
    components = [output_components(rng.normal(size=(90, 8)), np.zeros(90), hidden) for _ in networks]
    assert choose_ranks(networks, components, [1.0, 1.0], 1.0) == [8, 8]
    empty = 2 * stored_bytes((4, 8), 90, 0)
    room = (empty + 5 * (stored_bytes((4, 8), 90, 1) - stored_bytes((4, 8), 90, 0))) / 1e6
    assert sum(choose_ranks(networks, components, [1.0, 1.0], room)) == 5
    assert choose_ranks(networks, components, [1.0, 1e3], room) == [0, 5], "what moves further comes first"
    with pytest.raises(InputError, match="without its last layer takes"):
        choose_ranks(networks, components, [1.0, 1.0], 0.5 * empty / 1e6)


@pytest.fixture
def trained(inputs, tmp_path):
    return run_stage(dense_network.train, inputs, "dense", TrainingSettings(WIDE, 0, "cpu"), tmp_path)


def compacted(trained, shapes, folder):
    inputs, _ = trained
    settings = dense_compact.CompactSettings(dense_compact.default_section("quick"), shapes)
    return run_stage(dense_compact.make, inputs, "dense_compact", settings, folder)


def test_with_room_enough_the_compacted_networks_give_what_the_trained_ones_give(trained, tmp_path):
    inputs, notes = compacted(trained, shape(512), tmp_path)
    params = np.array(artefacts.load_samples(inputs).test_params)
    exact, few = (predicted(method.METHOD, inputs, params) for method in (dense_network, dense_compact))
    assert np.abs(few - exact).mean() < 0.003 and np.abs(few - exact).max() < 0.05, "rounding alone"
    assert 0.0 < notes["size_mb"] < 0.5 * trained[1]["size_mb"]
    stored = {value.dtype for network in dense_compact.load_model(inputs).networks for value in network.buffers()}
    assert {torch.int8, torch.int16, torch.float16} <= stored
    on_disk = (inputs["dense_compact"] / "weights.safetensors").stat().st_size / 1e6
    assert notes["size_mb"] < on_disk < notes["size_mb"] + 0.02, "what is counted is what is stored, but for indices"


def test_an_eighth_of_the_size_costs_little(trained, tmp_path):
    inputs, notes = compacted(trained, shape(40), tmp_path)
    room = refined_size_mb(inputs, shape(40))
    assert 0.9 * room < notes["size_mb"] <= room < trained[1]["size_mb"]
    assert 0 < min(notes["ranks"].values())
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    truth, moved = mesh.neutral + samples.test_offsets, mesh.segment < 2
    error, few = (
        np.abs(predicted(method.METHOD, inputs, samples.test_params) - truth)[:, moved].mean()
        for method in (dense_network, dense_compact)
    )
    assert few < 1.2 * error
