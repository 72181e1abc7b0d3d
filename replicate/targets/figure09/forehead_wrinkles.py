"""Figure 9: forehead wrinkles, close up: what each method keeps of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from replicate.approximation.metrics import normal_error
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.panels import Words
from replicate.drawing.render import render
from replicate.drawing.scene import CAMERAS, Camera, camera_for, faces_in_view
from replicate.geometry.mesh import fold_angles, inner_edges
from replicate.report.pose_record import (
    FIGURE09,
    FOREHEAD,
    TRUTH,
    WHOLE,
    PoseRecord,
    clay_surfaces,
    close_up_region,
    line_in_words,
    marks_in_words,
    normal_means_deg,
    panel_title,
    peer_in_words,
    plain_name,
    pose_in_words,
    shown_in,
    view_of,
)

if TYPE_CHECKING:
    import matplotlib.figure

COLUMNS = (TRUTH, *FIGURE09)
ROWS, MOST_ACROSS = 2, 4  # rows of pictures, and how many stand in one
TALL = 0.8  # a picture's height over its width
SPOT_TALL = 0.42  # of the second picture
SPOT_MM = 20.0  # its height on the skin, and the diameter around its middle in which errors count
STRIP = "strip"  # what it is called
COMPARED = ("coarse", "refined")  # the second picture is where these differ most
FACING = 0.8  # the cosine of the angle to the view within which a spot has to lie
CREASED_DEG = 1.0  # the mean change of a fold from which one sees creases; ICT's face has 1.9, Rigify's smooth one 0.7


def figure09(
    record: PoseRecord, methods: Sequence[str] = COLUMNS, across: int | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the record's pose from the forehead camera, by each of `methods` and by the best peer.

    across: the width of one picture, pixels; None for what fills the sheet.
    """
    views = [(view_of(record, "forehead", 1 / TALL), TALL)]
    spot = refined_spot(record)
    if spot:
        views.append((spot.camera, SPOT_TALL))
    shown = shown_in(record, methods)
    columns = min(MOST_ACROSS, math.ceil(len(shown) / ROWS))
    width = across or cell_width(columns)
    region = close_up_region(record)
    cells, phrases = [], []
    for method in shown:
        surfaces = clay_surfaces(record, method, hair=False)
        pictures = tuple(render(surfaces, view, width, round(tall * width)) for view, tall in views)
        errors = {} if method == TRUTH else {region: normal_means_deg(record, method)[region]}
        if spot and errors:
            errors[STRIP] = spot.mean_deg(record, method)
        lines = [f"{place}: {error:.2f}°" for place, error in errors.items()]
        cells.append(Cell(panel_title(method), pictures, tuple(lines)))
        numbers = " and ".join(line.partition(": ")[2] for line in lines)
        phrases.append(f"{plain_name(method)} {numbers}".strip())
    names = ", ".join(phrases)
    pose = f"{pose_in_words(record)} (after Fig. 9)"
    if region == WHOLE:
        lead = f"The forehead in {pose}. This rig names no control of the brows, so errors are those of the whole mesh."
    elif fold_change_deg(record) > CREASED_DEG:
        lead = (
            f"Forehead wrinkles in {pose}. Look at the creases above the brows and between them: how deep they are, "
            "and how far they reach."
        )
    else:
        lead = f"The forehead in {pose}. This rig has no wrinkles; only the smooth shape of the brows differs."
    figure = face_sheet(cells, columns)
    closer = f" Under it a strip of {spot.size_mm:.0f} mm {spot.place}, where refinement changes most." if spot else ""
    strip = f" and of the skin within {spot.radius_mm:.0f} mm of the strip's middle" if spot else ""
    return figure, Words(
        f"Clay renders of one forehead, close up, row by row: {names}.",
        f"{lead}{closer} Below each: the mean normal error (Eq. 11) of the {region}{strip}."
        f"{line_in_words(record, shown, region)}{peer_in_words(record)} "
        "Light from the side and darkened hollows make relief look deeper than it is, for all alike. "
        f"{marks_in_words(shown)}".strip(),
    )


@dataclass(frozen=True)
class Spot:
    """A place on the skin of a record.

    camera: a view of it
    place: in words, "at the mouth"
    size_mm: the width of its picture
    radius_mm: how far around its middle errors count
    near: (k,) the mesh faces within this
    """

    camera: Camera
    place: str
    size_mm: float
    radius_mm: float
    near: np.ndarray

    def mean_deg(self, record: PoseRecord, method: str) -> float:
        """Return a method's mean normal error (Eq. 11) of the mesh faces that count, in degrees."""
        errors = normal_error(record.vertices[method], record.vertices[TRUTH], record.faces)
        return float(np.nanmean(errors[self.near]))


def refined_spot(record: PoseRecord) -> Spot | None:
    """Return where the mean normal errors of `COMPARED` differ most, of skin that the front camera sees.

    Means are over the mesh faces around a place. None for a record that lacks one of the two.
    """
    if not all(method in record.vertices for method in COMPARED):
        return None
    truth, faces = record.vertices[TRUTH].astype(float), record.faces
    errors = [normal_error(record.vertices[method], record.vertices[TRUTH], faces) for method in COMPARED]
    change, centres = np.nan_to_num(errors[0] - errors[1]), truth[faces].mean(1)
    front = camera_for("front", record.neutral)
    scale = front.height_mm / CAMERAS["front"].height_mm
    there = np.flatnonzero(faces_in_view(truth, faces, front, FACING))
    if not len(there):
        return None
    radius = scale * SPOT_MM / 2
    near = cKDTree(centres).query_ball_point(centres[there], radius)
    best = int(np.argmax([abs(change[one].mean()) for one in near]))
    found = there[best]
    region = record.region[found]
    where = f"at the {record.region_names[region]}" if region >= 0 else "on the face"
    focus = tuple(float(x) for x in centres[found])
    close = replace(CAMERAS["forehead"], focus=focus, height_mm=scale * SPOT_MM, distance_mm=front.distance_mm)
    return Spot(close, where, scale * SPOT_MM / SPOT_TALL, radius, np.sort(near[best]))


def fold_change_deg(record: PoseRecord) -> float:
    """Return the mean change of the true forehead's fold angles from the neutral pose, in degrees.

    Edges are weighted by their length. For a record without a forehead it is the mean over the whole mesh.
    """
    edges, sides = inner_edges(record.faces)
    if FOREHEAD in record.region_names:
        inner = (record.region == record.region_names.index(FOREHEAD))[sides].all(-1)
        edges, sides = edges[inner], sides[inner]
    posed, rest = (fold_angles(each, record.faces, edges, sides) for each in (record.vertices[TRUTH], record.neutral))
    change = np.abs(posed - rest)
    length = np.linalg.norm(record.neutral[edges[:, 1]] - record.neutral[edges[:, 0]], axis=-1)
    return float(np.average(np.minimum(change, 360 - change), weights=length))
