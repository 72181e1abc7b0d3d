"""Sheets of the characters: what each is, what it can express, and all of them side by side."""

import argparse

from replicate.engine import paths
from replicate.report.cast import cast
from replicate.targets.options import characters

ABOUT = "for each character a sheet (three views, wireframe, charts) and its expressions, and one picture of all"
WRITES = "results/runs/rigs/"
OPTIONS = ("characters",)
CHARACTERS = cast


def run(options: argparse.Namespace) -> None:
    """Draw the sheets of every character, and one picture of all."""
    from replicate.artefacts.built_rig import rig_of
    from replicate.report.publication import results_folder
    from replicate.targets.rigs.character_sheets import draw_line_up, draw_sheets

    folder = results_folder("rigs")
    rigs = [rig_of(character) for character in characters(options)]
    for rig in rigs:
        for file in draw_sheets(rig, folder):
            print(f"written to {paths.display_path(file)}")
    print(f"written to {paths.display_path(draw_line_up(rigs, folder))}")
