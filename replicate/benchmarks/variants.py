"""Trainings of one character that differ in one thing: their sizes and validation errors, as rows and as a table."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from replicate.artefacts.plan import Plan
from replicate.benchmarks.common import publish, selected, split_names
from replicate.config import Config
from replicate.engine.provenance import core_count, provenance
from replicate.engine.scheduler import run
from replicate.engine.store import artefact_folder, read_manifest
from replicate.methods.method_registry import method_named
from replicate.methods.training_stage import LOG
from replicate.report.results import Row
from replicate.report.tables import Table, round_off
from replicate.report.training_curves import read_log

COLUMNS = {  # metric → unit, header
    "model_size": ("MB", "MB"),
    "multiplications": ("count", "million products"),
    "validation_vertex_error": ("mm", "mm"),
    "validation_normal_error": ("deg", "degrees"),
}


@dataclass(frozen=True)
class Variant:
    """One training: a method's, what is changed in words, and the configuration with that change."""

    method: str
    change: str
    config: Config

    def __str__(self) -> str:
        """Return what the training is called."""
        return f"{self.method}, {self.change}"


def nothing_more(variants: Sequence[Variant], rows: Sequence[Row]) -> Sequence[Row]:
    """Return no rows."""
    return ()


def compare_variants(
    name: str,
    variants: Callable[[str, str, int], Sequence[Variant]],
    tables: Callable[[Sequence[Row]], Sequence[Table]],
    options: argparse.Namespace,
    command_line: Sequence[str],
    afterwards: Callable[[Sequence[Variant], Sequence[Row]], Sequence[Row]] = nothing_more,
) -> None:
    """Train the variants of each character, print their tables and publish their rows.

    name: of the benchmark's module. variants: (character, profile, steps) → what is trained. tables: rows → what is
    printed of them. options: with `characters`, `profile`, `steps`, and `only` where the benchmark has
    `common.add_only`. command_line: the words that state them.
    afterwards: (variants, their rows) → more rows; what else is measured of the trained variants, or drawn.
    """
    only = getattr(options, "only", "")
    for character in split_names(options.characters):
        trained = selected(variants(character, options.profile, options.steps), only)
        rows = train_variants(name, trained)
        rows += afterwards(trained, rows)
        publish(name, rows, tables(rows), command_line, in_part=bool(only))


def train_variants(name: str, variants: Sequence[Variant]) -> list[Row]:
    """Train all variants, side by side and through the cache, and return their sizes and validation errors.

    name: of the benchmark's module.
    """
    stages = [method_named(v.method).stages(Plan(v.config))[-1] for v in variants]
    profile, target = variants[0].config.profile, name.replace("_", "-")
    run(stages, facts=provenance(["make", target], profile, [0], core_count()))
    rows = []
    for variant, stage in zip(variants, stages, strict=True):
        folder = artefact_folder(stage.identifier)
        notes = read_manifest(folder)["notes"]
        *_, last = read_log(folder / LOG)
        values = dict(zip(COLUMNS, (notes["size_mb"], notes.get("multiplications"), last[2], last[3]), strict=True))
        facts = (None, 1, variant.config.samples.validation, profile, target)
        rows += [
            Row(
                name,
                stage.label,
                variant.method,
                f"{metric}[{variant.change}]",
                COLUMNS[metric][0],
                float(value),
                *facts,
            )
            for metric, value in values.items()
            if value is not None
        ]
    return rows


def variants_tables(rows: Sequence[Row], name: str, title: str, changes: Mapping[str, Sequence[str]]) -> list[Table]:
    """Return a table for each character in a benchmark's rows: a line a training, a group a method.

    changes: method → what is changed, in the order of the lines.
    """
    tables = []
    for character in dict.fromkeys(row.character for row in rows if row.table == name):
        values = {(r.method, r.metric): r for r in rows if r.table == name and r.character == character}
        shown = [metric for metric in COLUMNS if any(key[1].startswith(f"{metric}[") for key in values)]
        lines: list[tuple[str, ...] | None] = []
        for method, words in changes.items():
            group = []
            for change in words:
                cells = [values.get((method, f"{metric}[{change}]")) for metric in shown]
                if any(cells):
                    group.append((method_named(method).label, change, *map(_cell, cells)))
            lines += [None, *group] if lines and group else group
        poses = max(row.poses or 0 for row in values.values())
        note = f"errors on {poses} poses held out of the training animation; one seed; a short schedule."
        header = ("", "", *(COLUMNS[metric][1] for metric in shown))
        tables.append(Table(f"{title}: {character}", (header,), tuple(lines), (note,), text_columns=2))
    return tables


def _cell(row: Row | None) -> str:
    if row is None:
        return ""
    return f"{row.value / 1e6:.1f}" if row.unit == "count" else round_off(row.value, row.unit)
