"""Neural morphs: learned shapes hold a rig of few shapes, and what is written is what was trained."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_artefacts import predicted, run_stage, write_artefacts
from small_face import M, SmallSamples, exact_samples, small_influence, small_mesh

from replicate.approximation.segments import Segment
from replicate.baselines.dense import DenseNetwork, Normalised, make_network
from replicate.baselines.multiplications import of_model
from replicate.config import TrainingConfig, resolve
from replicate.methods import artefacts, linear, morph
from replicate.methods.method_registry import method_named
from replicate.methods.plan import StageSettings, TrainingSettings
from replicate.report.results import read_log

SHORT = TrainingConfig("one_cycle", 900, 32, "uniform", peak_rate=1e-2)
SMALL = morph.MorphConfig(6, (32, 32), training=SHORT)


def joint_samples() -> SmallSamples:
    """Return samples of four shapes, whose weights are products of two parameters, and a constant."""
    mesh, rng = small_mesh(), np.random.default_rng(5)
    moves = small_influence(mesh).any(1)[:, None] & (mesh.segment < 2)[:, None]
    shapes, constant = (rng.normal(size=(k, len(mesh.neutral), 3)) * moves for k in (4, 1))
    training, fresh = (rng.uniform(-1, 1, (n, M)).astype(np.float32) for n in (2_000, 24))
    truths = [np.tensordot(p[:, 0:4] * p[:, 4:8], shapes, 1) + constant for p in (training, fresh)]
    return exact_samples(training, truths[0].astype(np.float32), fresh, truths[1].astype(np.float32))


def mean_mm(inputs, method) -> float:
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method, inputs, samples.test_params)
    return np.abs(vertices - mesh.neutral - samples.test_offsets)[:, mesh.segment < 2].mean()


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("morph")
    inputs = write_artefacts(folder, joint_samples())
    inputs, notes = run_stage(morph.train, inputs, "morph", TrainingSettings(SMALL, 0, "cpu"), folder)
    section = linear.default_section("quick")
    inputs, _ = run_stage(linear.fit, inputs, "linear", StageSettings(section, 0), folder)
    return inputs, notes


def test_six_learned_shapes_hold_a_rig_of_four_where_a_line_is_as_far_off_as_the_mean(trained):
    inputs, _ = trained
    assert mean_mm(inputs, method_named("morph")) < 0.25 * mean_mm(inputs, linear.METHOD)


def test_what_is_read_is_what_was_trained(trained):
    inputs, _ = trained
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method_named("morph"), inputs, samples.validation_params)
    distance = np.linalg.norm(vertices - mesh.neutral - samples.validation_offsets, axis=2)[:, mesh.segment < 2]
    *_, last = read_log(inputs["morph"] / "log.csv")
    assert distance.mean() == pytest.approx(last[2], rel=1e-4), "mean and deviation are in the last layer"


def test_shapes_count_in_size_and_work(trained):
    inputs, notes = trained
    outputs = 3 * int((small_mesh().segment < 2).sum())
    products = M * 32 + 32 * 32 + 32 * 6 + 6 * outputs
    assert of_model(morph.MORPH.model(inputs)) == products
    assert notes["size_mb"] == pytest.approx(4e-6 * (products + 32 + 32 + 6 + outputs))


def test_the_weights_of_shapes_are_linear_in_the_last_hidden_layer():
    torch.manual_seed(0)
    network = DenseNetwork(5, 7, (4,), 0.2, shapes=3)
    first, weights = network.hidden
    params = torch.randn(9, 5)
    activations = torch.nn.functional.leaky_relu(first(params), 0.2)
    matrix = network.output.weight @ weights.weight
    constant = network.output.weight @ weights.bias + network.output.bias
    torch.testing.assert_close(network(params).flatten(1), activations @ matrix.T + constant)


def test_a_coordinate_that_rests_stays_where_it_is():
    torch.manual_seed(1)
    segment = Segment("all", np.arange(2, dtype=np.int32), np.zeros((2, 2), np.float32), np.arange(4, dtype=np.int32))
    network = make_network(segment, {"hidden": [8], "leaky_slope": 0.2, "shapes": 3})
    mean, deviation = torch.randn(6), torch.tensor([0.0, 1.0, 2.0, 0.0, 0.5, 3.0])
    params = torch.randn(5, 4)
    normalised = Normalised(network, mean, deviation)
    expected = normalised(params).detach()
    torch.testing.assert_close(expected.flatten(1)[:, [0, 3]], mean[[0, 3]].expand(5, 2))
    torch.testing.assert_close(normalised.folded()(params).detach(), expected)


def test_the_documented_recipe_is_as_documented_and_the_other_is_that_of_dense_networks():
    printed = method_named("morph").default_section("paper")
    assert (printed.shapes, printed.hidden, printed.normal_weight) == (128, (128, 128), 0.0)
    training = printed.training
    assert (training.steps, training.batch, training.rates, training.draws) == (5_000, 128, (1e-3,), "uniform")
    assert method_named("morph").default_section("laptop") == printed
    for profile in ("quick", "laptop"):
        ours, dense = method_named("morph_best").default_section(profile), resolve("tiny", profile).dense
        assert ours.training == dense.training and ours.normal_weight == dense.normal_weight
    paper = method_named("morph_best").default_section("paper").training
    assert paper == replace(ours.training, steps=resolve("tiny", "paper").dense.training.steps)
