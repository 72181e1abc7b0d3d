"""The stage "rig_fits": what regressions from rig parameters to PCA coefficients miss of held-out poses."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float64, Int

from replicate.artefacts import built_rig, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.config import ReportFitsConfig
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods.measurement import measured_poses

if TYPE_CHECKING:
    import replicate.approximation.evaluation
    import replicate.approximation.offset_basis
    import replicate.approximation.samples

METHODS = ("neutral", "linear", "squares", "products", "basis")
SHARES = (0.99, 0.999, 0.9999)  # of the variance
LIMITS_DEG = (0.5, 0.25)  # on the mean normal error
FACTS, SPECTRUM = "facts.json", "spectrum.npy"
CHUNK = 512  # samples at a time
TIMES = {"linear": 1, "squares": 1, "products": 8}  # of the fits, beside the basis' 2 and all errors' 4


@dataclass(frozen=True)
class FitNumbers:
    """What the fits depend on; of the test poses as many are taken as Table 2 takes, and the same ones."""

    section: ReportFitsConfig
    test_poses: int
    batch: int
    seed: int


def stage(plan: Plan) -> Stage:
    """Return the stage that fits and measures the regressions."""
    evaluation, modules = plan.config.evaluation, (built_rig, drawn_samples, rigid_segments)
    numbers = FitNumbers(plan.config.rig_report.fits, evaluation.test_poses, evaluation.batch, plan.config.seed)
    return plan.stage("rig_fits", make, numbers, *(module.stage(plan) for module in modules))


def make(context: StageContext) -> None:
    """Fit the regressions, measure them on the test poses, and count the components that these need."""
    from replicate.approximation.evaluation import evaluate
    from replicate.approximation.offset_basis import principal_components

    numbers, section = context.config, context.config.section
    mesh, samples = built_rig.load_mesh(context.inputs), drawn_samples.load(context.inputs)
    rigid = rigid_segments.load(context.inputs).segment.tolist()
    poses = measured_poses(samples.test_params, numbers.test_poses, numbers.seed)
    with context.progress(6 + sum(TIMES.values()), "rig report, fits") as bar:
        some = _choose(context.rng("basis"), len(samples), section.basis_samples)
        basis = principal_components(samples.offsets(some), section.components)
        bar.update(2)
        some = _choose(context.rng("fits"), len(samples), section.samples)
        predictors, facts = fit_all(mesh, samples, basis, some, section.strengths, bar.update)
        truth = samples.test_params[poses], samples.test_offsets[poses]
        errors = evaluate(mesh, *truth, predictors, rigid, numbers.batch)
        bar.update(4)
    for name, error in errors.items():
        error.save(context.out / f"{name}.npz")
    few = poses[:: -(-len(poses) // section.poses)]
    facts |= component_counts(basis, mesh, samples.test_offsets[few])
    (context.out / FACTS).write_text(json.dumps(facts) + "\n", encoding="utf-8")
    np.save(context.out / SPECTRUM, basis.variances / basis.total)
    context.note(**facts)


def fit_all(
    mesh: Mesh,
    samples: "replicate.approximation.samples.SampleSet",
    basis: "replicate.approximation.offset_basis.OffsetBasis",
    rows: Int[np.ndarray, " s"],
    strengths: tuple[float, ...],
    done: Callable[[int], None],
) -> tuple[dict[str, Callable], dict]:
    """Return a predictor (parameters, truth) → vertices for each method, and the facts of the fits.

    rows: the training samples. The strength of each fit is that of the smallest error on the validation poses, in the
    coefficients' mm. done: called with `TIMES` after each fit.
    """
    from replicate.approximation.conditioning import parameter_scale
    from replicate.approximation.polynomial_fits import FITS, closest, feature_count, ridges

    scale, neutral = parameter_scale(samples.params), mesh.neutral
    inputs, held_out = samples.params[rows] / scale, samples.validation_params / scale
    parts = (rows[start : start + CHUNK] for start in range(0, len(rows), CHUNK))
    targets = np.concatenate([basis.project(samples.offsets(part)) for part in parts])
    goal = basis.project(samples.validation_offsets)
    predictors: dict[str, Callable] = {
        "neutral": lambda params, truth: np.repeat(neutral[None], len(params), axis=0),
        "basis": lambda params, truth: neutral + basis.restore(basis.project(truth - neutral)),
    }
    facts: dict = {"samples": len(rows), "strengths": {}, "features": {}}
    for name in FITS:
        fits = zip(strengths, ridges(name, inputs, targets, strengths), strict=True)
        facts["strengths"][name], fit = closest(fits, held_out, goal)
        facts["features"][name] = feature_count(name, inputs.shape[1])
        predictors[name] = lambda params, truth, fit=fit: neutral + basis.restore(fit(params / scale))
        done(TIMES[name])
    return {name: predictors[name] for name in METHODS}, facts


def component_counts(
    basis: "replicate.approximation.offset_basis.OffsetBasis", mesh: Mesh, offsets: Float[np.ndarray, "b n 3"]
) -> dict:
    """Return how many components a share of the variance needs, and a mean normal error on some poses' true offsets.

    Counts are by share in percent ("of_variance") and by limit in degrees ("within_deg"), None where all components are
    too few; "curve" has the error, in degrees, of 1, 2, 4, … components.
    """
    from replicate.approximation.metrics import normal_error
    from replicate.approximation.offset_basis import components_of_variance, components_within

    coefficients, truth = basis.project(offsets), mesh.neutral + np.asarray(offsets, np.float32)
    most = len(basis.variances)

    @cache
    def error(count: int) -> float:
        posed = mesh.neutral + basis.restore(coefficients[:, :count])
        return float(np.nanmean(normal_error(posed, truth, mesh.faces), dtype=np.float64))

    ladder = sorted({min(2**k, most) for k in range(most.bit_length() + 1)})
    return {
        "components": most,
        "component_poses": len(truth),
        "of_variance": {f"{100 * s:g}": components_of_variance(basis.variances, basis.total, s) for s in SHARES},
        "within_deg": {f"{limit:g}": components_within(error, most, limit) for limit in LIMITS_DEG},
        "curve": [(count, error(count)) for count in ladder],
    }


def load_errors(inputs: Mapping[str, Path]) -> "dict[str, replicate.approximation.evaluation.Errors]":
    """Return the errors of each of `METHODS`."""
    from replicate.approximation.evaluation import load_errors

    return {name: load_errors(inputs["rig_fits"] / f"{name}.npz") for name in METHODS}


def load_facts(inputs: Mapping[str, Path]) -> dict:
    """Return the samples, strengths and features of the fits, and the counts of components."""
    return json.loads((inputs["rig_fits"] / FACTS).read_text(encoding="utf-8"))


def load_spectrum(inputs: Mapping[str, Path]) -> Float64[np.ndarray, " c"]:
    """Return each component's share of the variance."""
    return np.load(inputs["rig_fits"] / SPECTRUM, allow_pickle=False)


def _choose(generator: np.random.Generator, count: int, most: int) -> Int[np.ndarray, " k"]:
    return np.sort(generator.choice(count, min(count, most), replace=False))
