"""How targets make their stages: the graph of every character and seed, in one go."""

import argparse
from collections.abc import Callable, Sequence
from functools import partial

from data_recipes.recipe_paths import character_label
from replicate.artefacts.plan import Plan
from replicate.config import Config
from replicate.engine.exceptions import InputError, RunError
from replicate.engine.provenance import provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage, in_order
from replicate.methods.method import Method
from replicate.report.publication import CharacterResult, check_results_folder
from replicate.targets.expected_time import sentence
from replicate.targets.options import configurations, methods, workers


def make(options: argparse.Namespace, stages: Callable[[Plan], Sequence[Stage]]) -> list[CharacterResult]:
    """Make the stages of every character and seed that the command line names.

    stages: a plan → its stages, the more urgent first, the one whose artefact is the result last. Prints about how long
    what is missing takes, before it starts. Returns the result of each configuration.
    """
    configs = configurations(options)
    graphs = [list(stages(Plan(config))) for config in configs]
    _run(options, configs, graphs)
    return _results(configs, graphs)


def make_rows(
    options: argparse.Namespace, stages: Callable[[Plan, Sequence[Method]], Sequence[Stage]]
) -> tuple[list[CharacterResult], list[str]]:
    """Make the stages of a table whose rows are methods: one that fails costs its own row, and of its character alone.

    stages: a plan and its methods → its stages, as for `make`. Returns the result of each configuration, and a sentence
    for each row that is missing. Raises the first error where a character has no row left.
    """
    configs = configurations(options)
    rows = [list(methods(options, config)) for config in configs]
    missing: dict[tuple[str, str], str] = {}
    while True:
        graphs = [list(stages(Plan(config), own)) for config, own in zip(configs, rows, strict=True)]
        failures: dict[str, InputError | RunError] = {}
        _run(options, configs, graphs, failures)
        if not failures:
            return _results(configs, graphs), [
                f"{character} has no row of {name}: {reason}" for (character, name), reason in sorted(missing.items())
            ]
        lost = {
            (character_label(config.character), method.name): str(failures[title])
            for config, own in zip(configs, rows, strict=True)
            for method in own
            for title in sorted(
                failures.keys() & {stage.title for stage in in_order(list(stages(Plan(config), [method])))}
            )
        }
        rows = [
            [method for method in own if (character_label(config.character), method.name) not in lost]
            for config, own in zip(configs, rows, strict=True)
        ]
        if not lost or not all(rows):
            raise next(iter(failures.values()))
        missing |= lost


def _run(
    options: argparse.Namespace,
    configs: Sequence[Config],
    graphs: Sequence[Sequence[Stage]],
    failures: dict[str, InputError | RunError] | None = None,
) -> None:
    side_by_side = workers(options)
    check_results_folder(options.profile)  # an error now is better than one after hours
    facts = provenance(options.command_line, options.profile, sorted({config.seed for config in configs}), side_by_side)
    foresee = None if options.cluster else partial(sentence, workers=side_by_side)  # how many work there, nobody knows
    run([stage for graph in graphs for stage in graph], side_by_side, facts, options.cluster, foresee, failures)


def _results(configs: Sequence[Config], graphs: Sequence[Sequence[Stage]]) -> list[CharacterResult]:
    return [CharacterResult(config, graph[-1]) for config, graph in zip(configs, graphs, strict=True)]
