"""Figure 7: the mesh segments in colours."""

import argparse
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from data_recipes.rig import Rig
from replicate.cli.running import make
from replicate.config import RigidConfig
from replicate.drawing.panels import DPI, WIDTH, Words, enlarge, error_scale, save_figure, tidy
from replicate.drawing.prop_surfaces import perceived
from replicate.drawing.rig_views import DISTINCT, coloured_views, hexadecimal, legend_panel, read_lines, write_lines
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.pose_record import with_layout
from replicate.report.publication import publish_pictures
from replicate.report.tables import Table, round_off
from replicate.targets.shown_records import Picture

if TYPE_CHECKING:
    import matplotlib.figure


@dataclass(frozen=True)
class RigidPicture(Picture):
    """The settings of Figure 7, with those that decide which segments are rigid."""

    rigid: RigidConfig


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that draws one character's figure."""
    inputs = (artefacts.rig_stage(plan), artefacts.samples_stage(plan), artefacts.rigid_stage(plan))
    settings = RigidPicture(plan.character, plan.config.seed, plan.config.rigid)
    return [plan.stage("figure07", draw, settings, *inputs)]


def draw(context: StageContext) -> None:
    """Draw the mesh segments in colours (Fig. 7), and how far each is from moving rigidly."""
    settings, rig = context.config, artefacts.load_rig(context.inputs)
    rigid = artefacts.load_attachments(context.inputs).segment.tolist()
    errors = artefacts.mean_rigid_errors(context.inputs)
    stem = context.out / f"figure07_{settings.character}"
    save_segments_figure(rig, rigid, errors, stem)
    save_rigid_errors(rig.mesh, errors, rigid, settings.rigid.tau_mm, stem)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character and publish it."""
    publish_pictures("figure07", make(options, stages))


# Figure 7: the mesh segments in colours. No two deforming segments share one; the rigid ones take turns.

# Light colours for teeth and other rigid parts, in turn, so that neighbours differ.
RIGID = ((255, 255, 255), (140, 195, 255), (255, 200, 130), (165, 225, 150))
# Colours by the beginning of a segment's name; the first segment that matches gets it. All of them are in DISTINCT.
PARTS = (
    ("face_2", (240, 60, 190)), ("face_3", (0, 136, 86)), ("face_4", (190, 0, 50)), ("face", (243, 195, 0)),
    ("cranium", (0, 103, 165)), ("neck", (101, 69, 34)), ("ear_right", (141, 182, 0)), ("ear", (249, 147, 121)),
    ("lid", (161, 202, 241)), ("mouth", (226, 88, 34)), ("gums", (194, 178, 128)), ("tongue", (194, 178, 128)),
)  # fmt: skip
NEAR = 0.05
NOT_NEAR = 1.7  # factor on the colour distance of two segments that are not neighbours
HEADER = ("segment", "kind", "vertices", "faces", "rigid_error_mm", "colour")


def segment_palette(mesh: Mesh, rigid: Collection[int]) -> list[tuple[int, int, int]]:
    """Return each segment's colour, in the order of `mesh.segment_names`.

    Deforming segments that match one of `PARTS` get its colour. Each other one gets the remaining colour that looks
    least like those given so far, where likeness to a neighbour's colour counts more. Rigid ones get `RIGID` in turn.
    """
    near, rigid = neighbours(mesh), sorted(rigid)
    given = _colours_of_parts({k: name for k, name in enumerate(mesh.segment_names) if k not in rigid})
    left = [colour for colour in DISTINCT if colour not in given.values()]
    for k in range(len(mesh.segment_names)):
        if k in rigid or k in given:
            continue
        left = left or list(DISTINCT)
        best, others = 0, list(given)
        if others:
            apart = perceived(left)[:, None] - perceived([given[j] for j in others])
            strange = np.where(near[k, others], 1.0, NOT_NEAR)
            best = int((np.linalg.norm(apart, axis=-1) * strange).min(1).argmax())
        given[k] = left.pop(best)
    given |= {k: RIGID[turn % len(RIGID)] for turn, k in enumerate(rigid)}
    return [given[k] for k in range(len(mesh.segment_names))]


def _colours_of_parts(names: Mapping[int, str]) -> dict[int, tuple[int, int, int]]:
    """Return the colours of the segments, by index, whose names begin like one of `PARTS`; no two get the same."""
    given: dict[int, tuple[int, int, int]] = {}
    for k, name in names.items():
        colour = next((colour for start, colour in PARTS if name.startswith(start)), None)
        if colour and colour not in given.values():
            given[k] = colour
    return given


def neighbours(mesh: Mesh) -> Bool[np.ndarray, "s s"]:
    """Return which segments touch or come nearer to each other than the share `NEAR` of the head's size."""
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
    """Return the segment whose colour each face gets: the first that it touches, so that borders follow edge loops."""
    return mesh.segment[mesh.faces].min(1)


