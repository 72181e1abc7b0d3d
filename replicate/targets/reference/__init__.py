"""A run of your own as the committed results: for whoever maintains this repository."""

import argparse

from replicate.engine import paths
from replicate.profiles import check_profile

ABOUT = "put a run's results and the benchmarks' in the place of the committed ones, with all that shows them"
WRITES = "results/reference/, notebooks/, the tables in README, data card and REPRODUCING"
OPTIONS = ("profile", "add-seeds")


def run(options: argparse.Namespace) -> None:
    """Publish a profile's results as the reference."""
    from replicate.targets.reference.reference_results import publish_reference

    check_profile(options.profile)
    for file in publish_reference(options.profile, options.add_seeds):
        print(f"written to {paths.display_path(file)}")
