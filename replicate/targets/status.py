"""Which artefacts are up to date, and what the cache holds."""

import argparse

from data_recipes.recipe_paths import sample_folder
from replicate.base import paths
from replicate.cli.options import configurations, methods


def run(options: argparse.Namespace) -> None:
    """Print the state of every stage of every target, then what the cache holds."""
    from replicate.cli.target_list import targets
    from replicate.engine.cache_report import inventory, states
    from replicate.methods.plan import Plan

    for config in configurations(options):
        plan, rows = Plan(config), methods(options, config)
        known_by_samples = sample_folder(config.character) is not None
        fitting = [one for one in targets().values() if one.stages and not (known_by_samples and one.asks_the_rig)]
        graphs = [target.stages(plan, rows) for target in fitting]
        for stage, state in states([stage for graph in graphs for stage in graph]):
            print(f"{stage.title:28} {stage.key}  {state}")
    entries = inventory()
    print(f"\n{paths.cache_folder()}")
    for state in ("current", "stale", "damaged", "unfinished"):
        sizes = [entry.size_bytes for entry in entries if entry.state == state]
        print(f"{state:28} {len(sizes):4} folders {sum(sizes) / 1e6:10,.1f} MB")
