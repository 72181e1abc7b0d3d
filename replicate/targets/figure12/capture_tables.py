"""Figure 12's numbers, printed: how near each way to drive a character comes, by the noise of the landmarks."""

import re
from collections.abc import Iterable, Sequence

from replicate.methods.method_registry import in_order
from replicate.report.cast import characters_of
from replicate.report.results import Row, find, seeds_note
from replicate.report.tables import Table, round_off
from replicate.targets.figure12.capture_rows import TABLE, metric_name
from replicate.targets.figure12.driven_motions import NEUTRAL, RIDGE
from replicate.targets.figure12.noise_curves import driver_label

BLOCKS = (  # metric, unit, words
    ("landmark_error_mean", "mm", "Landmarks, mm"),
    ("vertex_error_mean", "mm", "All vertices, mm"),
    ("parameter_error_mean", "ratio", "Parameters, in % of their ranges"),
    ("jitter", "ratio", "Jitter, over the actor's"),
    ("outside_limits", "ratio", "Parameters brought back within their limits, %"),
)
PERCENT = ("parameter_error_mean", "outside_limits")
FIRST, NOISE = "refined", 1.0  # the driver that the answer tells of, and about which noise, mm
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
    """Return a table for each character and each actor that drives it, its own performance first."""
    rows = [row for row in ours if row.table == TABLE]
    return [
        capture_table([row for row in rows if row.character == character], character, actor)
        for character in characters_of(rows)
        for actor in actors_of(rows, character)
    ]


def answer12(ours: Iterable[Row]) -> list[str]:
    """Return the figure's result in a paragraph for each character, through the refined model."""
    rows = [row for row in ours if row.table == TABLE]
    return [_answer([row for row in rows if row.character == one], one) for one in characters_of(rows)]


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
    own, rest = (100 * value("parameter_error_mean", method) for method in (FIRST, NEUTRAL))
    return (
        f"**On {character}** IK networks bring landmarks of its own, with {least:g} mm of noise, back to {landmarks}, "
        f"and all vertices to {vertices}. The parameters are off by {own:.1f} % of their ranges, those of the neutral "
        f"pose by {rest:.1f} %. With {some:g} mm of noise the face {trembling}."
    )


def noises_of(rows: Sequence[Row], actor: str) -> list[float]:
    """Return the noises that a performance was tried with, mm, rising."""
    pattern = re.compile(rf"\w+\[{re.escape(actor)}\]\[noise (.+?) mm\]")
    return sorted({float(match[1]) for row in rows if (match := pattern.match(row.metric))})


def actors_of(rows: Sequence[Row], character: str) -> list[str]:
    """Return who drives a character, itself first."""
    names = {
        match[1] for row in rows if row.character == character and (match := re.match(r"scale\[(.*?)\]", row.metric))
    }
    return sorted(names, key=lambda name: (name != character, name))


def capture_table(rows: Sequence[Row], character: str, actor: str) -> Table:
    """Return one character's table for one actor: a column for each noise, lines with and without smoothing."""
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
