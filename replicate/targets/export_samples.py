"""Write a rig as a folder of samples, which this program and others can read, as for rigs without a function."""

import argparse

from data_recipes.catalogue import check_empty, write_folder
from data_recipes.recipe_paths import character_label, in_command
from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.cli.options import characters, seeds
from replicate.config import resolve
from replicate.export.drawn_shards import drawn_shards, tried_influence
from replicate.methods import artefacts


def run(options: argparse.Namespace) -> None:
    """Write a folder of samples of every character."""
    names = characters(options)
    if options.to is not None and len(names) > 1:
        raise InputError(f"{len(names)} characters can't all be written to {options.to}: name one, or leave out to")
    if len(seeds(options)) > 1:
        raise InputError("several seeds are named; name one, whose poses are written")
    file = paths.with_home(options.config, "CONFIG") if options.config else None
    overrides = {"samples": {"split": options.split}}
    for character in names:
        config = resolve(character, options.profile, overrides if options.split else None, file, seed=seeds(options)[0])
        usual = paths.run_folder("export") / f"{character_label(character)}_samples"
        folder = paths.with_home(options.to, "to").absolute() if options.to is not None else usual
        check_empty(folder)
        rig = artefacts.rig_of(character)
        count, shards = drawn_shards(rig, config.samples, config.seed)
        moves = tried_influence(rig, config.samples, config.seed, progress)
        write_folder(rig, folder, count, shards, progress, moves)
        command = f"make table2 CHARACTERS={in_command(str(folder))}"
        print(f"written to {paths.display_path(folder)}: {count:,} poses; `{command}` reads them")
