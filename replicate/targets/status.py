"""Print which targets are up to date, how much is missing of the others, and what the cache holds."""

import argparse
import gc
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress

from data_recipes.recipe_paths import sample_folder
from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.cli.options import configurations, methods
from replicate.cli.running import duration, known_times, times_s, wall_s
from replicate.cli.target_list import targets
from replicate.engine.cache_report import UP_TO_DATE, Entry, inventory, known_titles, states
from replicate.engine.provenance import core_count
from replicate.engine.stage import Stage, in_order
from replicate.methods import artefacts
from replicate.methods.plan import Plan
from replicate.methods.trained import entries

DONE, BEGUN, NEVER = UP_TO_DATE, "artefacts to make", "never made"


def run(options: argparse.Namespace) -> None:
    """Print a line for each target, or with `details` for each artefact, then what the cache holds; hash no file."""
    collects = gc.isenabled()
    gc.disable()  # parsed sources are many nodes without cycles; collecting would take a fifth of the time
    try:
        _print_state(options)
    finally:
        if collects:
            gc.enable()


def _print_state(options: argparse.Namespace) -> None:
    graphs = _graphs(options)
    every = [stage for each in graphs.values() for graph in each.values() for stage in graph]
    found = {stage.identifier: (stage, state) for stage, state in states(every)}
    if options.details:
        for stage, state in found.values():
            print(f"{stage.title:28} {stage.key}  {state}")
    else:
        cores, known, titles = core_count(), known_times(paths.REFERENCE), known_titles()
        there = {name for name, (_, state) in found.items() if state == UP_TO_DATE}
        print(f"profile {options.profile}; times are for {cores} cores like those of the reference results\n")
        for name, each in graphs.items():
            ready = [character for character in each if targets()[name].takes_trained and character in entries()]
            at_once = f"; at once with the repository's models: {', '.join(ready)}" if ready else ""
            print(f"{name:15} {target_line(each, there, titles, known, cores)}{at_once}")
    print(f"\n{cache_line(inventory())} in {paths.cache_folder()}")


def _graphs(options: argparse.Namespace) -> dict[str, dict[str, Sequence[Stage]]]:
    """Return the stages of each target that has any: by target, then by character, with the seed in its name."""
    graphs: dict[str, dict[str, Sequence[Stage]]] = {}
    for config in configurations(options):
        plan, rows = Plan(config), methods(options, config)
        name = f"{plan.character}-seed{config.seed}" if config.seed else plan.character
        artefacts.rig_stage(plan)  # a bad recipe is refused here
        for target in targets().values():
            if not {"profile", "characters"} <= {*target.options}:
                continue  # it has no graph, and its module need not be loaded
            if target.stages and not (target.asks_the_rig and sample_folder(config.character)):
                with suppress(InputError):  # a face whose landmarks nobody named, say
                    graphs.setdefault(target.name, {})[name] = target.stages(plan, rows)
    return graphs


def target_line(
    graphs: Mapping[str, Sequence[Stage]], there: set[str], titles: set[str], known: Mapping, cores: int
) -> str:
    """Describe a target's state: "teen: up to date; woman, toon: 34 of 57 artefacts to make, about 12 min".

    graphs: each character's stages, the result last
    there: identifiers of the artefacts that are up to date
    titles: the titles of all artefacts in the cache, stale ones too
    known: times of stages, from `known_times`
    cores: the number of cores that the time is estimated for
    """
    groups: dict[str, list[str]] = {DONE: [], BEGUN: [], NEVER: []}
    for name, graph in graphs.items():
        whole = all(stage.identifier in there for stage in in_order(list(graph)))
        groups[DONE if whole else BEGUN if graph[-1].title in titles else NEVER].append(name)
    parts = []
    for state, names in groups.items():
        every = in_order([stage for name in names for stage in graphs[name]])
        missing = [stage for stage in every if stage.identifier not in there]
        count = f"{len(missing)} of {len(every)} {BEGUN}" if len(missing) < len(every) else f"{len(every)} {BEGUN}"
        words = {DONE: DONE, BEGUN: count, NEVER: f"{NEVER}; {count}"}[state]
        seconds = wall_s(missing, times_s(missing, known), cores)
        if names:
            parts.append(f"{', '.join(names)}: {words}" + (f", about {duration(seconds)}" if seconds else ""))
    return "; ".join(parts)


def cache_line(entries: Iterable[Entry]) -> str:
    """Return the number and the size of the cache's folders in each state, in a line."""
    sizes: dict[str, list[int]] = {}
    for entry in entries:
        sizes.setdefault(entry.state, []).append(entry.size_bytes)
    words = {"current": "current", "stale": "stale", "damaged": "damaged", "unfinished": "unfinished or logs"}
    order = [state for state in words if state in sizes]
    return ", ".join(f"{len(sizes[s])} {words[s]} ({sum(sizes[s]) / 1e6:,.1f} MB)" for s in order) or "nothing"
