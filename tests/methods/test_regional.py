"""Our method as a stage: it comes near the truth, is stored in few bits, and reads as it was written."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from box import foreign
from small_artefacts import predicted, run_stage, write_artefacts
from small_face import M, pose_offsets, small_mesh, small_samples

from replicate.base.exceptions import InputError
from replicate.methods import artefacts, linear, regional, regional_derivatives
from replicate.methods import regional as derivatives
from replicate.methods.plan import StageSettings, TrainingSettings
from replicate.regional import model as regional_model
from replicate.regional.basis import RegionalBasis
from replicate.regional.networks import fresh_networks

SCHEDULE = replace(regional.TRAINING, steps=800)
SECTION = regional.RegionalConfig(regions=4, components=12, fine=4, hidden=(24, 24), training=SCHEDULE)
NETWORKS = {
    "one network": SECTION,
    "one for each region": replace(SECTION, by_region=True, by_influence=True, hidden=(12, 12)),
}


@pytest.fixture(scope="module", params=NETWORKS)
def trained(tmp_path_factory, request):
    folder = tmp_path_factory.mktemp("regional")
    inputs = write_artefacts(folder, small_samples(small_mesh(), 1_500))
    inputs, _ = run_stage(linear.fit, inputs, "linear", StageSettings(linear.default_section("quick"), 0), folder)
    settings = TrainingSettings(NETWORKS[request.param], 0, "cpu")
    return run_stage(regional.train, inputs, "regional", settings, folder)


def error(inputs, method) -> float:
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method.METHOD, inputs, samples.test_params)
    return float(np.abs(vertices - mesh.neutral - samples.test_offsets)[:, mesh.segment < 2].mean())


def test_it_is_nearer_to_the_truth_than_a_straight_line(trained):
    inputs, _ = trained
    assert error(inputs, regional) < 0.8 * error(inputs, linear)


def test_at_rest_nothing_moves_at_all(trained):
    inputs, _ = trained
    model, rest = regional_model.load(inputs["regional"]), artefacts.load_samples(inputs).default
    assert np.abs(model.offsets(rest[None])).max() < 3e-4, "mm: rounding"
    assert np.abs(model.offsets(rest[None] + 1e-3)).max() > 1e-4, "and a little beside it something does"


def test_a_trained_and_loaded_models_layers_stay_within_what_training_has_seen(trained):
    inputs, _ = trained
    model, samples = regional_model.load(inputs["regional"]), artefacts.load_samples(inputs)
    corners = np.sign(np.random.default_rng(5).normal(size=(200, samples.params.shape[1]))).astype(np.float32)
    corners *= np.abs(samples.params).max(axis=0)  # many parameters are as large as can be, at once
    offsets, inside = model.offsets(corners), model.offsets(samples.params[:200])
    for part in model.network.networks:
        assert all(bound.isfinite().all() for ends in part.limits for bound in ends)
        for least, most in part.limits:
            least.fill_(-torch.inf), most.fill_(torch.inf)
    assert np.abs(model.offsets(corners) - offsets).max() > 1e-3, "the limits bite in the corners"
    assert np.abs(model.offsets(samples.params[:200]) - inside).max() < 1e-3, "and not where training has been"


def test_its_size_is_that_of_its_file_and_regions_overlap_at_their_borders(trained):
    inputs, notes = trained
    model = regional_model.load(inputs["regional"])
    vertices = sum(len(basis.vertices) for basis in model.bases)
    alone = (small_mesh().segment < 2).sum()
    assert sorted(model.vertices) == np.flatnonzero(small_mesh().segment < 2).tolist()
    assert alone < vertices < 1.6 * alone
    file = (inputs["regional"] / regional_model.WEIGHTS).stat().st_size
    indices_and_scale = 4 * (vertices + len(model.scale)) + 2 * sum(len(seen) for seen in model.network.seen)
    assert notes["size_mb"] * 1e6 == model.size_mb() * 1e6 <= file - indices_and_scale < notes["size_mb"] * 1e6 + 10_000
    kinds = {str(basis.fine.dtype) + str(basis.rough.dtype) for basis in model.bases}
    assert kinds == {"torch.int16torch.int8"}
    assert notes["multiplications"] == model.multiplications()


def test_a_regions_network_sees_the_controls_that_move_it_and_no_others():
    influence = np.zeros((6, 5), bool)
    influence[:3, 1] = influence[2, 3] = influence[3:5, 4] = True
    bases = [basis_of(vertices) for vertices in ([0, 1, 2], [3, 4], [5])]
    section = replace(SECTION, by_region=True, by_influence=True, hidden=(8,))
    network = regional.untrained_networks(bases, influence, section)
    everything = np.arange(5).tolist()
    assert [seen.tolist() for seen in network.seen] == [[1, 3], [4], everything], "nothing is known of the last region"
    params = torch.zeros(5, 5)
    params[1:, [0, 2, 3, 4]] = torch.eye(4)
    moved = (network(params) - network(params)[:1]).abs()[1:].split(2, dim=1)
    assert [(part.amax(1) > 0).tolist() for part in moved[:2]] == [
        [False, False, True, False],
        [False, False, False, True],
    ]
    for change in ({"by_influence": False}, {"by_region": False}):
        (first, *_) = regional.untrained_networks(bases, influence, replace(section, **change)).seen
        assert first.tolist() == (everything if "by_influence" in change else [1, 3, 4])


def basis_of(vertices):
    zeros = np.zeros((2, len(vertices), 3), np.float32)
    return regional_model.store(RegionalBasis(np.array(vertices), zeros[0], zeros), 1)


def test_lines_start_as_the_ridge_regression_of_what_their_network_sees():
    rng = np.random.default_rng(3)
    params, coefficients = rng.normal(size=(50, 5)).astype(np.float32), rng.normal(size=(50, 4)).astype(np.float32)
    network = fresh_networks([np.array([1, 3]), np.array([0, 4])], (8,), [2, 2], gated=True, line=True)
    regional.start(network, params, coefficients, torch.Generator().manual_seed(0))
    for part, seen, wanted in zip(network.networks, network.seen, np.split(coefficients, 2, axis=1), strict=True):
        inputs = np.column_stack([params[:, seen.numpy()], np.ones(50)])
        line = np.linalg.lstsq(inputs, wanted)[0]
        np.testing.assert_allclose(part.line.weight.detach().numpy().T, line[:2], atol=1e-3)
        np.testing.assert_allclose(part.output.bias.detach().numpy(), line[2], atol=1e-3)
        np.testing.assert_allclose(part.highest.numpy(), params[:, seen.numpy()].max(0), rtol=1e-3)


def slopes_of_the_truth(params, directions):
    """Return the small face's change along directions (b, n, 3), by central differences."""
    step = np.float32(1e-2)
    ahead, behind = (pose_offsets(small_mesh(), params + sign * step * directions) for sign in (1, -1))
    return (ahead - behind) / (2 * step)


