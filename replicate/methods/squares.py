"""Squares beside the straight line: ridge regression on p, |p| and p².

As `linear`, with three features of each parameter: Δ ≈ (p, |p|, p², 1) W, p divided by its scale. The effect of one
parameter can be curved; a joint effect of two parameters is out of reach.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts
from replicate.methods.linear import default_section, fit_features, load_fits, with_constant
from replicate.methods.method import Method
from replicate.methods.plan import Plan

if TYPE_CHECKING:
    import replicate.approximation.model


def stage(plan: Plan) -> Stage:
    """Return the stage that fits the weights."""
    return plan.stage(
        "squares",
        fit,
        plan.settings(METHOD.section(plan.config)),
        artefacts.rig_stage(plan),
        artefacts.samples_stage(plan),
    )


def fit(context: StageContext) -> None:
    """Fit the weights to all training samples, for each λ; keep the best on the validation poses."""
    fit_features(context, artefacts.whole_mesh(context.inputs), _features)


def _features(params: np.ndarray, seen: np.ndarray) -> np.ndarray:
    from replicate.baselines.ridge import explicit_features

    return with_constant(explicit_features("squares", params[:, seen]))


def load_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the fit as a model with one matrix."""
    from replicate.baselines.ridge import squares_model

    return load_fits(inputs, "squares", squares_model)


METHOD = Method(
    "squares",
    "Squares",
    lambda plan: (stage(plan),),
    model=load_model,
    place=51,
    rigid_step=False,
    note="Ridge regression from p, |p| and p² to vertices: each rig parameter bends by itself.",
    colour="#009E73",
    in_figures=False,
    standard=False,
    default_section=default_section,
)
