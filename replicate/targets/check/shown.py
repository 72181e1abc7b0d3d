"""What a look at a face found: as CSV, in lines and tables, as pictures of poses, controls' reach and texels."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.approximation.influence import farthest_first
from replicate.base.tables import Column, read_csv, write_csv
from replicate.drawing.characters import BACKGROUND
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.heatmap import colour_bar, error_colours
from replicate.drawing.light import EVEN
from replicate.drawing.panels import DPI, WIDTH, Words, enlarge, tidy
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import CLAY, Surface, camera_for, frame_surfaces
from replicate.report.tables import Table, round_off
from replicate.rig_study.first_look import (
    CONTROL,
    EFFECT_MM,
    FACE,
    MEANINGLESS,
    OK,
    SEGMENT,
    WORSE,
    Face,
    Finding,
    listed,
    vertices_a_texel,
    warnings,
)
from replicate.targets.figure07 import segment_palette, shown_segment

if TYPE_CHECKING:
    import matplotlib.figure

SUM_MM = 0.01  # from a straight line: a face whose held-out poses are nearer is a sum of shapes

# As CSV: one finding a row.

COLUMNS = (
    Column("character"),
    Column("kind", choices=(FACE, CONTROL, SEGMENT)),
    Column("name", optional=True),
    Column("metric"),
    Column("unit", optional=True),
    Column("value", "number", optional=True),
    Column("verdict", choices=(OK, WORSE, MEANINGLESS)),
    Column("sentence", optional=True),
)


def write_findings(file: Path, character: str, findings: Sequence[Finding]) -> None:
    """Write the findings about a character."""
    numbers = (replace(each, value=None if each.value is None else float(each.value)) for each in findings)
    write_csv(file, COLUMNS, [(character, *vars(each).values()) for each in numbers])


def read_findings(file: Path) -> list[Finding]:
    """Return what `write_findings` wrote. Raises InputError, naming the file, for anything else."""
    frame = read_csv(file, COLUMNS, (), "there is no such file; `make check` writes it.")
    texts = {name: frame[name].fillna("") for name in ("name", "unit", "sentence")}
    rows = frame.drop(columns="character").assign(**texts).itertuples(index=False, name=None)
    return [Finding(*row[:4], None if np.isnan(row[4]) else float(row[4]), *row[5:]) for row in rows]


def by_name(findings: Sequence[Finding], kind: str) -> dict[str, dict[str, Finding]]:
    """Return the findings of a kind: name → metric → finding, in their order."""
    found: dict[str, dict[str, Finding]] = {}
    for each in findings:
        if each.kind == kind:
            found.setdefault(each.name, {})[each.metric] = each
    return found


# In lines.

FEW = 4  # of each kind
MOST = 12  # warnings


def in_lines(character: str, findings: Sequence[Finding], file: str) -> list[str]:
    """Return what was found in at most 25 lines: the facts, what is amiss, and the worst controls and segments."""
    said = warnings(findings)
    lines = [f"{character}: {facts_in_words(findings)}"]
    lines += [f"{each.verdict}: {each.sentence}" for each in said[:MOST]]
    lines += [f"{len(said) - MOST} more in {file}"] if len(said) > MOST else []
    lines += [] if said else ["nothing is amiss"]
    controls, segments = by_name(findings, CONTROL), by_name(findings, SEGMENT)
    lines += _worst("controls, those that reach least", _ranked(controls, _trouble), _control_line, file)
    lines += _worst("segments, those with least texels", _ranked(segments, _tightness), _segment_line, file)
    return lines


def _ranked(named: dict[str, dict[str, Finding]], key) -> list[tuple[str, dict[str, Finding]]]:
    return sorted(named.items(), key=lambda item: key(item[1]))


def _worst(heading: str, ranked: list, line, file: str) -> list[str]:
    more = f"; {len(ranked) - FEW} more in {file}" if len(ranked) > FEW else ""
    return [f"{heading}{more}:", *(f"  {name}: {line(entry)}" for name, entry in ranked[:FEW])]


def _severity(entry: dict[str, Finding]) -> int:
    order = (MEANINGLESS, WORSE, OK)
    return min(order.index(each.verdict) for each in entry.values())


def _trouble(entry: dict[str, Finding]) -> tuple[int, float]:
    reach = entry["reach"].value
    return _severity(entry), -1.0 if reach is None else reach


def _tightness(entry: dict[str, Finding]) -> tuple[int, float]:
    return _severity(entry), entry["texels_a_vertex"].value if "texels_a_vertex" in entry else np.inf


def _control_line(entry: dict[str, Finding]) -> str:
    value = {metric: each.value for metric, each in entry.items()}
    if not value["used_in_training"]:
        return "never moves in training"
    moves = f"moves {value['vertices']:,.0f} vertices, "
    if quiet := _quiet(entry):
        moves += quiet
    else:
        moves += "by how much isn't known" if value["reach"] is None else f"up to {round_off(value['reach'], 'mm')} mm"
    return (
        f"{value['training_low']:.3g} to {value['training_high']:.3g} in training, in {value['used_in_training']:.0%} "
        f"of the poses; {moves}"
    )


def _quiet(entry: dict[str, Finding]) -> str:
    """Return in words that a control moves nothing by itself, or nothing at all; "" for others."""
    if entry["reach"].value is None or entry["reach"].value > EFFECT_MM:
        return ""
    return "only together with others" if entry["vertices"].value else "moves nothing"


def _segment_line(entry: dict[str, Finding]) -> str:
    value = {metric: each.value for metric, each in entry.items()}
    texels = f", {value['texels_a_vertex']:.2g} texels a vertex" if "texels_a_vertex" in value else ""
    away = (
        "" if value["off_its_place"] <= EFFECT_MM else f", {round_off(value['off_its_place'], 'mm')} mm from its place"
    )
    vertices, controls = _counted(value["vertices"], "vertices"), _counted(value["controls"], "controls")
    return f"{vertices}, {controls}, {_motion(value)}{texels}{away}"


def _motion(value: dict[str, float | None]) -> str:
    if not value["rigid"]:
        return "deforms"
    if value["misplaced"] is not None:
        return "rigid, follows nothing"
    off = value["attached_yet_misplaced"]
    return "rigid, follows others" if off is None else f"rigid, attached {round_off(off, 'mm')} mm off"


def facts_in_words(findings: Sequence[Finding]) -> str:
    """Return counts and sizes in one line."""
    value = {each.metric: each.value for each in findings if each.kind == FACE}
    parts = [_counted(value[name], name) for name in ("vertices", "faces", "segments", "controls")]
    unit = next(each.name for each in findings if each.metric == "size")
    threshold, is_sum = value["influence_threshold"], value.get("straight_line_off", math.inf) < SUM_MM
    return (
        f"{', '.join(parts)}; {value['size']:.4g} mm large (unit: {unit}); "
        f"{value['training_poses']:,.0f} training, {value['validation_poses']:,.0f} validation and "
        f"{value['test_poses']:,.0f} test poses, {value['frames_per_second']:g} frames a second; "
        + (
            f"what moves which vertex is found from {threshold:g} mm on"
            if threshold
            else "what moves which vertex is stated by the author"
        )
        + ("; its controls only add shapes: a straight line is all of it (METHODS=linear)" if is_sum else "")
    )


def _counted(count: float | None, name: str) -> str:
    return f"{count:,.0f} {name[:-1] if count == 1 else name}"


def warnings_table(character: str, findings: Sequence[Finding]) -> Table:
    """Return what is amiss with a character, what makes results meaningless first."""
    body = tuple((each.verdict, each.sentence) for each in warnings(findings)) or (("ok", "nothing is amiss"),)
    return Table(f"What is amiss with {character}", (("", "what, and what helps"),), body, text_columns=2)


def segments_table(character: str, findings: Sequence[Finding]) -> Table:
    """Return a line for each segment of a character."""
    body = []
    for name, entry in by_name(findings, SEGMENT).items():
        value = {metric: each.value for metric, each in entry.items()}
        texels = f"{value['texels_a_vertex']:.2f}" if "texels_a_vertex" in value else "–"
        numbers = (f"{value['vertices']:,.0f}", f"{value['controls']:.0f}", texels)
        body.append((name, _motion(value), *numbers, round_off(value["off_its_place"], "mm")))
    header = ("", "how it moves", "vertices", "controls", "texels a vertex", "from its place, mm")
    return Table(f"Segments of {character}", (header,), tuple(body), text_columns=2)


# As pictures.

SHOWN_POSES = 6
COLUMNS_SHOWN = 4
ASPECT = 0.85  # a picture's width over its height


def poses_figure(face: Face, character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Draw a face at rest, in test poses far apart, and by its vertices a texel; return (figure, words).

    Its segments have colours, if several deform.
    """
    mesh, samples = face.rig.mesh, face.samples
    many = len(mesh.segment_names) - len(face.rigid) > 1
    colours = np.array(segment_palette(mesh, face.rigid), np.uint8)[shown_segment(mesh)] if many else CLAY
    test = np.asarray(samples.test_params)
    chosen = np.sort(farthest_first((test - face.rig.default) / face.ranges, SHOWN_POSES))
    poses = [("the mesh", face.rig.default, mesh.neutral)]
    poses += [(f"test pose {k}", test[k], mesh.neutral + samples.test_offsets[k]) for k in chosen]
    scenes = [
        [Surface(vertices, mesh.faces, colours), *prop_surfaces(face.rig.pose_props(params))]
        for _, params, vertices in poses
    ]
    crowd = vertices_a_texel(face)
    limit = max(2.0, float(np.quantile(crowd, 0.99)))
    scenes.append([Surface(mesh.neutral, mesh.faces, error_colours(crowd[mesh.faces].mean(axis=1), limit), lit=False)])
    camera = camera_for("front", mesh.neutral)
    camera = frame_surfaces(camera, [surface for scene in scenes for surface in scene], ASPECT)
    width = cell_width(COLUMNS_SHOWN)
    pictures = [render(scene, camera, width, round(width / ASPECT), BACKGROUND, EVEN) for scene in scenes]
    titles = [*(title for title, *_ in poses), "vertices a texel"]
    cells = [Cell(title, (picture,)) for title, picture in zip(titles, pictures, strict=True)]
    names, maps = listed(mesh.segment_names), f"maps of {face.map_size} × {face.map_size} texels"

    def bar(figure, axes):
        colour_bar(figure, axes, limit, f"vertices a texel of {maps}", orientation="horizontal")

    return face_sheet(cells, COLUMNS_SHOWN, bar=bar), Words(
        f"{character} at rest, in {len(chosen)} test poses far apart, and coloured by how many vertices share a texel.",
        f"{character} as the mesh has it, in {len(chosen)} test poses that are far apart, and by how many vertices "
        f"share a texel of {maps}. Colours of poses are those of segments: {names}. Each must be in its place in all "
        "poses. Where vertices share a texel, neighbours can't move on their own, however good a network is.",
    )


