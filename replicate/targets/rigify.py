"""A rig that nobody here made: samples of Blender's Rigify face rig on a head of ours, and its Table 2."""

import argparse

from data_recipes.catalogue import write_rigify_samples
from replicate.base import paths
from replicate.cli.options import workers
from replicate.config import PROFILES, SamplesConfig, check_profile
from replicate.targets import table2

HEAD = "woman"
SPARE = 1.25  # poses for each that trains: those drawn from frames that are held out can't


def run(options: argparse.Namespace) -> None:
    """Write the samples that are missing, then make Table 2 of them."""
    check_profile(options.profile)
    folder = paths.run_folder("samples") / "rigify"
    count = PROFILES[options.profile].get("samples", {}).get("count", SamplesConfig().count)
    write_rigify_samples(folder, HEAD, round(SPARE * count), workers(options), folder.name)
    options.characters = [str(folder)]
    table2.run(options)
