"""The trained dense baseline at the CNN's size: its last layers become low-rank products in few bits.

The rule is the same for all characters: principal components of the last layers' outputs over training poses are kept
in the order of their variance per coordinate, as many as keep the model no larger than the refined one.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.base.schema import Checked, number
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts, dense_network
from replicate.methods.dense_small import RefinedShapes, inputs_of_size, refined_size_mb, shapes
from replicate.methods.method import variant
from replicate.methods.plan import Plan

if TYPE_CHECKING:
    import replicate.approximation.model


@dataclass(frozen=True)
class CompactConfig(Checked):
    """How many training samples, spread over the set, the components are computed from."""

    samples: int = number(2_000, 2, 1_000_000)


@dataclass(frozen=True)
class CompactSettings:
    """The method's section, and the shapes of the networks that limit the size."""

    section: CompactConfig
    shapes: RefinedShapes


def default_section(profile: str) -> CompactConfig:
    """Return the method's section of the configuration, the same in every profile."""
    return CompactConfig()


def stage(plan: Plan) -> Stage:
    """Return the stage that compacts the trained dense networks."""
    settings = CompactSettings(METHOD.section(plan.config), shapes(plan))
    return plan.stage("dense_compact", make, settings, *inputs_of_size(plan), dense_network.stage(plan))


def make(context: StageContext) -> None:
    """Read the dense networks, and write them with low-rank last layers."""
    from replicate.approximation.losses import spread
    from replicate.approximation.model import save_model
    from replicate.approximation.training import prepare
    from replicate.baselines import low_rank_dense
    from replicate.baselines.dense import load_dense

    prepare("cpu")
    samples, trained = artefacts.load_samples(context.inputs), load_dense(context.inputs["dense"])
    params = np.asarray(samples.params[spread(len(samples), context.config.section.samples)])
    size_mb = refined_size_mb(context.inputs, context.config.shapes)
    model = low_rank_dense.compact(trained, params, size_mb)
    ranks = {s.name: len(network.inner) for s, network in zip(model.segments, model.networks, strict=True)}
    first = model.networks[0]
    hidden = [layer.out_features for layer in first.hidden]
    save_model(model, context.out, {"hidden": hidden, "leaky_slope": first.slope, "ranks": ranks})
    context.note(size_mb=low_rank_dense.size_mb(model), ranks=ranks)


def load_model(inputs: Mapping[str, Path]) -> "replicate.approximation.model.SegmentedModel":
    """Return the networks with low-rank last layers."""
    from replicate.approximation.model import load_model
    from replicate.baselines.low_rank_dense import empty_network

    return load_model(inputs["dense_compact"], empty_network)


METHOD = variant(
    dense_network.METHOD,
    "dense_compact",
    "Dense, compacted",
    64.7,
    stages=lambda plan: (stage(plan),),
    model=load_model,
    note="The trained dense networks, their last layers low-rank in 8 and 16 bits: no larger than the refined model.",
    default_section=default_section,
)
