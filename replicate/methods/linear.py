"""A straight line: ridge regression from all rig parameters to all vertices. How far from linear is a rig?

Δ ≈ (p / scale, 1) W with W = argmin ‖(p / scale, 1) W − Δ‖² / N + λ ‖W‖² over all N training samples; the constant is
not penalised. Of a few λ the one that is best on the validation poses is taken. Nothing is attached (§3.4): teeth that
move along lines are on them, and on a rig of summed shapes the error is rounding. Networks with a line beside them have
one for each segment.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, Float64

from replicate.base.progress import Progress
from replicate.base.schema import Checked, number
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks

if TYPE_CHECKING:
    import replicate.approximation.model
    import replicate.approximation.samples
    import replicate.approximation.segments

LINES = "lines"
SEGMENTS, WEIGHTS = "segments.npz", "weights.npz"
CHUNK = 512  # samples at a time


@dataclass(frozen=True)
class LinearConfig(Checked):
    """The strengths λ of the penalty that are tried."""

    strengths: tuple[float, ...] = number((1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3), 0.0, 1e6)


def default_section(profile: str) -> LinearConfig:
    """Return the method's section of the configuration, the same in every profile."""
    return LinearConfig()


def stage(plan: Plan) -> Stage:
    """Return the stage that fits the line."""
    inputs = (artefacts.rig_stage(plan), artefacts.samples_stage(plan))
    return plan.stage("linear", fit, plan.settings(METHOD.section(plan.config)), *inputs)


def lines_stage(plan: Plan) -> Stage:
    """Return the stage that fits a line for each segment of the coarse networks."""
    return plan.stage(LINES, fit_lines, plan.settings(METHOD.section(plan.config)), *inputs_of_networks(plan))


def fit(context: StageContext) -> None:
    """Fit the weights of the whole mesh to all training samples, for each λ, and keep the best."""
    fit_features(context, artefacts.whole_mesh(context.inputs), _columns)


def fit_lines(context: StageContext) -> None:
    """Fit the weights of every segment likewise, each to the parameters that move it."""
    fit_features(context, artefacts.load_coarse_segments(context.inputs, artefacts.load_mesh(context.inputs)), _columns)


def _columns(params: np.ndarray, seen: np.ndarray) -> np.ndarray:
    return with_constant(params)[:, np.append(seen, params.shape[1])]


def fit_features(
    context: StageContext,
    segments: "Sequence[replicate.approximation.segments.Segment]",
    features: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> None:
    """Fit features of the parameters for each λ, and keep the λ that is best on the validation poses of all segments.

    segments: what is fitted.
    features: (scaled parameters (b, m), indices (j,) of those that move a segment) → (b, k), the constant last.
    """
    from replicate.approximation.conditioning import parameter_scale
    from replicate.approximation.segments import save_segments

    samples = artefacts.load_samples(context.inputs)
    scale, strengths = parameter_scale(samples.params), context.config.section.strengths
    with context.progress(len(segments), context.name) as bar:
        fitted, strength = best_weights(samples, segments, scale, strengths, features, bar)
    save_segments(segments, context.out / SEGMENTS)
    weights = {f"{k}": weights for k, weights in enumerate(fitted)}
    np.savez(context.out / WEIGHTS, allow_pickle=False, scale=scale, **weights)
    context.note(strength=strength, size_mb=sum(part.nbytes for part in weights.values()) / 1e6)


def best_weights(
    samples: "replicate.approximation.samples.SampleSet",
    segments: "Sequence[replicate.approximation.segments.Segment]",
    scale: Float[np.ndarray, " m"],
    strengths: tuple[float, ...],
    features: Callable[[np.ndarray, np.ndarray], np.ndarray] = _columns,
    bar: Progress | None = None,
) -> tuple[list[Float32[np.ndarray, "_ _"]], float]:
    """Fit all training samples; return each segment's weights (k, 3v) and the λ that is best on the validation poses.

    samples, segments: what is fitted; one λ is taken for all segments.
    scale: what rig parameters are divided by.
    strengths: the λ that are tried.
    features: as for `fit_features`; the parameters themselves by default.
    bar: counts segments.
    """
    training, validation = samples.params / scale, samples.validation_params / scale
    squares, fits = np.zeros(len(strengths)), []
    for segment in segments:
        inputs, held_out = (features(params, segment.parameters) for params in (training, validation))
        solutions = ridge(inputs, chunks(samples, segment.vertices), strengths)
        truth = samples.validation_offsets[:, segment.vertices].reshape(len(held_out), -1)
        squares += [float(np.square(held_out @ weights - truth).sum()) for weights in solutions]
        fits.append([weights.astype(np.float32) for weights in solutions])
        if bar is not None:
            bar.update(1)
    best = int(np.argmin(squares))
    return [solutions[best] for solutions in fits], strengths[best]


def with_constant(params: Float[np.ndarray, "b m"]) -> Float64[np.ndarray, "b n"]:
    """Return parameters with a last column of ones, (b, m + 1)."""
    return np.concatenate([params, np.ones((len(params), 1))], axis=1, dtype=np.float64)


def chunks(
    samples: "replicate.approximation.samples.SampleSet", vertices: np.ndarray
) -> Iterator[Float64[np.ndarray, "k d"]]:
    """Yield the offsets of some vertices in all training samples, a chunk of samples (k, 3v) in mm at a time."""
    for start in range(0, len(samples), CHUNK):
        rows = np.arange(start, min(start + CHUNK, len(samples)))
        yield samples.vertices_subset(rows, vertices).reshape(len(rows), -1).astype(np.float64)


def ridge(
    inputs: Float64[np.ndarray, "n j"], targets: Iterable[Float64[np.ndarray, "k d"]], strengths: tuple[float, ...]
) -> list[np.ndarray]:
    """Return the weights (j, d) for each strength λ; the last input, the constant, is not penalised.

    targets: the (n, d) targets, some rows at a time.
    """
    n, j = inputs.shape
    moments, start = np.zeros(()), 0
    for part in targets:
        moment = inputs[start : start + len(part)].T @ part
        moments, start = moments + moment, start + len(part)
    penalty = np.append(np.ones(j - 1), 0.0)
    gram = inputs.T @ inputs
    return [np.linalg.lstsq(gram + n * strength * np.diag(penalty), moments)[0] for strength in strengths]


def load_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the straight line as a model with one linear layer."""
    from replicate.baselines.line import line_model

    return load_fits(inputs, "linear", line_model)


def load_lines(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the segments' lines as a model with a linear layer for each."""
    from replicate.baselines.line import line_model

    return load_fits(inputs, LINES, line_model)


def load_fits(
    inputs: Mapping[str, Path], name: str, make_model: Callable
) -> "replicate.approximation.model.SegmentedModel":
    """Return the model whose weights `fit_features` wrote.

    name: that of the stage.
    make_model: (segments, their weights (k, 3v), scale (m,), number of vertices) → the model.
    """
    from replicate.approximation.segments import load_segments

    segments = load_segments(inputs[name] / SEGMENTS)
    with np.load(inputs[name] / WEIGHTS, allow_pickle=False) as stored:
        weights = [stored[f"{k}"] for k in range(len(segments))]
        return make_model(segments, weights, stored["scale"], len(artefacts.load_mesh(inputs).neutral))


METHOD = Method(
    "linear",
    "Linear",
    lambda plan: (stage(plan),),
    model=load_model,
    place=50,
    rigid_step=False,
    note="Ridge regression from rig parameters to vertices: a straight line.",
    colour="#56B4E9",
    default_section=default_section,
)
