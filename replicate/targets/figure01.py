"""Figure 1: the rig and its approximations side by side in one wrinkled pose."""

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from replicate.cli.running import make
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.panels import Words
from replicate.drawing.render import render
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.pose_record import (
    FIGURE01,
    TRUTH,
    WHOLE,
    PoseRecord,
    clay_surfaces,
    close_up_region,
    is_before_forehead,
    marks_in_words,
    normal_means_deg,
    panel_title,
    peer_in_words,
    plain_name,
    pose_in_words,
    shown_in,
    vertex_mean_mm,
    view_of,
)
from replicate.targets.figure09.forehead_wrinkles import CREASED_DEG, fold_change_deg
from replicate.targets.pose_numbers import folded_pose_stages, publish, save_folded_pose

if TYPE_CHECKING:
    import matplotlib.figure


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's figure, those of the methods, the slow ones, first."""
    return folded_pose_stages(plan, "figure01", FIGURE01, draw)


def draw(context: StageContext) -> None:
    """Draw the rig beside its approximations (Fig. 1)."""
    save_folded_pose(context, figure01)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character, publish it and print its numbers."""
    publish("figure01", make(options, stages))


# Figure 1: one wrinkled pose of the rig beside its approximations, the head and a close look at its wrinkles.

COLUMNS = (TRUTH, *FIGURE01)
VIEWS = (("front", 1.2), ("forehead", 0.8))  # a camera, and its picture's height over its width


def figure01(record: PoseRecord, across: int | None = None) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the record's pose, true and as predicted by the methods of `COLUMNS` and the best peer.

    across: the width of one picture, pixels; None for what fills the sheet.
    """
    shown = shown_in(record, COLUMNS)
    width = across or cell_width(max(len(shown), len(COLUMNS)))
    cells, phrases, region = [], [], close_up_region(record)
    for method in shown:
        pictures = tuple(
            render(
                clay_surfaces(record, method, hair=name != "forehead"),
                view_of(record, name, 1 / tall),
                width,
                round(tall * width),
            )
            for name, tall in VIEWS
        )
        lines = ()
        if method != TRUTH:
            means = normal_means_deg(record, method)
            lines = (f"{vertex_mean_mm(record, method):.2f} mm, {means[WHOLE]:.2f}°",)
            lines += (f"{region}: {means[region]:.2f}°",) if region != WHOLE else ()
            phrases.append(f"{plain_name(method)} {', '.join(lines)}")
        cells.append(Cell(panel_title(method), pictures, lines))
    errors = "; ".join(phrases)
    names = ", ".join(plain_name(method) for method in shown)
    close = f"; then the latter over the {region}" if region != WHOLE else ""
    bare = ", without what hides it," if any(is_before_forehead(prop[0]) for prop in record.props) else ""
    shows = (
        "shows which creases of the forehead a method keeps"
        if fold_change_deg(record) > CREASED_DEG
        else "is of the forehead, which has no creases here"
    )
    return face_sheet(cells, len(shown)), Words(
        f"Clay renders of a head from the front and, below, of its forehead, close up, from left to right: {names}. "
        f"Mean errors: {errors}.",
        f"The rig and its approximations side by side (after Fig. 1), in {pose_in_words(record)}. The heads look much "
        f"alike; the close-up below{bare} {shows}. Below: mean "
        f"distance of all vertices, and mean angle between normals (Eq. 11){close}.{peer_in_words(record)} "
        f"{marks_in_words(shown)}".strip(),
    )
