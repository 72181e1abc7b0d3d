"""Ours, trained on the rig's exact derivatives too (Sobolev training), which needs a rig that JAX can trace.

For each training sample it also learns how the face moves from there towards another sample. The network is that of
`regional`, of the same size and speed; only the training sees more of the rig.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.engine.stage import Stage
from replicate.methods import regional
from replicate.methods.method import variant
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks

if TYPE_CHECKING:
    import replicate.regional.model

WEIGHT = 1.0  # of the derivatives in the loss


def default_section(profile: str) -> regional.RegionalConfig:
    """Return the method's section of the configuration: that of `regional`, with derivatives."""
    return replace(regional.default_section(profile), derivatives=WEIGHT)


def stage(plan: Plan) -> Stage:
    """Return the stage that computes bases and derivatives and trains the network."""
    section = METHOD.section(plan.config)
    return plan.stage("regional_derivatives", regional.train, plan.training(section), *inputs_of_networks(plan))


def load_model(inputs: Mapping[str, Path]) -> "replicate.regional.model.RegionalModel":
    """Return the network and its bases."""
    from replicate.regional.model import load

    return load(inputs["regional_derivatives"])


METHOD = variant(
    regional.METHOD,
    "regional_derivatives",
    "Regional + derivatives",
    40.5,
    stages=lambda plan: (stage(plan),),
    model=load_model,
    mark="☆",
    note="Our method, trained on the rig's exact derivatives too, as only a rig that can be differentiated allows.",
    colour="#AA4499",
    default_section=default_section,
    needs_derivatives=True,
)
