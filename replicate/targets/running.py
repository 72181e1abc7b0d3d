"""How targets make their stages: the graph of every character and seed, in one go."""

import argparse
from collections.abc import Callable, Sequence
from functools import partial

from replicate.artefacts.plan import Plan
from replicate.engine.provenance import provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage
from replicate.report.publication import CharacterResult, check_results_folder
from replicate.targets.expected_time import sentence
from replicate.targets.options import configurations, workers


def make(options: argparse.Namespace, stages: Callable[[Plan], Sequence[Stage]]) -> list[CharacterResult]:
    """Make the stages of every character and seed that the command line names.

    stages: a plan → its stages, the more urgent first, the one whose artefact is the result last. Prints about how long
    what is missing takes, before it starts. Returns the result of each configuration.
    """
    configs = configurations(options)
    graphs = [list(stages(Plan(config))) for config in configs]
    side_by_side = workers(options)
    check_results_folder(options.profile)  # an error now is better than one after hours
    facts = provenance(options.command_line, options.profile, sorted({config.seed for config in configs}), side_by_side)
    foresee = None if options.cluster else partial(sentence, workers=side_by_side)  # how many work there, nobody knows
    run([stage for graph in graphs for stage in graph], side_by_side, facts, options.cluster, foresee)
    return [CharacterResult(config, graph[-1]) for config, graph in zip(configs, graphs, strict=True)]
