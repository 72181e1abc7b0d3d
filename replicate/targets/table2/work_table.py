"""What each row of Table 2 costs: megabytes, multiplications a pose, and the time of its training."""

from collections.abc import Iterable

from replicate.methods.method_registry import in_order, method_named
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off

METRICS = ("model_size", "multiplications", "training")
NOTES = (
    "Multiplications: products with weights, map networks as Fig. 3 draws them; the rigid step is left out.",
    "LBS: the blend of a pose whose bones are known; finding them takes the true mesh.",
    "Training: wall time of one core, with what a row builds on, without rig and samples; longer on a busy machine.",
)


def work_table(ours: Iterable[Row], character: str) -> Table | None:
    """Return one character's sizes, multiplications a pose and times of training; None where no row counts them."""
    rows = [row for row in ours if row.table == "table2" and row.character == character and row.metric in METRICS]
    if not any(row.metric == "multiplications" for row in rows):
        return None
    body = []
    for method in in_order({row.method for row in rows}):
        size, work, training = (find(rows, "table2", character, method, metric) for metric in METRICS)
        millions = round_off(work.value / 1e6, "ratio") if work else "–"
        cells = (round_off(row.value, row.unit, row.sd) if row else "–" for row in (size, training))
        body.append((method_named(method).label, next(cells), millions, next(cells)))
    header = ("", "MB", "million multiplications a pose", "training, s")
    return Table(f"Size, work and training: {character}", (header,), tuple(body), NOTES)
