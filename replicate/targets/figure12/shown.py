"""Figure 12 in tables and pictures: how near each way to drive a character comes, by the noise of the landmarks."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.capture import landmark_rig
from replicate.capture.driven_face import face_picture, head_camera
from replicate.drawing.face_sheet import Cell, face_sheet
from replicate.drawing.panels import WIDTH, Words, enlarge, tidy
from replicate.methods.method_registry import in_order, method_named
from replicate.report.results import Row, characters_of, find, seeds_note
from replicate.report.tables import Table, round_off
from replicate.targets.figure12 import rows
from replicate.targets.figure12.rows import NEUTRAL, RIDGE, TABLE, CaptureTrial, Driver, exact, metric_name, targets_of

if TYPE_CHECKING:
    import matplotlib.figure


BLOCKS = (  # metric, unit, words
    ("landmark_error_mean", "mm", "Landmarks, mm"),
    ("vertex_error_mean", "mm", "All vertices, mm"),
    ("parameter_error_mean", "ratio", "Parameters, in % of their ranges"),
    ("jitter", "ratio", "Jitter, over the actor's"),
    ("outside_limits", "ratio", "Parameters brought back within their limits, %"),
)
PERCENT = ("parameter_error_mean", "outside_limits")
FIRST, NOISE = "refined", 1.0  # the driver that the answer is about, and the noise that it quotes, mm
NOTES = (
    "Landmarks: how far those of the mesh end from where they shall go, in the image plane. Vertices and parameters: "
    "against the actor's, where the character is its own actor.",
    "Parameters: of those that can move a landmark. Several sets of them give nearly the same landmarks, so that near "
    "landmarks don't mean near parameters.",
    "Jitter: mean second difference in time of the landmarks, over that of the actor's without noise.",
    "ridge regression: from landmarks straight to parameters, fitted to what trains the networks, noise and all; it "
    "and the neutral pose have the mesh of the first networks.",
)


def tables12(ours: Iterable[Row]) -> list[Table]:
    """Return a table for each character and each actor that drives it, itself first."""
    rows = [row for row in ours if row.table == TABLE]
    return [
        capture_table([row for row in rows if row.character == character], character, actor)
        for character in characters_of(rows)
        for actor in actors_of(rows, character)
    ]


def answer12(ours: Iterable[Row]) -> list[str]:
    """Return the figure's result in a paragraph for each character, through the refined model."""
    rows = [row for row in ours if row.table == TABLE]
    return [
        _answer([row for row in rows if row.character == character], character) for character in characters_of(rows)
    ]


def _answer(rows: Sequence[Row], character: str) -> str:
    noises = noises_of(rows, character)
    least, some = noises[0], min(noises, key=lambda noise: abs(noise - NOISE))

    def value(metric: str, method: str = FIRST, noise: float = least, smoothed: bool = False) -> float | None:
        row = find(rows, TABLE, character, method, metric_name(metric, character, noise, smoothed))
        return row.value if row else None

    landmarks, vertices = (
        f"{value(metric):.2f} mm (ridge regression {value(metric, RIDGE):.2f} mm, neutral pose "
        f"{value(metric, NEUTRAL):.2f} mm)"
        for metric in ("landmark_error_mean", "vertex_error_mean")
    )
    calm, off = (value(metric, noise=some, smoothed=True) for metric in ("jitter", "landmark_error_mean"))
    smooth = "" if calm is None else f", smoothed {calm:.1f} times; its landmarks are then {off:.2f} mm off"
    trembling = f"trembles {value('jitter', noise=some):.1f} times as much as the actor{smooth}"
    percent, neutral_percent = (100 * value("parameter_error_mean", method) for method in (FIRST, NEUTRAL))
    return (
        f"**On {character}** IK networks bring landmarks of its own, with {least:g} mm of noise, back to {landmarks}, "
        f"and all vertices to {vertices}. The parameters are off by {percent:.1f} % of their ranges, those of the "
        f"neutral pose by {neutral_percent:.1f} %. With {some:g} mm of noise the face {trembling}."
    )


