"""Our SSDR beside Dem Bones as a table: what `bench-lbs` measured, over seeds, and ours over theirs."""

import re
from collections.abc import Sequence
from dataclasses import replace

from replicate.report.results import Row, over_seeds
from replicate.report.tables import Table, round_off

METHODS = {
    "ssdr": "ours", "ssdr_sparse": "ours, sparse from the start",
    "dem_bones": "Dem Bones", "dem_bones_default": "Dem Bones, as it comes",
}  # fmt: skip
EQUAL = 30  # iterations at which times are compared
COLUMNS = {
    "rmse": "RMSE, mm", "mean": "mean, mm", "normal": "normal, °", "max": "max, mm", "time": "time, s",
    "time_at_equal_iterations": f"{EQUAL} iterations, s", "time_to_dem_bones_error": "to equal error, s",
    "peak_memory": "memory, MB", "iterations": "iterations",
}  # fmt: skip
USUAL = (1_000, 200)  # training and test poses
METRIC = re.compile(r"(\w+)\[(\d+)(?:, seed (\d+))?(?:, (\d+) training and (\d+) test poses)?\]")
RATIO = "ratio"  # in the place of a method: ours over Dem Bones'


def metric_of(name: str, bones: int, seed: int, poses: tuple[int, int] = USUAL) -> str:
    """Return what a fit's number is called: "rmse[16, seed 0]", with the numbers of poses where others than usual.

    poses: how many training poses and test poses there are.
    """
    training, test = poses
    own = "" if poses == USUAL else f", {training} training and {test} test poses"
    return f"{name}[{bones}, seed {seed}{own}]"


def lbs_table(rows: Sequence[Row], character: str, poses: tuple[int, int] = USUAL) -> Table:
    """Return one character's table: each method's means over seeds, and ours over Dem Bones' with its spread.

    poses: the numbers of training and test poses whose rows count.
    """
    rows = [row for row in rows if row.character == character and _poses(row.metric) == poses]
    by_seed = _by_seed(rows)
    runs = [[*own, *_ratios(own)] for own in by_seed.values()]
    by_metric = {(row.method, row.metric): row for row in over_seeds(runs)}
    body: list[tuple[str, ...] | None] = []
    partly = False
    for bones in sorted({_place(metric)[1] for _, metric in by_metric}):
        body += [None] if body else []
        seeds = sum(any(_place(row.metric)[1] == bones for row in run) for run in runs)
        for method, words in (METHODS | {RATIO: "ours / Dem Bones"}).items():
            cells = [by_metric.get((method, f"{name}[{bones}]")) for name in COLUMNS]
            if (first := cells[0]) is None:
                continue
            fewer = f" ({first.seeds} of {seeds} seeds)" if first.seeds < seeds else ""
            body.append((f"{words}, {bones} bones{fewer}", *(_cell(row, first.seeds) for row in cells)))
            partly |= any(row.seeds < first.seeds for row in cells if row)
    several = f"means over {len(runs)} seeds of poses; ratios ± their standard deviation"
    notes = (
        f"Held-out poses, bones refitted to each alike; {several if len(runs) > 1 else 'one seed of poses'}. "
        "To equal error: until the training error is no larger than Dem Bones'. Times are the processor's, one thread, "
        "with all that comes before the first iteration."
        + (" In brackets: over so many seeds only; in the others it wasn't reached, or not measured." if partly else "")
        + _note_on_starts(rows),
    )
    return Table(f"LBS: {character}", (("", *COLUMNS.values()),), tuple(body), notes)


def _place(metric: str) -> tuple[str, int, int | None]:
    """Return the name, the number of bones and the seed of a metric, "rmse[16, seed 0]"; None if it has no seed."""
    name, bones, seed, *_ = METRIC.fullmatch(metric).groups()
    return name, int(bones), None if seed is None else int(seed)


def _poses(metric: str) -> tuple[int, int]:
    training, test = METRIC.fullmatch(metric).groups()[3:]
    return (int(training), int(test)) if training else USUAL


def _by_seed(rows: Sequence[Row]) -> dict[int, list[Row]]:
    """Return the rows of each seed, which their metrics no longer name."""
    by_seed: dict[int, list[Row]] = {}
    for row in rows:
        name, bones, seed = _place(row.metric)
        by_seed.setdefault(seed, []).append(replace(row, metric=f"{name}[{bones}]"))
    return by_seed


def _ratios(rows: Sequence[Row]) -> list[Row]:
    """Return ours over Dem Bones', for each metric that both have."""
    ours, theirs = ({row.metric: row for row in rows if row.method == method} for method in ("ssdr", "dem_bones"))
    both = ours.keys() & theirs.keys()
    return [replace(ours[m], method=RATIO, unit="ratio", value=ours[m].value / theirs[m].value) for m in sorted(both)]


def _note_on_starts(rows: Sequence[Row]) -> str:
    """Return a sentence on where Dem Bones was not left to its own start, or nothing."""
    theirs = [row for row in rows if row.method == "dem_bones"]
    starts = [(_place(row.metric)[1], int(row.value)) for row in theirs if row.metric.startswith("bones_of_own_start")]
    few = sorted({(bones, own) for bones, own in starts if own < bones})
    if not few:
        return ""
    counts = ", ".join(f"{own} of {bones}" for bones, own in few)
    return f" Dem Bones' own start found too few bones ({counts}): it got our clusters, which its memory includes."


def _cell(row: Row | None, seeds: int) -> str:
    """Return a number as it is shown, and of how many seeds, if those are fewer than the others of its line."""
    if row is None:
        return "–"
    value = row.value / 1e3 if row.unit == "ms" else row.value
    if row.unit in ("mm", "deg", "ratio"):
        text = round_off(value, row.unit, row.sd if row.unit == "ratio" else None)
    else:
        text = f"{value:.1f}" if row.unit == "ms" and value < 100 else f"{value:,.0f}"
    return f"{text} ({row.seeds})" if row.seeds < seeds else text
