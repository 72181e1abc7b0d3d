"""Ridge regression on more than a line: each parameter bends by itself (`squares`), or in pairs (`ridge_products`).

As `linear`, with more features of the parameters: `squares` has p, |p| and p², p divided by its scale, to all vertices.
A joint effect of two parameters is out of its reach. `ridge_products` has the products of any two as well, p counted
from the neutral pose; the features mix principal components of training offsets. It is the fit "with products" of `make
rig-report`, but without a constant, so that the neutral pose is exact; as there, the strength λ is chosen on the
validation poses.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.base.schema import Checked, number
from replicate.config import ReportFitsConfig
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts
from replicate.methods.linear import CHUNK, default_section, fit_features, load_fits, with_constant
from replicate.methods.method import Method
from replicate.methods.plan import Plan

if TYPE_CHECKING:
    import replicate.approximation.model


def stage(plan: Plan) -> Stage:
    """Return the stage that fits the weights."""
    return plan.stage(
        "squares",
        fit,
        plan.settings(SQUARES.section(plan.config)),
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


# All products of two parameters.

USUAL = ReportFitsConfig()


@dataclass(frozen=True)
class RidgeProductsConfig(Checked):
    """The settings of the fit, by default those of the rig report."""

    samples: int = number(USUAL.samples, 2, 30_000)  # training samples at most
    basis_samples: int = number(USUAL.basis_samples, 2, 20_000)  # training samples that the components are of
    components: int = number(USUAL.components, 1, 20_000)
    strengths: tuple[float, ...] = number(USUAL.strengths, 1e-15, 1e6)  # λ that are tried


def products_section(profile: str) -> RidgeProductsConfig:
    """Return the method's section of the configuration, the same in every profile."""
    return RidgeProductsConfig()


def products_stage(plan: Plan) -> Stage:
    """Return the stage that computes the components and fits their weights."""
    return plan.stage(
        "ridge_products",
        fit_products,
        plan.settings(PRODUCTS.section(plan.config)),
        artefacts.rig_stage(plan),
        artefacts.samples_stage(plan),
    )


def fit_products(context: StageContext) -> None:
    """Fit the components' weights to training samples, for each λ; keep the best on the validation poses."""
    import torch
    from scipy.sparse import identity
    from threadpoolctl import threadpool_limits

    from replicate.approximation.conditioning import parameter_scale
    from replicate.approximation.losses import spread
    from replicate.approximation.model import SegmentedModel, save_model
    from replicate.baselines.ridge import ProductShapes, closest, product_ridges
    from replicate.regional.basis import principal_basis

    section, samples = context.config.section, artefacts.load_samples(context.inputs)
    (segment,) = artefacts.whole_mesh(context.inputs)
    scale, count = parameter_scale(samples.params), len(segment.vertices)
    rest = np.asarray(samples.default, np.float32) / scale
    rows = spread(len(samples), section.samples)
    with context.progress(3, context.name) as bar, threadpool_limits(1):
        # the components, and the coefficients of all samples
        some = samples.vertices_subset(spread(len(samples), section.basis_samples), segment.vertices)
        metric = identity(count, format="csr")
        basis = principal_basis(segment.vertices, some, metric, section.components, through_rest=True)
        shapes = basis.components.reshape(len(basis.components), -1)
        parts = (rows[start : start + CHUNK] for start in range(0, len(rows), CHUNK))
        offsets = (samples.vertices_subset(part, segment.vertices) for part in parts)
        targets = np.concatenate([part.reshape(len(part), -1) @ shapes.T for part in offsets])
        bar.update(1)
        # their weights
        inputs, held_out = (params / scale - rest for params in (samples.params[rows], samples.validation_params))
        goal = samples.validation_offsets[:, segment.vertices].reshape(len(held_out), -1) @ shapes.T
        fits = product_ridges(inputs, targets, section.strengths, through_zero=True)
        strength, best = closest(zip(section.strengths, fits, strict=True), held_out, goal)
        bar.update(1)
        matrix = best.matrix()
        bar.update(1)
    network = ProductShapes(torch.from_numpy(rest), len(shapes), count)
    with torch.no_grad():
        network.weights.weight.copy_(torch.from_numpy(matrix.T))
        network.shapes.weight.copy_(torch.from_numpy(shapes.T))
    model = SegmentedModel([network], [segment], scale, [1.0], count)
    save_model(model, context.out, {"shapes": len(shapes)})
    context.note(strength=strength, components=len(shapes), size_mb=model.size_mb())


def load_products(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the weights of features and the components as a model."""
    import torch

    from replicate.approximation.model import load_model
    from replicate.approximation.segments import Segment
    from replicate.baselines.ridge import ProductShapes

    def network(segment: Segment, facts: dict) -> ProductShapes:
        return ProductShapes(torch.zeros(len(segment.parameters)), facts["shapes"], len(segment.vertices))

    return load_model(inputs["ridge_products"], network)


SQUARES = Method(
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
PRODUCTS = Method(
    "ridge_products",
    "Ridge, products",
    lambda plan: (products_stage(plan),),
    model=load_products,
    place=52,
    rigid_step=False,
    note="Ridge regression from p, |p|, p² and all products of two rig parameters to principal components.",
    colour="#4D7A1F",
    in_figures=False,
    standard=False,
    default_section=products_section,
)
METHODS = (SQUARES, PRODUCTS)
