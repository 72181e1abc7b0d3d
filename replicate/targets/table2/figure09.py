"""Figure 9: forehead wrinkles, close up: what each method keeps of them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import Words, panel_grid
from replicate.drawing.render import render
from replicate.drawing.scene import camera_for
from replicate.report.pose_record import TRUTH, PoseRecord
from replicate.targets.table2.clay_surfaces import clay_surfaces
from replicate.targets.table2.panel_titles import panel_title, plain_name

if TYPE_CHECKING:
    import matplotlib.figure

COLUMNS = (TRUTH, "floor_refined", "refined", "coarse", "lbs32")


def figure09(
    record: PoseRecord,
    methods: Sequence[str] = COLUMNS,
    width: int = 400,
    height: int = 340,
    renderer: str | None = None,
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the record's pose from the forehead camera, one panel for each of `methods`."""
    view = camera_for("forehead", record.neutral)
    columns = [method for method in methods if method in record.vertices]
    panels = [render(clay_surfaces(record, method), view, width, height, renderer=renderer) for method in columns]
    titles = [panel_title(method) for method in columns]
    names = ", ".join(plain_name(method) for method in columns)
    return panel_grid([panels], titles), Words(
        f"Clay renders of one forehead, close up, from left to right: {names}.",
        f"Forehead wrinkles of {record.character} in test pose {record.pose} (after Fig. 9 of the paper): {names}. "
        "† An oracle: bones refitted to the true mesh of this pose. "
        "‡ An oracle: the true mesh projected onto the refined maps by least squares.",
    )
