"""The paper's networks, trained as its released code for the Ray rig does; only facts were read from that code.

Constant rates one after the other; batches of 4, in which each sample is as likely as any other; rig parameters and
offsets in the rig's own units, not scaled; first weights as TensorFlow draws them, and small ones for convolutions;
dense networks of 256 and 512. The loss weighs lengths in those units with 10 and the mean of a normal's components
with 50, which is Eq. 1 with α = 5/3 of the unit in millimetres. `make bench-released` takes these apart one by one.

The number of samples and of steps is the profile's.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

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


def as_released(section: Section, key: str, profile: str, **changes: Any) -> Section:
    """Return a section of the configuration with the released recipe, and the steps of the profile's section `key`."""
    steps = read_table(section, PROFILES[profile].get(key, {})).training.steps
    return replace(
        section,
        normal_weight=NORMAL_WEIGHT,
        training=replace(TRAINING, steps=steps),
        conditioning=CONDITIONING,
        **changes,
    )


def coarse_section(profile: str) -> CoarseConfig:
    """Return the coarse networks' section."""
    return as_released(CoarseConfig(), "coarse", profile)


def own_refined(profile: str) -> RefinementConfig:
    """Return the refinement networks' section; the squares are still chosen by the section `refinement`."""
    return as_released(RefinementConfig(), "refinement", profile)


def dense_section(profile: str) -> DenseConfig:
    """Return the section of the dense networks of the released code's widths."""
    return as_released(DenseConfig(), "dense", profile, hidden=(256, 512))


def own_narrow(profile: str) -> DenseConfig:
    """Return the section of the dense networks of the paper's widths."""
    return as_released(DenseConfig(), "dense", profile)


def coarse_stage(plan: Plan) -> Stage:
    """Return the stage that trains the coarse networks."""
    return _stage(plan, COARSE, coarse.train, inputs_of_networks(plan))


def refined_stage(plan: Plan) -> Stage:
    """Return the stage that trains the refinement networks."""
    return _stage(plan, REFINED, refined.train, refined.inputs_of_refinement(plan, coarse_stage(plan)))


def dense_stage(plan: Plan) -> Stage:
    """Return the stage that trains the dense networks of the released widths."""
    return _stage(plan, DENSE, dense_network.train, inputs_of_networks(plan))


def narrow_stage(plan: Plan) -> Stage:
    """Return the stage that trains the dense networks of the paper's widths."""
    return _stage(plan, NARROW, dense_network.train, inputs_of_networks(plan))


def _stage(plan: Plan, name: str, function: Callable, inputs: tuple[Stage, ...]) -> Stage:
    method = next(method for method in METHODS if method.name == name)
    return plan.stage(name, function, plan.training(method.section(plan.config)), *inputs)


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
    _released(coarse.METHOD, COARSE, 61, coarse_section, coarse_stage),
    _released(refined.METHOD, REFINED, 62, own_refined, coarse_stage, refined_stage),
    _released(dense_network.METHOD, DENSE, 63, dense_section, dense_stage),
    _released(dense_network.METHOD, NARROW, 64, own_narrow, narrow_stage),
)