def figure07(
    rig: Rig, rigid: Collection[int], name: str, across: int | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Draw the segments in colours and return (figure, words).

    rigid: indices of the segments that move rigidly (§3.4)
    name: the character's name in results
    across: as for `coloured_views`
    """
    mesh, colours = rig.mesh, segment_palette(rig.mesh, rigid)
    vertices = np.bincount(mesh.segment, minlength=len(colours))
    deforming = [k for k in range(len(colours)) if k not in rigid]
    legend: list[tuple[str, Sequence]] = [
        (f"{mesh.segment_names[k].replace('_', ' ')}: {vertices[k]:,}", [colours[k]]) for k in deforming
    ]
    if rigid:
        legend.append((f"{len(rigid)} rigid: {vertices[list(rigid)].sum():,}", RIGID))
    paint = np.array(colours, np.uint8)[shown_segment(mesh)]
    key = legend_panel(legend, "segments, and how many vertices each has")
    labels = {k: mesh.segment_names[k].replace("_", " ") for k in deforming}
    figure = coloured_views(rig, paint, [key], across, labels, shown_segment(mesh))
    names = ", ".join(mesh.segment_names[k].replace("_", " ") for k in deforming)
    whose = with_layout(name, mesh.segment_names)
    return figure, Words(
        f"The character {whose}, mouth open, from the front, from three-quarters and close up into the mouth. Each "
        f"deforming segment has a colour: {names}; {len(rigid)} rigid ones are in light colours.",
        f"Mesh segments of {whose}, after Fig. 7: {len(deforming)} that deform, each with a network of its own, "
        f"and {len(rigid)} that move rigidly (§3.4), in light colours that alternate. Eyeballs are for display only.",
    )


def save_segments_figure(rig: Rig, rigid: Collection[int], errors_mm: Sequence[float] | np.ndarray, stem: Path) -> None:
    """Write Figure 7 of a rig as PNG, its words as JSON, and each segment's numbers as CSV.

    errors_mm: each segment's mean residual of Eq. 3. stem: "…/figure07_teen", which ends with the character's name.
    """
    figure, words = figure07(rig, rigid, stem.name.partition("_")[2])
    save_figure(figure, stem.with_suffix(".png"), words)
    mesh, colours = rig.mesh, segment_palette(rig.mesh, rigid)
    vertices, faces = (np.bincount(which, minlength=len(colours)) for which in (mesh.segment, shown_segment(mesh)))
    lines = (
        (
            name,
            "rigid" if k in rigid else "deforms",
            vertices[k],
            faces[k],
            float(errors_mm[k]),
            hexadecimal(colours[k]),
        )
        for k, name in enumerate(mesh.segment_names)
    )
    write_lines(stem.with_suffix(".csv"), HEADER, lines)


def segments_table(file: Path, character: str) -> Table:
    """Return the numbers behind a character's Figure 7: a line for each deforming segment, one for all rigid ones."""
    lines = read_lines(file, HEADER)
    body = [
        (
            line["segment"],
            f"{int(line['vertices']):,}",
            f"{int(line['faces']):,}",
            _shown_mm(float(line["rigid_error_mm"])),
        )
        for line in lines
        if line["kind"] != "rigid"
    ]
    rigid = [line for line in lines if line["kind"] == "rigid"]
    if rigid:
        vertices, faces = (sum(int(line[column]) for line in rigid) for column in ("vertices", "faces"))
        largest = _shown_mm(max(float(line["rigid_error_mm"]) for line in rigid))
        body += [None, (f"{len(rigid)} rigid segments together", f"{vertices:,}", f"{faces:,}", f"≤ {largest}")]
    return Table(f"Segments of {character}", (("", "vertices", "faces", "mean of e_k, mm"),), tuple(body))


def _shown_mm(length: float) -> str:
    return round_off(length, "mm")


# Eq. 3 of every segment against τ: which segments move rigidly, and how far the others are from it.

LEAST_MM = 1e-4  # the least length on the axis, for segments that are rigid up to rounding
LINE, FRAME = 0.33, 1.3  # inches: a segment's line, and the space above and below all lines


def rigid_errors_chart(
    mesh: Mesh, errors_mm: Float[np.ndarray, " s"], rigid: Collection[int], tau_mm: float, name: str
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Chart each segment's mean residual of Eq. 3, rising line by line, and return (figure, words).

    errors_mm: the residuals, (s,), mm
    rigid: indices of the rigid segments, which share the first line
    tau_mm: the largest residual of a rigid segment
    name: the character's name
    """
    from matplotlib.figure import Figure

    palette = np.array(segment_palette(mesh, rigid)) / 255
    order = np.argsort(errors_mm, kind="stable")
    together = [k for k in order if k in rigid]
    alone = [k for k in order if k not in rigid]
    first = int(bool(together))
    places = dict.fromkeys(together, 0) | {k: first + line for line, k in enumerate(alone)}
    lines = [f"{len(together)} rigid"] * first + [mesh.segment_names[k].replace("_", " ") for k in alone]
    figure = Figure((WIDTH, LINE * len(lines) + FRAME), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    heights = [places[k] for k in order]
    lengths = np.maximum(errors_mm[order], LEAST_MM)
    axes.scatter(lengths, heights, c=palette[order], edgecolors="#333333", linewidths=0.6, s=80, zorder=3)
    axes.axvline(tau_mm, color="#333333", linestyle="--", linewidth=1.2)
    at = {"xytext": (5, 5), "textcoords": "offset points", "xycoords": axes.get_xaxis_transform()}
    axes.annotate(f"τ = {tau_mm:g} mm", (tau_mm, 1), va="bottom", **at)
    axes.set_yticks(range(len(lines)), lines)
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.margins(x=0.08)
    axes.set_xlabel("mean of $e_k$ (Eq. 3), mm")
    error_scale(axes)
    tidy(axes)
    enlarge(axes)
    deforming = [k for k in range(len(errors_mm)) if k not in rigid]
    sides = [f"The largest of a rigid one is {errors_mm[list(rigid)].max():.2g} mm."] if rigid else []
    sides += [f"The smallest of a deforming one is {errors_mm[deforming].min():.2g} mm."] if deforming else []
    whose = with_layout(name, mesh.segment_names)
    return figure, Words(
        f"A dot chart on a logarithmic axis: how far each segment of {whose} is from a rigid motion; {len(rigid)} lie "
        f"left of the line at {tau_mm:g} mm. {' '.join(sides)}",
        f"How far each segment of {whose} is from moving rigidly, in training poses; what lies left of τ is placed by "
        f"§3.4 instead of a network. {' '.join(sides)} Colours are those of Figure 7.",
    )


def save_rigid_errors(
    mesh: Mesh, errors_mm: Sequence[float] | np.ndarray, rigid: Collection[int], tau_mm: float, stem: Path
) -> None:
    """Write `rigid_errors_chart` as <stem>_rigidity.png, with its words; the stem ends with the character's name."""
    name = stem.name.partition("_")[2]
    figure, words = rigid_errors_chart(mesh, np.asarray(errors_mm), rigid, tau_mm, name)
    save_figure(figure, stem.with_name(f"{stem.name}_rigidity.png"), words)
