"""The notebook that takes a rig apart, executed on a character of one's choice."""

import argparse

from data_recipes import recipe_paths
from replicate.base import paths
from replicate.cli.options import characters


def run(options: argparse.Namespace) -> None:
    """Execute the notebook on every character."""
    from replicate.methods.artefacts import rig_of
    from replicate.report.notebooks import NOTEBOOKS, execute
    from replicate.report.publication import results_folder

    folder = results_folder("tour")
    for character in characters(options):
        rig_of(character)  # here its progress is seen, and a bad recipe gets one sentence
        file = folder / f"rig_tour_{recipe_paths.character_label(character)}.ipynb"
        name = recipe_paths.absolute(character)  # the notebook runs in another folder
        execute(NOTEBOOKS / "rig_tour.ipynb", file, {"CHARACTER": name})
        print(f"written to {paths.display_path(file)}")
