"""Sheets of the characters: what each is, what it can express, and all of them side by side."""

from collections.abc import Sequence
from pathlib import Path

from data_recipes.catalogue import expression_poses
from data_recipes.rig import Rig, has_function
from replicate.drawing.characters import expression_sheet
from replicate.drawing.panels import save_figure
from replicate.targets.rigs.rig_sheet import line_up, rig_sheet

# Twelve that a stranger should recognise without the label.
EXPRESSIONS = (
    "neutral", "joy", "laugh", "surprise", "anger", "sadness", "fear", "disgust", "kiss", "smirk", "shout", "yawn",
)  # fmt: skip
COLUMNS = 6


def draw_sheets(rig: Rig, folder: Path, renderer: str | None = None) -> list[Path]:
    """Draw a rig's two sheets into a folder and return the files; `rig`: any that keeps the Rig contract."""
    poses = expression_poses(rig)
    own = EXPRESSIONS if has_function(rig) else poses
    selection = {name: poses[name] for name in own if name in poses}
    sheets = {
        "sheet": rig_sheet(rig, renderer=renderer),
        "expressions": expression_sheet(rig, selection, COLUMNS, width=240, height=262, renderer=renderer),
    }
    for kind, (figure, words) in sheets.items():
        save_figure(figure, folder / f"{rig.name}_{kind}.png", words)
    return [folder / f"{rig.name}_{kind}.png" for kind in sheets]


def draw_line_up(rigs: Sequence, folder: Path, renderer: str | None = None) -> Path:
    """Draw the rigs side by side into a folder and return the file."""
    figure, words = line_up(rigs, renderer=renderer)
    save_figure(figure, folder / "characters.png", words)
    return folder / "characters.png"