def noises_of(rows: Sequence[Row], actor: str) -> list[float]:
    """Return the noises that a performance was tried with, mm, rising."""
    pattern = re.compile(rf"\w+\[{re.escape(actor)}\]\[noise (.+?) mm\]")
    return sorted({float(match[1]) for row in rows if (match := pattern.match(row.metric))})


def actors_of(rows: Sequence[Row], character: str) -> list[str]:
    """Return the actors that drive a character, itself first."""
    names = {
        match[1] for row in rows if row.character == character and (match := re.match(r"scale\[(.*?)\]", row.metric))
    }
    return sorted(names, key=lambda name: (name != character, name))


def capture_table(rows: Sequence[Row], character: str, actor: str) -> Table:
    """Return one character's table for one actor: a column for each noise, lines with smoothing and without."""
    noises = noises_of(rows, actor)
    present = {row.method for row in rows}
    names = [*in_order(present - {RIDGE, NEUTRAL, "scale"}), *(name for name in (RIDGE, NEUTRAL) if name in present)]
    body: list[tuple[str, ...] | None] = []
    for metric, unit, words in BLOCKS:
        lines = []
        for name in names:
            for smoothed in (False, True):
                metrics = [metric_name(metric, actor, noise, smoothed) for noise in noises]
                found = [find(rows, TABLE, character, name, each) for each in metrics]
                if any(found) and not (smoothed and name == NEUTRAL):
                    label = driver_label(name) + (", smoothed" if smoothed else "")
                    lines.append((label, *(_cell(row, metric, unit) for row in found)))
        if lines:
            body += [None] if body else []
            body += [(words, *[""] * len(noises)), *lines]
    header = ("noise of the landmarks", *(f"{noise:g} mm" for noise in noises))
    scale = find(rows, TABLE, character, "scale", f"scale[{actor}]")
    whose = "by its own landmarks" if actor == character else f"by the landmarks of the {actor}"
    frames = f"{max(row.poses or 0 for row in rows)} frames; " + (f"scale {scale.value:.3g}; " if scale else "")
    profiles = ", ".join(sorted({row.profile for row in rows}))
    about = f"{frames}{seeds_note(rows)}; profile {profiles}."
    return Table(f"Figure 12: {character}, driven {whose}", (header,), tuple(body), (about, *NOTES))


def _cell(row: Row | None, metric: str, unit: str) -> str:
    if row is None:
        return "–"
    if metric in PERCENT:
        return f"{100 * row.value:.1f}" + (f" ± {100 * row.sd:.1f}" if row.sd is not None else "")
    return round_off(row.value, unit, row.sd)


# Figure 12: frames of performances, and below each the character that their landmarks drive.


def figure12(
    trial: CaptureTrial, inputs: Mapping[str, Path], driver: Driver
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): for each actor a row of its frames and a row of the character that it drives.

    The landmarks are exact, and smoothed as the configuration says. driver: the way from landmarks to the face.
    """
    rig = landmark_rig.load_landmark_rig(inputs)
    height, width = rows.picture_size()
    camera = head_camera(rig, width / height)
    cells, parts = [], []
    for actor in trial.actors:
        acted = rows.load(inputs, actor)
        targets, scale = targets_of(trial, exact(acted), rig, trial.section.smoothing_frames)
        shown = acted.shown.tolist()
        params = np.clip(driver.solve(targets[shown]), rig.lower, rig.upper).astype(np.float32)
        apart = np.linalg.norm((driver.face(params)[:, rig.control_points] - targets[shown])[..., :2], axis=-1).mean(1)
        for k, (frame, picture) in enumerate(zip(shown, acted.pictures, strict=True)):
            driven = face_picture(driver.face, params[k], camera, width, height)
            cells.append(Cell(f"{actor}, {frame}", (picture, driven), (f"{apart[k]:.1f} mm",)))
        parts.append(f"{actor} acts, scale {scale:.2g}, {apart.mean():.2f} mm")
    label, actors = method_named(driver.name).label.lower(), " and then ".join(trial.actors)
    return face_sheet(cells, len(shown)), Words(
        f"Pairs of clay heads: an actor with 54 red landmarks, and below it {trial.character} with the expression that "
        f"they lead to. Means of how far landmarks end from where they shall go: {'; '.join(parts)}.",
        f"Performance capture (after Fig. 12). Upper faces: the actor, first {actors}, a rig whose landmarks are known "
        f"exactly; above them the frame. Lower faces: {trial.character}, driven by the landmarks' movement through IK "
        f"networks; the mesh is that of the {label} networks. Below: the mean distance of the landmarks from where "
        "they shall go, in the image plane.",
    )


# Errors of captured performances against the noise of the landmarks, with and without smoothing (Fig. 12).

PANELS = (
    ("landmark_error_mean", "landmarks, mm"),
    ("vertex_error_mean", "all vertices, mm"),
    ("jitter", "jitter over the actor's"),
)
COLOURS = {RIDGE: "#000000", NEUTRAL: "#8a8a8a"}
LABELS = {RIDGE: "ridge regression", NEUTRAL: "neutral pose"}
HEIGHT = 4.6  # inches


def driver_label(name: str) -> str:
    """Return a driver's name in tables and charts."""
    return LABELS.get(name) or f"IK networks, {method_named(name).label.lower()}"


