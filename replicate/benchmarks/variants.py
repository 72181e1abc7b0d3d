"""Trainings of one character that differ in one thing: their sizes and validation errors, as rows and as a table."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.benchmarks.common import in_groups, make_stages, publish, selected, split_names
from replicate.config import Config
from replicate.drawing.panels import DPI, MEASURES, WIDTH, Words, enlarge, tidy
from replicate.engine.store import artefact_folder, read_manifest
from replicate.geometry.mesh import Mesh
from replicate.methods.method_registry import method_named
from replicate.methods.plan import Plan
from replicate.methods.training_stage import LOG
from replicate.report.results import Row, read_log
from replicate.report.tables import Table, our_value, round_off

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

    import replicate.approximation.samples

COLUMNS = {  # metric → unit, header
    "model_size": ("MB", "MB"),
    "multiplications": ("count", "million products"),
    "validation_vertex_error": ("mm", "mm"),
    "validation_normal_error": ("deg", "degrees"),
}


@dataclass(frozen=True)
class Variant:
    """One training: of which method, what is changed in words, and the configuration with that change."""

    method: str
    change: str
    config: Config

    def __str__(self) -> str:
        """Return what the training is called."""
        return f"{self.method}, {self.change}"


def compare_variants(
    name: str,
    variants: Callable[[str, str, int], Sequence[Variant]],
    tables: Callable[[Sequence[Row]], Sequence[Table]],
    options: argparse.Namespace,
    command_line: Sequence[str],
    afterwards: Callable[[Sequence[Variant], Sequence[Row]], Sequence[Row]] = lambda variants, rows: (),
) -> None:
    """Train the variants of each character, print their tables and publish their rows.

    name: the benchmark's module.
    variants: (character, profile, steps) → what is trained.
    tables: rows → what is printed.
    options: `characters`, `profile`, `steps`, and `only` where the benchmark has `common.add_only`.
    command_line: the words that state the options.
    afterwards: (variants, their rows) → more rows; measures the trained variants further, or draws them.
    """
    only = getattr(options, "only", "")
    for character in split_names(options.characters):
        trained = selected(variants(character, options.profile, options.steps), only)
        rows = train_variants(name, trained)
        rows += afterwards(trained, rows)
        publish(name, rows, tables(rows), command_line, in_part=bool(only))


def train_variants(name: str, variants: Sequence[Variant]) -> list[Row]:
    """Train all variants, side by side and through the cache, and return their sizes and validation errors.

    name: the benchmark's module.
    """
    stages = [method_named(v.method).stages(Plan(v.config))[-1] for v in variants]
    profile = variants[0].config.profile
    make_stages(name, profile, stages)
    rows = []
    for variant, stage in zip(variants, stages, strict=True):
        folder = artefact_folder(stage.identifier)
        notes = read_manifest(folder)["notes"]
        values = (notes["size_mb"], notes.get("multiplications"), *validation_errors(folder))
        facts = (None, 1, variant.config.samples.validation, profile, name.replace("_", "-"))
        for (metric, (unit, _)), value in zip(COLUMNS.items(), values, strict=True):
            if value is not None:
                key = (name, stage.label, variant.method, f"{metric}[{variant.change}]")
                rows.append(Row(*key, unit, float(value), *facts))
    return rows


def validation_errors(folder: Path) -> tuple[float, float]:
    """Return the validation errors (mm, degrees) of a finished training, from the last row of its log."""
    *_, (_, _, mm, degrees, *_) = read_log(folder / LOG)
    return mm, degrees


def floor_deg(
    mesh: Mesh,
    samples: "replicate.approximation.samples.SampleSet",
    segments: Sequence,
    size: int,
    refinement: Sequence = (),
    refinement_size: int = 64,
) -> float:
    """Return the mean normal error in degrees of the validation poses as well as maps can hold them, as a log has it.

    segments, size, refinement, refinement_size: as for `Floor`; `segments` are all that networks deform.
    """
    import torch

    from replicate.approximation.deformation_map import Floor
    from replicate.approximation.losses import Supervision
    from replicate.approximation.segments import segment_vertices

    floor = Floor(segments, size, refinement, refinement_size)
    supervision = Supervision(mesh, samples, segment_vertices(segments), 1.0, torch.device("cpu"))
    return supervision.validation()(lambda _: floor(np.asarray(samples.validation_offsets)))[1]


def variants_tables(rows: Sequence[Row], name: str, title: str, changes: Mapping[str, Sequence[str]]) -> list[Table]:
    """Return a table for each character in a benchmark's rows: a line a training, a group a method.

    changes: method → what is changed, in the order of the lines.
    """
    tables = []
    for character in dict.fromkeys(row.character for row in rows if row.table == name):
        values = {(r.method, r.metric): r for r in rows if r.table == name and r.character == character}
        shown = [metric for metric in COLUMNS if any(key[1].startswith(f"{metric}[") for key in values)]
        lines = []
        for method, words in changes.items():
            for change in words:
                found = [values.get((method, f"{metric}[{change}]")) for metric in shown]
                if any(found):
                    lines.append((method, (method_named(method).label, change, *map(_cell, found))))
        poses = max(row.poses or 0 for row in values.values())
        note = f"errors on {poses} poses held out of the training animation; one seed; a short schedule."
        header = ("", "", *(COLUMNS[metric][1] for metric in shown))
        tables.append(Table(f"{title}: {character}", (header,), in_groups(lines), (note,), text_columns=2))
    return tables


def _cell(row: Row | None) -> str:
    if row is None:
        return ""
    return f"{row.value / 1e6:.1f}" if row.unit == "count" else our_value(row)


# Trainings that differ in one thing, as a picture: how far each change moves both errors.

LINE, SIZE_PT = 0.34, 13  # inches of a line; the size of letters
SHORT = 0.6  # decades: on a longer axis ticks at equal steps would touch
BESIDE = 48  # points from the right of a panel to the end of a number
METRICS = ("validation_vertex_error", "validation_normal_error")  # in the order of MEASURES


def variants_chart(
    rows: Sequence[Row], name: str, character: str, changes: Mapping[str, Sequence[str]], bases: Sequence[str]
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both errors of one character's trainings, a line each.

    The errors are written at the right of each panel, where no bar crosses them.

    rows: of the benchmark, with the errors.
    name: the benchmark's table.
    character: as in the rows.
    changes: method → what is changed, in the order of the lines.
    bases: those changes that others start from; a bar joins each change with the last base above it.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    values = {(r.method, r.metric): r.value for r in rows if r.table == name and r.character == character}
    lines = [
        (method, change)
        for method, words in changes.items()
        for change in words
        if (method, f"{METRICS[1]}[{change}]") in values
    ]
    # a panel for each error: a mark a line, and a bar from the base that the line starts from
    figure = Figure((WIDTH, 1.0 + LINE * len(lines)), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, metric, (_, unit, label) in zip(panels, METRICS, MEASURES, strict=True):
        base = None
        for place, (method, change) in enumerate(lines):
            error, colour = values[method, f"{metric}[{change}]"], method_named(method).colour
            if change in bases:
                base = error
            elif base is not None:
                axes.plot([base, error], [place, place], color=colour, linewidth=2, alpha=0.4)
            axes.plot(error, place, "D" if change in bases else "o", color=colour, markersize=6)
            beside = {"textcoords": "offset points", "ha": "right", "va": "center", "annotation_clip": False}
            axes.annotate(round_off(error, unit), (1, place), (BESIDE, 0), ("axes fraction", "data"), **beside)
        # few ticks, with numbers that don't touch
        axes.set_xscale("log")
        axes.margins(x=0.06)
        short = np.ptp(np.log10(axes.get_xlim())) < SHORT
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=(1, 2, 5, 10)) if short else LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(partial(_tick, axes))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(label)
        tidy(axes)
        enlarge(axes, SIZE_PT)
    # names at the left, and the extremes in words
    panels[0].set_yticks(range(len(lines)), _names(lines, bases))
    panels[0].set_ylim(len(lines) - 0.5, -0.5)
    worst = max(lines, key=lambda line: values[line[0], f"{METRICS[1]}[{line[1]}]"])
    best = min(lines, key=lambda line: values[line[0], f"{METRICS[1]}[{line[1]}]"])
    ends = " ".join(
        f"The {word} normal error, {values[method, f'{METRICS[1]}[{change}]']:.2g} degrees, is of {method}, {change}."
        for word, (method, change) in (("smallest", best), ("largest", worst))
    )
    return figure, Words(
        f"Two dot charts of validation errors of {len(lines)} trainings of {character}. {ends}",
        f"Errors of {character}'s networks on the validation poses, a training a line. Diamonds are recipes as they "
        "are; a circle is the recipe above it with the one change that stands at its left.",
    )


def _names(lines: Sequence[tuple[str, str]], bases: Sequence[str]) -> list[str]:
    """Return what stands at the left of each line: a base's name; of a change, only what differs from its base."""
    several, names, base = len({method for method, _ in lines}) > 1, [], ""
    for method, change in lines:
        if change in bases:
            base = change
            names.append(f"{method_named(method).label}: {change}" if several else change)
        else:
            names.append(change.removeprefix(f"{base}, "))
    return names


def _tick(axes: "matplotlib.axes.Axes", value: float, place: int | None = None) -> str:
    """Return a tick's label; on an axis shorter than a decade all have the same number of decimals."""
    low, high = sorted(axes.get_xlim())
    shown = [f"{tick:.6g}" for tick in axes.xaxis.get_majorticklocs() if low <= tick <= high]
    decimals = max((len(text.partition(".")[2]) for text in shown), default=0)
    return f"{value:.{decimals}f}" if high < 10 * low else f"{value:g}"
