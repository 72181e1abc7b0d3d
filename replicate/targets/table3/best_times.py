"""The time of a method's best evaluation: what its weights need, by whichever exact backend is the fastest."""

from collections.abc import Iterable, Sequence

from replicate.report.results import Row, find
from replicate.report.tables import round_off
from replicate.timing.single_poses import DISTURBED
from replicate.timing.timed_names import EXACT


def best_row(rows: Iterable[Row], character: str, method: str, where: str, table: str = "table3") -> Row | None:
    """Return the row with the least mean time of a method among its exact evaluations.

    where: "one_core", "all_cores" or "gpu". table: what the rows' table is called.

    The exact ones give the method's own vertices, but for rounding in float32; weights rounded to 16 bits do not. None
    where there is no row.
    """
    keys = {(table, character, method + ending, f"time_{where}") for ending in EXACT}
    return min((row for row in rows if row.key in keys), key=lambda row: row.value, default=None)


def best_time(rows: Sequence[Row], character: str, method: str, where: str, kind: str = "time") -> float | None:
    """Return the milliseconds of a method's best evaluation, or of a rig. kind: "time", the mean, "median", "p05", …"""
    best = best_row(rows, character, method, where)
    row = find(rows, "table3", character, best.method, f"{kind}_{where}") if best else None
    return row.value if row else None


def is_disturbed(rows: Sequence[Row], character: str, name: str, where: str) -> bool:
    """Return whether the slow evaluations took so much longer than the usual ones that the mean says little."""
    median, p95 = (find(rows, "table3", character, name, f"{kind}_{where}") for kind in ("median", "p95"))
    return bool(median and p95 and p95.value > DISTURBED * median.value)


def cell(rows: Sequence[Row], row: Row | None, where: str) -> str:
    """Return a mean time as tables show it, with a mark where it is disturbed."""
    if row is None:
        return "–"
    mark = "~" if is_disturbed(rows, row.character, row.method, where) else ""
    return mark + round_off(row.value, "ms", row.sd)
