"""The paper's claims, judged: *holds*, *fails* or *not tested* for every character, with the numbers that decide."""

import argparse

from replicate.profiles import check_profile

ABOUT = "the paper's claims, judged for each character on the tables that there are: holds, fails or not tested"
WRITES = "results/runs/<profile>/"
OPTIONS = ("profile", "latex")


def run(options: argparse.Namespace) -> None:
    """Judge the claims on a profile's results, and on the committed ones where it has none; write and print them."""
    from replicate.targets.claims.claims_publication import publish

    check_profile(options.profile)
    publish(options.profile, options.latex)
