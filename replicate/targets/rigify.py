"""Sample a rig that we did not write, Blender's Rigify face rig on a head of ours, and make Table 2 of it."""

import argparse

from data_recipes.catalogue import write_rigify_samples
from replicate.base import paths
from replicate.cli.options import workers
from replicate.config import PROFILES, SamplesConfig, check_profile
from replicate.targets import table2

HEAD = "woman"
SPARE = 1.25  # poses to write for each training sample: those from held-out frames can't be used for training


def run(options: argparse.Namespace) -> None:
    """Write the samples that are missing, then make Table 2 of them."""
    check_profile(options.profile)
    folder = paths.run_folder("samples") / "rigify"
    count = PROFILES[options.profile].get("samples", {}).get("count", SamplesConfig().count)
    write_rigify_samples(folder, HEAD, round(SPARE * count), workers(options), folder.name)
    options.characters = [str(folder)]
    table2.run(options)
