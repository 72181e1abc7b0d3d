"""The paper's networks with wider decoders, and trained for longer: controls for what limits them.

Wider: four times the numbers that make a map, and twice the channels.

The last dense layer has 2,048 units in place of 512, which are 8×8 pixels of 32 channels, and every convolution has 32
channels in place of 16; all else, schedule and steps too, is that of `coarse` and `refined`. The widths were chosen
once, on validation poses, for all characters: `make bench-decoder` compares them. The compiled kernels are for 16
channels, so that a step takes about three times as long as one of `coarse`.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

from replicate.base.schema import read_table
from replicate.config import PROFILES, CoarseConfig, RefinementConfig
from replicate.engine.stage import Stage
from replicate.methods import coarse, refined
from replicate.methods.method import variant
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks

HIDDEN, CHANNELS = (256, 2_048), 32
COARSE, REFINED, LONGER = "coarse_wide", "refined_wide", "coarse_longer"
NOTE = "Wider decoders: 2,048 numbers make a map in place of 512, and convolutions have 32 channels in place of 16."

Section = TypeVar("Section", CoarseConfig, RefinementConfig)


def widened(section: Section, key: str, profile: str) -> Section:
    """Return the profile's section `key`, whose defaults are `section`, with the wider layers."""
    return replace(read_table(section, PROFILES[profile].get(key, {})), hidden=HIDDEN, channels=CHANNELS)


def longer_section(profile: str) -> CoarseConfig:
    """Return the coarse networks' section with the steps of both levels."""
    coarse_levels, finer = (
        read_table(section, PROFILES[profile].get(key, {}))
        for section, key in ((CoarseConfig(), "coarse"), (RefinementConfig(), "refinement"))
    )
    both = coarse_levels.training.steps + finer.training.steps
    return replace(coarse_levels, training=replace(coarse_levels.training, steps=both))


def coarse_stage(plan: Plan) -> Stage:
    """Return the stage that trains the coarse networks."""
    return _stage(plan, COARSE, coarse.train, inputs_of_networks(plan))


def refined_stage(plan: Plan) -> Stage:
    """Return the stage that trains the refinement networks; the section `refinement` still chooses the squares."""
    return _stage(plan, REFINED, refined.train, refined.inputs_of_refinement(plan, coarse_stage(plan)))


def longer_stage(plan: Plan) -> Stage:
    """Return the stage that trains the coarse networks for longer."""
    return _stage(plan, LONGER, coarse.train, inputs_of_networks(plan))


def _stage(plan: Plan, name: str, function: Callable, inputs: tuple[Stage, ...]) -> Stage:
    method = next(method for method in METHODS if method.name == name)
    return plan.stage(name, function, plan.training(method.section(plan.config)), *inputs)


METHODS = (
    variant(
        coarse.METHOD,
        COARSE,
        "Coarse, wide",
        66,
        stages=lambda plan: (coarse_stage(plan),),
        default_section=partial(widened, CoarseConfig(), "coarse"),
        note=NOTE,
        mark="△",
    ),
    variant(
        refined.METHOD,
        REFINED,
        "Refined, wide",
        66.5,
        stages=lambda plan: (coarse_stage(plan), refined_stage(plan)),
        default_section=partial(widened, RefinementConfig(), "refinement"),
        note=NOTE,
        mark="△",
    ),
    variant(
        coarse.METHOD,
        LONGER,
        "Coarse, longer",
        66.7,
        stages=lambda plan: (longer_stage(plan),),
        default_section=longer_section,
        note="The coarse networks, trained for the steps of both levels.",
    ),
)
