"""The PCA network beside a straight line: coefficients of a basis = a linear skip + the layers of `pca`.

The skip starts as ridge regression onto the coefficients, so that the layers learn what a line leaves; both are trained
on Eq. 1 as `pca` is. Of a few strengths λ the one that is best on the validation poses is taken.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.base.schema import number
from replicate.engine.stage import Stage, StageContext
from replicate.methods import pca
from replicate.methods.linear import LinearConfig, chunks, ridge, with_constant
from replicate.methods.method import Method
from replicate.methods.pca import PcaConfig
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks

if TYPE_CHECKING:
    import torch

    import replicate.approximation.model
    import replicate.approximation.samples


@dataclass(frozen=True)
class PcaLineConfig(PcaConfig):
    """The basis and the network as `pca` has them, and the strengths λ of the line's penalty that are tried."""

    strengths: tuple[float, ...] = number(LinearConfig().strengths, 0.0, 1e6)


def default_section(profile: str) -> PcaLineConfig:
    """Return the method's section of the configuration: that of `pca`, and the strengths."""
    section = pca.default_section(profile)
    return PcaLineConfig(**{field.name: getattr(section, field.name) for field in fields(section)})


def stage(plan: Plan) -> Stage:
    """Return the stage that computes the basis, fits the line and trains the network."""
    return plan.stage("pca_line", train, plan.training(METHOD.section(plan.config)), *inputs_of_networks(plan))


def train(context: StageContext) -> None:
    """Compute the basis, fit the line to the coefficients, and train it with the network on Eq. 1."""
    from replicate.baselines.line import CoefficientsBesideLine

    pca.train_on_basis(context, CoefficientsBesideLine, _start)


def _start(
    model: "replicate.approximation.model.SegmentedModel",
    samples: "replicate.approximation.samples.SampleSet",
    section: PcaLineConfig,
    generator: "torch.Generator",
) -> dict:
    (network,) = model.networks
    basis, mean, scale = (tensor.numpy() for tensor in (network.basis, network.mean, model.scale))
    line, strength = fit_line(samples, model.vertices, scale, basis, mean, section.strengths)
    network.start(line, generator)
    return {"strength": strength}


def fit_line(
    samples: "replicate.approximation.samples.SampleSet",
    vertices: np.ndarray,
    scale: np.ndarray,
    basis: np.ndarray,
    mean: np.ndarray,
    strengths: tuple[float, ...],
) -> tuple[np.ndarray, float]:
    """Return the ridge regression onto coefficients, (m + 1, c) with the constant last, and its strength λ.

    samples: the training samples; λ has the smallest squared error, in mm², of the validation poses' coefficients.
    vertices: the k that the basis moves.
    scale: (m,), what parameters are divided by.
    basis: (c, 3k) mm.
    mean: (3k,) mm.
    strengths: the λ that are tried.
    """
    from replicate.baselines.line import onto_basis

    def coefficients() -> Iterator[np.ndarray]:
        return (onto_basis(part, basis, mean) for part in chunks(samples, vertices))

    inputs, held_out = (with_constant(params / scale) for params in (samples.params, samples.validation_params))
    truth = samples.validation_offsets[:, vertices].reshape(len(held_out), -1)
    goal, lengths = onto_basis(truth, basis, mean), np.linalg.norm(basis, axis=1)
    lines = ridge(inputs, coefficients(), strengths)
    errors = [float(np.square((held_out @ line - goal) * lengths).sum()) for line in lines]
    best = int(np.argmin(errors))
    return lines[best], strengths[best]


def load_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the network, its line and its basis."""
    from replicate.baselines.line import CoefficientsBesideLine

    return pca.load_on_basis(inputs["pca_line"], CoefficientsBesideLine)


METHOD = Method(
    "pca_line",
    "PCA network + linear",
    lambda plan: (stage(plan),),
    model=load_model,
    place=60.5,
    note="The PCA network with a linear skip to the coefficients, which starts as ridge regression.",
    colour="#C49C94",
    in_figures=False,
    standard=False,
    default_section=default_section,
)
