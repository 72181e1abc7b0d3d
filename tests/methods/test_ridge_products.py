"""Ridge on products: exact where pairs of parameters make the rig, and at rest; its weights are those of the kernel."""

import numpy as np
import pytest
from small_artefacts import predicted, run_stage, write_artefacts
from small_face import M, SmallSamples, exact_samples, small_mesh

from replicate.approximation.conditioning import parameter_scale
from replicate.baselines.multiplications import of_model
from replicate.baselines.ridge import product_features, product_kernel, product_ridges
from replicate.methods import artefacts, squares
from replicate.methods.plan import StageSettings

FEATURES = M * (M + 5) // 2
SECTION = squares.RidgeProductsConfig(components=120, strengths=(1e-10, 1e-6))


def paired_samples() -> SmallSamples:
    """Return samples whose offsets are a linear function of p, |p|, p² and all products, zero at rest."""
    mesh, rng = small_mesh(), np.random.default_rng(6)
    slopes = rng.normal(size=(FEATURES, 100, 3))
    spread = rng.normal(size=(100, len(mesh.neutral))) / 10  # a hundred shapes
    training, fresh = (rng.uniform(-1, 1, (n, M)).astype(np.float32) for n in (700, 24))
    truths = [
        np.einsum("bqc,qn->bnc", np.tensordot(product_features(p), slopes, 1), spread).astype(np.float32)
        for p in (training, fresh)
    ]
    return exact_samples(training, truths[0], fresh, truths[1])


def worst_mm(inputs, method) -> float:
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method, inputs, samples.test_params)
    return np.abs(vertices - mesh.neutral - samples.test_offsets).max()


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("products")
    inputs = write_artefacts(folder, paired_samples())
    section = squares.RidgeProductsConfig(components=400, strengths=(1e-10, 1e-6))
    return run_stage(squares.fit_products, inputs, "ridge_products", StageSettings(section, 0), folder)


def test_a_rig_of_pairs_is_matched_where_squares_are_far_off(fitted, tmp_path):
    inputs, notes = fitted
    section = StageSettings(squares.default_section("quick"), 0)
    inputs, _ = run_stage(squares.fit, inputs, "squares", section, tmp_path)
    motion = np.abs(artefacts.load_samples(inputs).test_offsets).max()
    assert worst_mm(inputs, squares.PRODUCTS) < 1e-3 * motion < 0.1 * motion < worst_mm(inputs, squares.SQUARES)
    assert notes["strength"] == 1e-10, "no penalty is needed where there is no noise"


def test_the_neutral_pose_is_exact(fitted):
    inputs, _ = fitted
    rest = artefacts.load_samples(inputs).default[None]
    np.testing.assert_array_equal(predicted(squares.PRODUCTS, inputs, rest)[0], small_mesh().neutral)


def test_features_and_components_count_in_size_and_work(fitted):
    inputs, notes = fitted
    weights = notes["components"] * (FEATURES + 3 * len(small_mesh().neutral))
    assert of_model(squares.load_products(inputs)) == weights
    assert notes["size_mb"] == pytest.approx(4e-6 * weights)


def test_the_weights_of_features_give_what_the_kernel_gives():
    rng = np.random.default_rng(7)
    inputs, targets, fresh = rng.normal(size=(40, 5)), rng.normal(size=(40, 3)), rng.normal(size=(9, 5))
    (fit,) = product_ridges(inputs, targets, (1e-3,), through_zero=True)
    np.testing.assert_allclose(product_features(fresh) @ fit.matrix(), fit(fresh), atol=1e-10)
    features = product_features(inputs)
    exact = np.linalg.solve(features.T @ features + 40 * 1e-3 * np.eye(features.shape[1]), features.T @ targets)
    np.testing.assert_allclose(fit.matrix(), exact, atol=1e-8)
    np.testing.assert_array_equal(fit(np.zeros((1, 5))), 0)
    np.testing.assert_allclose(product_kernel(inputs, fresh), features @ product_features(fresh).T, atol=1e-10)


def test_parameters_count_from_their_defaults(tmp_path):
    import json

    samples = paired_samples()
    inputs = write_artefacts(tmp_path, samples)
    file = inputs["samples"] / "samples.json"
    facts = json.loads(file.read_text())
    default = np.linspace(-0.3, 0.3, M)
    file.write_text(json.dumps(facts | {"default": default.tolist()}))
    inputs, _ = run_stage(squares.fit_products, inputs, "ridge_products", StageSettings(SECTION, 0), tmp_path)
    scale = parameter_scale(artefacts.load_samples(inputs).params)
    assert (scale != 1).any()
    rest = predicted(squares.PRODUCTS, inputs, default.astype(np.float32)[None])
    np.testing.assert_array_equal(rest[0], small_mesh().neutral)
