"""Sheets of a character: what it can express."""

from pathlib import Path

from data_recipes.rig import expression_poses
from replicate.figures.expressions import expression_sheet
from replicate.figures.panels import save_figure

# Twelve that a stranger should recognise without the label.
SHOWN = (
    "neutral", "joy", "laugh", "surprise", "anger", "sadness", "fear", "disgust", "kiss", "smirk", "shout", "yawn",
)  # fmt: skip
COLUMNS = 6


def draw_sheets(rig, folder: Path) -> list[Path]:
    """Draw a rig's sheets into a folder and return the files; `rig`: any that keeps the Rig contract."""
    poses = expression_poses(rig)
    chosen = {name: poses[name] for name in SHOWN if name in poses}
    file = folder / f"{rig.name}_expressions.png"
    figure, words = expression_sheet(rig, chosen, COLUMNS, width=240, height=262)
    save_figure(figure, file, words)
    return [file]
