"""Figure 7: the mesh segments in colours: each that deforms has one of its own, rigid ones alternate."""

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import cKDTree

from data_recipes.rig import Rig
from replicate.drawing.colours import perceived
from replicate.drawing.panels import Words, save_figure
from replicate.drawing.rig_views import DISTINCT, coloured_views, hexadecimal, read_lines, write_lines
from replicate.geometry.mesh import Mesh
from replicate.report.tables import Table

if TYPE_CHECKING:
    import matplotlib.figure

# Light ones for teeth and other rigid parts, in turn, so that neighbours differ.
RIGID = ((255, 255, 255), (140, 195, 255), (255, 200, 130), (165, 225, 150))
NEAR = 0.05
NOT_NEAR = 1.7  # by how much less alike the colours count of two segments that are not neighbours
HEADER = ("segment", "kind", "vertices", "faces", "colour")


def segment_palette(mesh: Mesh, rigid: Collection[int]) -> list[tuple[int, int, int]]:
    """Return each segment's colour, in the order of `mesh.segment_names`.

    One that deforms gets, of the colours left, that which looks least like any given so far; to those of its neighbours
    it must be farther still.
    """
    colours: list[tuple[int, int, int]] = []
    left: list[tuple[int, int, int]] = []
    turns = 0
    near = neighbours(mesh)
    for k in range(len(mesh.segment_names)):
        if k in rigid:
            colours.append(RIGID[turns % len(RIGID)])
            turns += 1
            continue
        left = left or list(DISTINCT)
        others = [j for j in range(k) if j not in rigid]
        if others:
            apart = perceived(left)[:, None] - perceived([colours[j] for j in others])
            strange = np.where(near[k, others], 1.0, NOT_NEAR)
            best = (np.linalg.norm(apart, axis=-1) * strange).min(1).argmax()
        else:
            best = 0
        colours.append(left.pop(int(best)))
    return colours


def neighbours(mesh: Mesh) -> Bool[np.ndarray, "s s"]:
    """Return which segments touch each other or nearly do, by the share `NEAR` of the head's size."""
    reach = NEAR * float(np.ptp(mesh.neutral, axis=0).max())
    parts = [mesh.neutral[mesh.segment == k] for k in range(len(mesh.segment_names))]
    trees = [cKDTree(part) for part in parts]
    near = np.eye(len(parts), dtype=bool)
    corner = mesh.segment[mesh.faces]
    for one, other in ((0, 1), (1, 2), (2, 0)):
        near[corner[:, one], corner[:, other]] = near[corner[:, other], corner[:, one]] = True
    for k, part in enumerate(parts):
        for j in range(k):
            close = (trees[j].query(part, distance_upper_bound=reach)[0] < reach).any()
            near[k, j] = near[j, k] = near[k, j] or close
    return near


def shown_segment(mesh: Mesh) -> Int[np.ndarray, " f"]:
    """Return the segment whose colour each face has: the first that it touches, so that borders follow edge loops."""
    return mesh.segment[mesh.faces].min(1)


def figure07(
    rig: Rig, rigid: Collection[int], width: int = 256, height: int = 330, renderer: str | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words). rigid: indices of the segments that move rigidly by §3.4."""
    mesh, colours = rig.mesh, segment_palette(rig.mesh, rigid)
    vertices = np.bincount(mesh.segment, minlength=len(colours))
    deforming = [k for k in range(len(colours)) if k not in rigid]
    legend = [(f"{mesh.segment_names[k].replace('_', ' ')}: {vertices[k]:,} vertices", [colours[k]]) for k in deforming]
    if rigid:
        legend.append((f"{len(rigid)} rigid: {vertices[list(rigid)].sum():,} vertices", RIGID))
    paint = np.array(colours, np.uint8)[shown_segment(mesh)]
    figure = coloured_views(rig, paint, legend, width, height, renderer)
    names = ", ".join(mesh.segment_names[k].replace("_", " ") for k in deforming)
    return figure, Words(
        f"The character {rig.name}, mouth open, from the front, from three-quarters and close up into the mouth. Each "
        f"deforming segment has a colour: {names}; {len(rigid)} rigid ones are in light colours.",
        f"Mesh segments of {rig.name} (after Fig. 7): {len(deforming)} that deform, each with a network of its own, "
        f"and {len(rigid)} that move rigidly (§3.4), in light colours that alternate. Eyeballs are for display only.",
    )


def save_segments_figure(rig: Rig, rigid: Collection[int], stem: Path) -> None:
    """Write Figure 7 of a rig as PNG, its words as JSON, and each segment's numbers as CSV."""
    figure, words = figure07(rig, rigid)
    save_figure(figure, stem.with_suffix(".png"), words)
    mesh, colours = rig.mesh, segment_palette(rig.mesh, rigid)
    vertices, faces = (np.bincount(which, minlength=len(colours)) for which in (mesh.segment, shown_segment(mesh)))
    lines = (
        (name, "rigid" if k in rigid else "deforms", vertices[k], faces[k], hexadecimal(colours[k]))
        for k, name in enumerate(mesh.segment_names)
    )
    write_lines(stem.with_suffix(".csv"), HEADER, lines)


def segments_table(file: Path, character: str) -> Table:
    """Return the numbers behind a character's Figure 7: a line for each deforming segment, one for all rigid ones."""
    lines = read_lines(file, HEADER)
    body = [
        (line["segment"], f"{int(line['vertices']):,}", f"{int(line['faces']):,}")
        for line in lines
        if line["kind"] != "rigid"
    ]
    rigid = [line for line in lines if line["kind"] == "rigid"]
    if rigid:
        vertices, faces = (sum(int(line[column]) for line in rigid) for column in ("vertices", "faces"))
        body += [None, (f"{len(rigid)} rigid segments together", f"{vertices:,}", f"{faces:,}")]
    return Table(f"Segments of {character}", (("", "vertices", "faces"),), tuple(body))
