"""Execute the notebook that takes a rig apart on characters of your choice."""

import argparse

from data_recipes import recipe_paths
from replicate.base import paths
from replicate.cli.options import characters
from replicate.methods import artefacts
from replicate.report import notebooks
from replicate.report.publication import results_folder


def run(options: argparse.Namespace) -> None:
    """Execute the notebook on every character."""
    folder = results_folder("tour")
    for character in characters(options):
        artefacts.rig_of(character)  # here its progress is seen, and a bad recipe gets one sentence
        file = folder / f"rig_tour_{recipe_paths.character_label(character)}.ipynb"
        name = recipe_paths.absolute(character)  # the notebook runs in another folder
        notebooks.execute(notebooks.NOTEBOOKS / "rig_tour.ipynb", file, {"CHARACTER": name})
        print(f"written to {paths.display_path(file)}")
