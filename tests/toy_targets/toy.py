"""A target of two toy stages, for tests of the command line: all that a module of `replicate/targets` has to have."""

import argparse
from collections.abc import Sequence

from toy_stages import ToyConfig

from replicate.cli.running import make
from replicate.engine.stage import Stage
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.publication import CharacterResult

PUBLICATIONS: list[list[CharacterResult]] = []


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character: random numbers, and their sum."""
    config = ToyConfig(seed=plan.config.seed)
    first = Stage("counted", "toy_stages:numbers", config, label=plan.character)
    return [Stage("summed", "toy_stages:total", config, (first,), label=plan.character)]


def run(options: argparse.Namespace) -> None:
    """Make the stages, and note what another target would publish."""
    PUBLICATIONS.append(make(options, stages))
