"""The fit on p, |p| and p²: exact where a rig is of that kind, which a straight line misses; its size is counted."""

import numpy as np
import pytest
from small_artefacts import predicted, run_stage, write_artefacts
from small_face import M, SmallSamples, exact_samples, small_influence, small_mesh

from replicate.methods import artefacts, linear, squares
from replicate.methods.plan import StageSettings


def bent_samples() -> SmallSamples:
    """Return samples whose offsets are linear in p, |p| and p², where influence allows, with a constant."""
    mesh, rng = small_mesh(), np.random.default_rng(4)
    moves = np.tile(small_influence(mesh).T, (3, 1))[:, :, None]
    slopes, constant = rng.normal(size=(3 * M, len(mesh.neutral), 3)) * moves, rng.normal(size=(len(mesh.neutral), 3))
    constant *= (mesh.segment < 2)[:, None]
    training, fresh = (rng.uniform(-1, 1, (n, M)).astype(np.float32) for n in (300, 24))
    truths = [
        np.tensordot(np.concatenate([p, np.abs(p), p * p], axis=1), slopes, 1) + constant for p in (training, fresh)
    ]
    return exact_samples(training, truths[0].astype(np.float32), fresh, truths[1].astype(np.float32))


def worst_mm(inputs, method) -> float:
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method, inputs, samples.test_params)
    return np.abs(vertices - mesh.neutral - samples.test_offsets)[:, mesh.segment < 2].max()


def test_a_rig_of_lines_moduli_and_squares_is_matched_where_a_line_is_far_off(tmp_path):
    inputs = write_artefacts(tmp_path, bent_samples())
    for method in (linear, squares):
        name = method.__name__.rpartition(".")[2]
        inputs, notes = run_stage(method.fit, inputs, name, StageSettings(method.default_section("quick"), 0), tmp_path)
    assert worst_mm(inputs, squares.SQUARES) < 2e-3 < 0.1 < worst_mm(inputs, linear.METHOD)
    assert notes["strength"] == min(squares.default_section("quick").strengths), (
        "no penalty is needed where there is no noise"
    )


def test_every_weight_of_the_fit_counts_in_its_size(tmp_path):
    inputs, notes = run_stage(
        squares.fit, write_artefacts(tmp_path), "squares", StageSettings(squares.default_section("quick"), 0), tmp_path
    )
    weights = 3 * len(small_mesh().neutral) * (3 * M + 1)
    assert notes["size_mb"] == pytest.approx(4e-6 * weights) == pytest.approx(squares.load_model(inputs).size_mb())


def test_the_strength_is_the_best_on_the_validation_poses(tmp_path):
    section = linear.LinearConfig(strengths=(10.0, 1e-6, 1.0))
    inputs, notes = run_stage(squares.fit, write_artefacts(tmp_path), "squares", StageSettings(section, 0), tmp_path)
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(squares.SQUARES, inputs, samples.validation_params)
    loss = np.square(vertices - mesh.neutral - samples.validation_offsets)
    still = np.square(samples.validation_offsets)
    assert notes["strength"] == 1e-6
    assert loss[:, mesh.segment < 2].sum() < 0.05 * still[:, mesh.segment < 2].sum()
