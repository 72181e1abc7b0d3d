"""The paper's networks, trained as its released code for the Ray rig does; only facts were read from that code.

Constant rates one after the other; batches of 4, in which each sample is as likely as any other; rig parameters and
offsets in the rig's own units, not scaled; first weights as TensorFlow draws them, and small ones for convolutions;
dense networks of 256 and 512. The loss weighs lengths in those units with 10 and the mean of a normal's components
with 50, which is Eq. 1 with α = 5/3 of the unit in millimetres. `make bench-released` takes these apart one by one.

The number of samples and of steps is the profile's.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

from replicate.base.schema import read_table
from replicate.config import PROFILES, CoarseConfig, ConditioningConfig, DenseConfig, RefinementConfig, TrainingConfig
from replicate.engine.stage import Stage
from replicate.methods import coarse, dense_network, refined
from replicate.methods.method import Method, variant
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks

UNIT_MM = 450.0  # of Ray's rig: the noise of its control points is 0.01 units in the code and 4.5 mm in the paper
NORMAL_WEIGHT = 50 / 3 / 10 * UNIT_MM  # α of Eq. 1, with positions in mm
CONDITIONING = ConditioningConfig("released", UNIT_MM, "released")
TRAINING = TrainingConfig("paper", batch=4, draws="uniform")
COARSE, REFINED, DENSE, NARROW = "coarse_released", "refined_released", "dense_released", "dense_released_narrow"
NOTE = "Trained as the paper's released code does: constant rates, the rig's own units, other first weights."


Section = TypeVar("Section", CoarseConfig, RefinementConfig, DenseConfig)


def as_released(section: Section, key: str, profile: str) -> Section:
    """Return a section of the configuration with the released recipe, and the steps of the profile's section `key`."""
    steps = read_table(section, PROFILES[profile].get(key, {})).training.steps
    training = replace(TRAINING, steps=steps)
    return replace(section, normal_weight=NORMAL_WEIGHT, training=training, conditioning=CONDITIONING)


def _stage(plan: Plan, name: str, function: Callable, inputs: tuple[Stage, ...]) -> Stage:
    method = next(method for method in METHODS if method.name == name)
    return plan.stage(name, function, plan.training(method.section(plan.config)), *inputs)


def coarse_stage(plan: Plan) -> Stage:
    """Return the stage that trains the coarse networks."""
    return _stage(plan, COARSE, coarse.train, inputs_of_networks(plan))


def refined_stage(plan: Plan) -> Stage:
    """Return the stage that trains the refinement networks; the section `refinement` still chooses the squares."""
    return _stage(plan, REFINED, refined.train, refined.inputs_of_refinement(plan, coarse_stage(plan)))


def dense_stage(name: str, plan: Plan) -> Stage:
    """Return the stage that trains dense networks."""
    return _stage(plan, name, dense_network.train, inputs_of_networks(plan))


def _released(
    method: Method,
    name: str,
    place: float,
    default_section: Callable,
    *stages: Callable[[Plan], Stage],
) -> Method:
    return variant(
        method,
        name,
        f"{method.label}, released recipe{', 256/256' if name == NARROW else ''}",
        place,
        stages=lambda plan: tuple(stage(plan) for stage in stages),
        default_section=default_section,
        note=NOTE,
        mark="¤",
    )


METHODS = (
    _released(coarse.METHOD, COARSE, 61, partial(as_released, CoarseConfig(), "coarse"), coarse_stage),
    _released(
        refined.METHOD,
        REFINED,
        62,
        partial(as_released, RefinementConfig(), "refinement"),
        coarse_stage,
        refined_stage,
    ),
    _released(
        dense_network.METHOD,
        DENSE,
        63,
        partial(as_released, DenseConfig(hidden=(256, 512)), "dense"),
        partial(dense_stage, DENSE),
    ),
    _released(
        dense_network.METHOD, NARROW, 64, partial(as_released, DenseConfig(), "dense"), partial(dense_stage, NARROW)
    ),
)
