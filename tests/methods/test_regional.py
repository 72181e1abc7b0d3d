"""Our method as a stage: it comes near the truth, is stored in few bits, and reads as it was written."""

from dataclasses import replace

import numpy as np
import pytest
from box import foreign
from small_artefacts import predicted, run_stage, write_artefacts
from small_face import M, pose_offsets, small_mesh, small_samples

from replicate.approximation import regional_model, rig_derivatives
from replicate.artefacts import built_rig, drawn_samples
from replicate.artefacts.plan import Numbers, TrainingNumbers
from replicate.engine.exceptions import InputError
from replicate.methods import linear, regional, regional_derivatives

SCHEDULE = replace(regional.TRAINING, steps=800)
SECTION = regional.RegionalConfig(regions=4, components=12, fine=4, hidden=(24, 24), training=SCHEDULE)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("regional")
    inputs = write_artefacts(folder, small_samples(small_mesh(), 1_500))
    inputs, _ = run_stage(linear.fit, inputs, "linear", Numbers(linear.own("quick"), 0), folder)
    return run_stage(regional.train, inputs, "regional", TrainingNumbers(SECTION, 0, "cpu"), folder)


def error(inputs, method) -> float:
    samples, mesh = drawn_samples.load(inputs), small_mesh()
    vertices = predicted(method.METHOD, inputs, samples.test_params)
    return float(np.abs(vertices - mesh.neutral - samples.test_offsets)[:, mesh.segment < 2].mean())


def test_it_is_nearer_to_the_truth_than_a_straight_line(trained):
    inputs, _ = trained
    assert error(inputs, regional) < 0.8 * error(inputs, linear)


def test_its_size_is_that_of_its_file_and_no_region_overlaps_another(trained):
    inputs, notes = trained
    model = regional_model.load(inputs["regional"])
    vertices = sum(len(basis.vertices) for basis in model.bases)
    assert len(np.unique(model.vertices)) == vertices == (small_mesh().segment < 2).sum()
    file = (inputs["regional"] / regional_model.WEIGHTS).stat().st_size
    indices_and_scale = 4 * (vertices + len(model.scale))
    assert notes["size_mb"] * 1e6 == model.size_mb() * 1e6 <= file - indices_and_scale < notes["size_mb"] * 1e6 + 10_000
    kinds = {str(basis.fine.dtype) + str(basis.rough.dtype) for basis in model.bases}
    assert kinds == {"torch.int16torch.int8"}
    assert notes["multiplications"] == model.multiplications()


def slopes_of_the_truth(params, directions):
    """Return the small face's change along directions (b, n, 3), by central differences."""
    step = np.float32(1e-2)
    ahead, behind = (pose_offsets(small_mesh(), params + sign * step * directions) for sign in (1, -1))
    return (ahead - behind) / (2 * step)


def test_trained_on_the_rigs_derivatives_a_model_has_nearly_those_between_samples_too(tmp_path, monkeypatch):
    rng = np.random.default_rng(7)
    monkeypatch.setattr(built_rig, "load", lambda inputs: foreign())
    monkeypatch.setattr(rig_derivatives, "derivative_batches", lambda rig, *both: [slopes_of_the_truth(*both)])
    inputs, errors = write_artefacts(tmp_path / "artefacts", small_samples(small_mesh(), 300)), {}
    params, directions = (rng.uniform(-0.8, 0.8, (2, 32, M))).astype(np.float32)
    for weight in (0.0, 1.0):
        section = replace(SECTION, derivatives=weight, hidden=(96, 96), components=40)
        numbers = TrainingNumbers(section, 0, "cpu")
        (tmp_path / str(weight)).mkdir()
        run, _ = run_stage(regional.train, inputs, "regional", numbers, tmp_path / str(weight))
        offsets = regional.load_model(run).offsets
        slopes = (offsets(params + 0.01 * directions) - offsets(params - 0.01 * directions)) / 0.02
        moved = small_mesh().segment < 2
        errors[weight] = float(np.abs(slopes - slopes_of_the_truth(params, directions))[:, moved].mean())
    assert errors[1.0] < 0.8 * errors[0.0]


def test_the_method_with_derivatives_is_the_other_one_but_for_them():
    own = regional_derivatives.own("laptop")
    assert own.derivatives > 0 and replace(own, derivatives=0.0) == regional.own("laptop")


def test_a_rig_without_derivatives_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(built_rig, "load", lambda inputs: foreign())
    monkeypatch.setattr(regional, "has_function", lambda rig: False)
    inputs = write_artefacts(tmp_path / "artefacts", small_samples(small_mesh(), 60))
    numbers = TrainingNumbers(replace(SECTION, derivatives=0.5), 0, "cpu")
    with pytest.raises(InputError, match=r"derivatives is 0.5, where only 0 is allowed: box is known by its samples"):
        run_stage(regional.train, inputs, "regional", numbers, tmp_path)


def test_a_model_that_is_written_again_reads_the_same(trained, tmp_path):
    inputs, _ = trained
    model = regional_model.load(inputs["regional"])
    regional_model.save(model, tmp_path)
    params = np.array(drawn_samples.load(inputs).test_params)
    np.testing.assert_array_equal(regional_model.load(tmp_path).offsets(params), model.offsets(params))
    (tmp_path / regional_model.WEIGHTS).write_bytes(b"no weights")
    with pytest.raises(InputError, match="no readable model"):
        regional_model.load(tmp_path)
