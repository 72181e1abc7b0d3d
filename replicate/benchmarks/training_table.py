"""Trainings that differ in one thing, as a table: what decides the networks' errors on validation poses."""

from collections.abc import Iterable, Sequence

from replicate.report.cast import characters_of
from replicate.report.manifest import section
from replicate.report.notebooks import folder_of
from replicate.report.results import Row
from replicate.report.tables import Table, round_off

TABLE = "bench_training"
METRICS = {
    "validation_vertex_error": ("mm", "mm"),
    "validation_normal_error": ("deg", "degrees"),
    "normal_error_over_floor": ("ratio", "degrees / floor"),
    "clips_vertex_error": ("mm", "other clips, mm"),
    "clips_normal_error": ("deg", "other clips, degrees"),
}
METHODS = ("coarse", "refined", "dense")
BALANCED, RAW_ANIMATION = "balanced draws", "raw animation"  # changes that claim C12 compares
TWICE, RESTART = "twice the steps", "twice the steps, in two cycles"  # one long schedule, or a warm restart
USUAL = "peak rate 0.005"  # the profile's own recipe among the changes: augmented, with uniform draws


def trainings_tables(rows: Iterable[Row]) -> list[Table]:
    """Return a table for each character in `bench_training.csv`: what was changed, mm, degrees, and over the floor.

    A row's metric is metric[change], as `replicate.benchmarks.bench_training` writes it.
    """
    own = [row for row in rows if row.table == TABLE and row.method in METHODS]
    return [_trainings_table([row for row in own if row.character == name], name) for name in characters_of(own)]


def _trainings_table(rows: Sequence[Row], character: str) -> Table:
    by_change: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        metric, _, change = row.metric.rstrip("]").partition("[")
        by_change.setdefault((row.method, change), {})[metric] = row
    lines: list[tuple[str, ...] | None] = []
    for method in METHODS:
        changes = sorted(change for name, change in by_change if name == method)
        lines += [None] if lines and changes else []
        for change in changes:
            cells = (by_change[method, change].get(metric) for metric in METRICS)
            lines.append((method, change, *(round_off(row.value, row.unit) if row else "" for row in cells)))
    header = ("", "peak rate or change", *(name for _, name in METRICS.values()))
    validation = [row.poses or 0 for row in rows if not row.metric.startswith("clips_")]
    notes = [f"errors on {max(validation)} poses held out of the training animation; one seed."] if validation else []
    if clips := [row.poses or 0 for row in rows if row.metric.startswith("clips_")]:
        notes.append(
            f"Other clips: trained anew, with whole clips held out, and measured on {max(clips)} poses of these."
        )
    return Table(
        f"Trainings that differ in one thing: {character}", (header,), tuple(lines), tuple(notes), text_columns=2
    )


def axis_text(rows: Iterable[Row]) -> str:
    """Return which controls §3.5's intervals follow most, with their correlations, from `bench_training.csv`.

    A line for each character, after one that says what they are.
    """
    own = [row for row in rows if row.table == TABLE and row.metric.startswith("interval_correlation[")]
    lines = []
    for character in characters_of(own):
        correlations = sorted((row for row in own if row.character == character), key=lambda row: -abs(row.value))
        controls = (f"{row.metric.rstrip(']').partition('[')[2]} {row.value:+.2f}" for row in correlations)
        lines.append(f"{character}: {', '.join(controls)}")
    return "\n".join(["controls that the intervals follow most, with their correlations", *lines] if lines else [])


def draws_text(samples_per_bin: Sequence[int]) -> str:
    """Return what share of the samples half of §3.5's balanced draws go to: those in the emptier half of its intervals.

    samples_per_bin: how many samples lie in each interval of the landmarks' first principal component.
    """
    counts = sorted(count for count in samples_per_bin if count)
    rare = counts[: len(counts) // 2]
    return (
        f"{len(rare)} of {len(counts)} intervals hold {100 * sum(rare) / sum(counts):.1f} % of the samples and get "
        f"{100 * len(rare) / len(counts):.0f} % of the draws"
    )


def balance_text(name: str) -> str:
    """Return, for each character whose manifest records it, how §3.5's balanced draws were spread over the samples."""
    lines = []
    for character, facts in section(folder_of(name), "table2").get("characters", {}).items():
        samples = [stage for title, stage in facts.get("stages", {}).items() if title.startswith("samples-")]
        counts = samples[0].get("notes", {}).get("samples_per_bin") if samples else None
        if counts:
            lines.append(f"{character}: {draws_text(counts)}")
    return "\n".join(lines)
