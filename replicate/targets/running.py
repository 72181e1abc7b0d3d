"""How targets make their stages: the graph of every character and seed, in one go."""

import argparse
from collections.abc import Callable, Sequence

from replicate.artefacts.plan import Plan
from replicate.engine.provenance import provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage
from replicate.report.publication import CharacterResult, check_results_folder
from replicate.targets.options import configurations, workers


def make(options: argparse.Namespace, stages: Callable[[Plan], Sequence[Stage]]) -> list[CharacterResult]:
    """Make the stages of every character and seed that the command line names.

    stages: a plan → its stages, the more urgent first, the one whose artefact is the result last. Returns the
    result of each configuration.
    """
    configs = configurations(options)
    graphs = [list(stages(Plan(config))) for config in configs]
    side_by_side = workers(options)
    check_results_folder(options.profile)  # an error now is better than one after hours
    facts = provenance(options.command_line, options.profile, sorted({config.seed for config in configs}), side_by_side)
    run([stage for graph in graphs for stage in graph], side_by_side, facts, options.cluster)
    return [CharacterResult(config, graph[-1]) for config, graph in zip(configs, graphs, strict=True)]
