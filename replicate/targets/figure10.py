"""Figure 10: normal errors on the faces of every method, in the pose with most wrinkles, a median and the worst one."""

import argparse
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from replicate.cli.options import methods
from replicate.cli.running import make
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.heatmap import middle_line, normal_bar, normal_heat, split_face
from replicate.drawing.panels import Words, save_figure
from replicate.drawing.render import render
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.methods.method_registry import in_order, method_named, outside_names
from replicate.methods.plan import Plan
from replicate.report.pose_record import (
    FIGURE10,
    FOLDED,
    LINE,
    PEERS,
    TRUTH,
    WHOLE,
    PoseRecord,
    best_peer,
    clay_surfaces,
    close_up_region,
    line_in_words,
    marks_in_words,
    normal_means_deg,
    panel_title,
    peer_in_words,
    plain_name,
    pose_in_words,
    view_of,
)
from replicate.targets.pose_numbers import publish, save_rows
from replicate.targets.shown_records import load_records, picture_settings, record_stages

if TYPE_CHECKING:
    import matplotlib.figure


def stages(plan: Plan, methods: Sequence[Method]) -> list[Stage]:
    """Return the stages of one character's figure, those of the methods, the slow ones, first."""
    shown = [method for method in methods if method.in_figures]
    return record_stages(plan, shown, "figure10", draw, picture_settings(plan, shown))


def draw(context: StageContext) -> None:
    """Draw the normal errors of every method in each of the poses, and once more close up on the forehead (Fig. 10)."""
    records = load_records(context.config.character, context.inputs)
    save_rows(context, records)
    for record in records.values():
        for camera in ("front", "forehead") if record.choice == FOLDED else ("front",):
            figure, words = figure10(record, context.config.limit_deg, camera)
            save_figure(figure, context.out / f"{picture_name(record, camera)}.png", words)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character, publish it and print its numbers."""
    publish("figure10", make(options, lambda plan: stages(plan, methods(options, plan.config))))


# Figure 10: a test pose as several methods predict it, half of each face its surface, half its normal error.

FACES = 6  # in one row, the truth's among them: more would be too small
TALL = 1.26  # a picture's height over its width
LIMIT_DEG = 30.0


def figure10(
    record: PoseRecord, limit_deg: float = LIMIT_DEG, camera: str = "front", across: int | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Draw several methods' normal errors in one test pose and return (figure, words).

    limit_deg: the upper end of the colours, the same for every face
    camera: the view, "front" or "forehead"
    across: the width of one face's picture, pixels; None for what fills the sheet
    """
    methods, hair = shown_methods(record), camera != "forehead"
    region = WHOLE if hair else close_up_region(record)
    width = across or cell_width(FACES)
    height = round(TALL * width)
    view = view_of(record, camera, width / height)
    draw = partial(render, camera=view, width=width, height=height)
    truth, means = record.vertices[TRUTH], {}
    cells = [Cell(panel_title(TRUTH), (draw(clay_surfaces(record, TRUTH, hair)),))]
    for method in methods:
        vertices = record.vertices[method]
        surface = draw(clay_surfaces(record, method, hair))
        heat = draw([normal_heat(vertices, truth, record.faces, limit_deg)])
        line = middle_line(record.neutral, vertices, record.faces, view, width, height)
        means[method] = normal_means_deg(record, method)
        cells.append(Cell(panel_title(method), (split_face(surface, heat, line),), (f"{means[method][region]:.2f}°",)))
    bar = partial(normal_bar, limit_deg=limit_deg, orientation="horizontal")
    return face_sheet(cells, len(cells), bar=bar, first_bold=True), _words(record, camera, region, means, limit_deg)


def shown_methods(record: PoseRecord) -> list[str]:
    """Return the methods of a record whose faces fit into the row: from outside, the best peer, those of `FIGURE10`.

    The best peer takes the straight line's place, whose error the caption then has.
    """
    there = [name for name in in_order(set(record.vertices) - {TRUTH}) if method_named(name).in_figures]
    peer = best_peer(record)
    first = [*(name for name in there if name in outside_names()), *([peer] if peer else [])]
    first += [name for name in FIGURE10 if name in there and not (peer and name == LINE)]
    others = [name for name in there if name not in PEERS]
    return in_order([*dict.fromkeys([*first, *others])][: FACES - 1])


def picture_name(record: PoseRecord, camera: str = "front") -> str:
    """Return the file name of a record's Figure 10, without its ending."""
    views = [camera] if camera != "front" else []
    rules = [record.choice] if record.choice != FOLDED else []
    return "_".join(["figure10", record.character, *rules, *views])


def _words(record: PoseRecord, camera: str, region: str, means: dict[str, dict[str, float]], limit_deg: float) -> Words:
    numbers = ", ".join(f"{plain_name(method)} {by_region[region]:.2f}°" for method, by_region in means.items())
    views = "foreheads, close up" if camera == "forehead" else "heads from the front"
    pose = pose_in_words(record)
    alt = (
        f"{len(means) + 1} {views}, the ground truth first, then one for each method; the left half of each method's "
        f"face is its surface in clay, the right half is coloured by normal error from 0 to {limit_deg:g} degrees. "
        f"Mean errors of the {region}: {numbers}."
    )
    best = min(means, key=lambda method: means[method][region]) if means else None
    hardest = _hardest_region(means)
    in_view = camera == "front" or hardest == camera  # a close-up's caption names only what it shows
    seen = f" “{plain_name(best)}” has the smallest mean." if best else ""
    seen += line_in_words(record, [*means], region)
    seen += f" Most are farthest off at the {hardest}." if hardest and in_view else ""
    shown = ("close up on the forehead, " if camera == "forehead" else "") + pose
    shown = shown[0].upper() + shown[1:]
    caption = (
        f"{shown} (after Fig. 10). Left half of each face: the predicted surface. Right half: the "
        f"angle between each mesh face's predicted and true normal (Eq. 11), 0° to {limit_deg:g}°, the same colours in "
        f"all panels, which go with the angle's root. Below: its mean over the {region}; "
        f"figure10.csv has those of all regions, and of the methods that aren't shown.{seen}{peer_in_words(record)} "
        f"{marks_in_words(means)}"
    )
    return Words(alt, caption.strip())


def _hardest_region(means: dict[str, dict[str, float]]) -> str:
    """Return the region where more than half of the methods have their largest mean error, or ""."""
    regions = [{name: mean for name, mean in by_region.items() if name != WHOLE} for by_region in means.values()]
    worst = [max(by_region, key=by_region.__getitem__) for by_region in regions if by_region]
    region = max(sorted(set(worst)), key=worst.count, default="")
    return region if 2 * worst.count(region) > len(worst) else ""
