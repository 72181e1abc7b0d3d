"""Squares beside the straight line: ridge regression on p, |p| and p², segment by segment.

As `linear`, with three features of each parameter: Δ ≈ (p, |p|, p², 1) W, p divided by its scale. What each parameter
does by itself it can bend; what two parameters do together it can't know.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.artefacts import built_rig, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.linear import SEGMENTS, WEIGHTS, LinearConfig, chunks, ridge, with_constant
from replicate.methods.method import Method
from replicate.methods.training_stage import inputs_of_networks

if TYPE_CHECKING:
    import replicate.approximation.model


def own(profile: str) -> LinearConfig:
    """Return the method's section of the configuration, the same in every profile."""
    return LinearConfig()


def stage(plan: Plan) -> Stage:
    """Return the stage that fits the weights."""
    return plan.stage("squares", fit, plan.numbers(METHOD.section(plan.config)), *inputs_of_networks(plan))


def fit(context: StageContext) -> None:
    """Fit the weights of every segment to all training samples, for each λ; keep the best on the validation poses."""
    from replicate.approximation.conditioning import parameter_scale
    from replicate.approximation.polynomial_fits import explicit_features
    from replicate.approximation.segments import save_segments

    mesh, samples = built_rig.load_mesh(context.inputs), drawn_samples.load(context.inputs)
    segments = rigid_segments.load_coarse_segments(context.inputs, mesh)
    scale, strengths = parameter_scale(samples.params), context.config.section.strengths
    squares, fits = np.zeros(len(strengths)), []
    with context.progress(len(segments), "squares") as bar:
        for segment in segments:
            inputs, held_out = (
                with_constant(explicit_features("squares", (params / scale)[:, segment.parameters]))
                for params in (samples.params, samples.validation_params)
            )
            solutions = ridge(inputs, chunks(samples, segment.vertices), strengths)
            truth = samples.validation_offsets[:, segment.vertices].reshape(len(held_out), -1)
            squares += [float(np.square(held_out @ weights - truth).sum()) for weights in solutions]
            fits.append([weights.astype(np.float32) for weights in solutions])
            bar.update(1)
    best = int(np.argmin(squares))
    save_segments(segments, context.out / SEGMENTS)
    weights = {f"{k}": solutions[best] for k, solutions in enumerate(fits)}
    np.savez(context.out / WEIGHTS, scale=scale, **weights)
    context.note(strength=strengths[best], size_mb=sum(part.nbytes for part in weights.values()) / 1e6)


def load_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the fits as a model of one matrix a segment."""
    from replicate.approximation.segments import load_segments
    from replicate.approximation.squares_line import squares_model

    segments = load_segments(inputs["squares"] / SEGMENTS)
    with np.load(inputs["squares"] / WEIGHTS, allow_pickle=False) as stored:
        weights = [stored[f"{k}"] for k in range(len(segments))]
        return squares_model(segments, weights, stored["scale"], len(built_rig.load_mesh(inputs).neutral))


METHOD = Method(
    "squares",
    "Squares",
    lambda plan: (stage(plan),),
    model=load_model,
    place=51,
    note="Ridge regression from p, |p| and p² to vertices, segment by segment: each rig parameter bends by itself.",
    colour="#666666",
    in_figures=False,
    standard=False,
    own=own,
)
