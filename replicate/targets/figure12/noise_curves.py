"""Errors of captured performances against the noise of the landmarks, with and without smoothing (Fig. 12)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import Words
from replicate.drawing.style import WIDTH, enlarge, tidy
from replicate.methods.method_registry import method_named
from replicate.report.results import Row, find
from replicate.targets.figure12.capture_rows import TABLE, metric_name
from replicate.targets.figure12.capture_trial import CaptureTrial
from replicate.targets.figure12.driven_motions import NEUTRAL, RIDGE

if TYPE_CHECKING:
    import matplotlib.figure

PANELS = (
    ("landmark_error_mean", "landmarks, mm"),
    ("vertex_error_mean", "all vertices, mm"),
    ("jitter", "jitter over the actor's"),
)
COLOURS = {RIDGE: "#000000", NEUTRAL: "#8a8a8a"}
LABELS = {RIDGE: "ridge regression", NEUTRAL: "neutral pose"}
HEIGHT = 4.6  # inches


def driver_label(name: str) -> str:
    """Return what tables and charts call a driver."""
    return LABELS.get(name) or f"IK networks, {method_named(name).label.lower()}"


def noise_curves(trial: CaptureTrial, rows: Sequence[Row]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a panel a measure, the character driving itself.

    Beside lines with smoothing stand dashed ones without it; the legend names the full ones.
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