LONGEST = 60  # controls that a chart has lines for: those that reach farthest, and those that reach least
LINE, FRAME = 0.22, 1.2  # inches
MARKED, GREY = "#b2182b", "#666666"


def reach_chart(findings: Sequence[Finding], character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Chart how far each control moves a vertex, those that never move in training marked; return (figure, words)."""
    from matplotlib.figure import Figure

    entries = by_name(findings, CONTROL)
    reach = {name: entry["reach"].value for name, entry in entries.items()}
    order = sorted(entries, key=lambda name: -1.0 if reach[name] is None else reach[name], reverse=True)
    left_out = max(0, len(order) - LONGEST)
    if left_out:
        order = [*order[: LONGEST // 2], *order[-(LONGEST // 2) :]]
    gap = LONGEST // 2 if left_out else len(order)  # a line stands there for those that are left out
    lines = [k + (k >= gap) for k in range(len(order))]
    never = [name for name in order if not entries[name]["used_in_training"].value]
    figure = Figure((WIDTH, LINE * len(order) + FRAME), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    colours = [MARKED if name in never else "#4d7ea8" for name in order]
    axes.barh(lines, [reach[name] or 0.0 for name in order], color=colours)
    farthest = max((value or 0.0 for value in reach.values()), default=1.0) or 1.0
    for k, name in zip(lines, order, strict=True):
        words = "never moves in training" if name in never else _quiet(entries[name])
        axes.text(
            0.01 * farthest + (reach[name] or 0.0), k, words, va="center", color=MARKED if name in never else GREY
        )
    if left_out:
        axes.text(0, gap, f"  … {left_out} more …", va="center")
    axes.set_yticks(lines, [name.replace("_", " ") for name in order])
    axes.set_ylim(len(order) + bool(left_out) - 0.4, -0.6)
    axes.set_xlabel("how far it moves a vertex at most, mm")
    tidy(axes)
    enlarge(axes, 10.5)
    all_never = sum(not entry["used_in_training"].value for entry in entries.values())
    never_in_words = f"{all_never} of {len(entries)} never move in training." if all_never else "All move in training."
    return figure, Words(
        f"A bar chart of how far the controls of {character} move a vertex, up to {farthest:.3g} mm. {never_in_words}",
        f"How far each control of {character} moves a vertex at most, alone and from rest to the end of its limits, "
        f"or of what training has where only samples are known. {never_in_words}",
    )