def test_trained_on_the_rigs_derivatives_a_model_has_nearly_those_between_samples_too(tmp_path, monkeypatch):
    rng = np.random.default_rng(7)
    monkeypatch.setattr(artefacts, "load_rig", lambda inputs: foreign())
    monkeypatch.setattr(derivatives, "derivative_batches", lambda rig, *both: [slopes_of_the_truth(*both)])
    inputs, errors = write_artefacts(tmp_path / "artefacts", small_samples(small_mesh(), 300)), {}
    params, directions = (rng.uniform(-0.8, 0.8, (2, 32, M))).astype(np.float32)
    schedule = replace(SCHEDULE, steps=300)
    for weight in (0.0, 1.0):
        section = replace(SECTION, derivatives=weight, hidden=(96, 96), components=40, training=schedule)
        settings = TrainingSettings(section, 0, "cpu")
        (tmp_path / str(weight)).mkdir()
        run, _ = run_stage(regional.train, inputs, "regional", settings, tmp_path / str(weight))
        offsets = regional.load_model(run).offsets
        slopes = (offsets(params + 0.01 * directions) - offsets(params - 0.01 * directions)) / 0.02
        moved = small_mesh().segment < 2
        errors[weight] = float(np.abs(slopes - slopes_of_the_truth(params, directions))[:, moved].mean())
    assert errors[1.0] < 0.8 * errors[0.0]


def test_the_method_with_derivatives_is_the_other_one_but_for_them():
    own = regional_derivatives.default_section("laptop")
    assert own.derivatives > 0 and replace(own, derivatives=0.0) == regional.default_section("laptop")


def test_a_rig_without_derivatives_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(artefacts, "load_rig", lambda inputs: foreign())
    monkeypatch.setattr(regional, "has_function", lambda rig: False)
    inputs = write_artefacts(tmp_path / "artefacts", small_samples(small_mesh(), 60))
    settings = TrainingSettings(replace(SECTION, derivatives=0.5), 0, "cpu")
    with pytest.raises(
        InputError, match=r"derivatives: expected 0, since box is known by its samples alone, .*, got 0.5"
    ):
        run_stage(regional.train, inputs, "regional", settings, tmp_path)


def test_a_model_that_is_written_again_reads_the_same(trained, tmp_path):
    inputs, _ = trained
    model = regional_model.load(inputs["regional"])
    regional_model.save(model, tmp_path)
    params = np.array(artefacts.load_samples(inputs).test_params)
    np.testing.assert_allclose(regional_model.load(tmp_path).offsets(params), model.offsets(params), atol=3e-4)
    (tmp_path / regional_model.WEIGHTS).write_bytes(b"no weights")
    with pytest.raises(InputError, match="no readable model"):
        regional_model.load(tmp_path)