def noise_curves(trial: CaptureTrial, rows: Sequence[Row]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a panel for each measure, of the character driving itself.

    Full lines are smoothed and named by the legend; dashed ones are not smoothed.
    """
    from matplotlib.figure import Figure

    figure = Figure((WIDTH, HEIGHT), dpi=100, facecolor="white", layout="constrained")
    panels = figure.subplots(1, len(PANELS))
    names = [*(method.name for method in trial.methods), RIDGE, NEUTRAL]
    smooths = _is_smoothed(trial)
    for axes, (metric, words) in zip(panels, PANELS, strict=True):
        for name in names:
            colour = COLOURS.get(name) or method_named(name).colour
            for smoothed, style in ((True, "-"), (False, "--")) if smooths else ((False, "-"),):
                curve = _curve(trial, rows, name, metric, smoothed)
                is_full = smoothed == smooths
                if curve and (is_full or name != NEUTRAL):
                    label = driver_label(name) if is_full else None
                    axes.plot(trial.noises_mm, curve, style, color=colour, label=label, linewidth=2, marker="o", ms=5)
        axes.set_xlabel("noise of landmarks, mm")
        axes.set_title(words)
        axes.set_ylim(bottom=0)
        tidy(axes)
        enlarge(axes)
    handles, labels = panels[0].get_legend_handles_labels()
    legend = figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 3), frameon=False)
    for text in legend.get_texts():
        text.set_fontsize(14)
    return figure, _words(trial, rows, names)


def _is_smoothed(trial: CaptureTrial) -> bool:
    """Return whether landmarks are smoothed at all: a window of one frame smooths nothing."""
    return trial.section.smoothing_frames > 1


def _curve(trial: CaptureTrial, rows: Sequence[Row], name: str, metric: str, smoothed: bool) -> list[float]:
    found = [
        find(rows, TABLE, trial.character, name, metric_name(metric, trial.character, noise, smoothed))
        for noise in trial.noises_mm
    ]
    return [row.value for row in found if row]


def _words(trial: CaptureTrial, rows: Sequence[Row], names: Sequence[str]) -> Words:
    parts, smooths, window = [], _is_smoothed(trial), trial.section.smoothing_frames
    treated = "smoothed" if smooths else "as they are"
    lines = f"Full lines: smoothed over {window} frames; dashed: as they are." if smooths else "Nothing is smoothed."
    for name in names:
        curve = _curve(trial, rows, name, "landmark_error_mean", smooths)
        if curve:
            parts.append(f"{driver_label(name)} from {curve[0]:.2f} to {curve[-1]:.2f} mm")
    return Words(
        f"Three charts of errors against the noise of the landmarks, from {trial.noises_mm[0]:g} to "
        f"{trial.noises_mm[-1]:g} mm. Landmarks, {treated}: {'; '.join(parts)}.",
        f"{trial.character} drives itself: what noise of the landmarks does. Its own rig acts, so the truth is known. "
        f"{lines} Left: how far the landmarks end from the actor's, in the image plane. Middle: the same for all "
        "vertices, in space. Right: the landmarks' mean second difference in time over the actor's; 1 is as "
        "smooth as the actor, 0 stands still.",
    )
