"""Do two runs of Table 3 agree? How far the speed-ups over the rig of one are from those of the other."""

from collections.abc import Iterable, Mapping

from replicate.report.cast import characters_of
from replicate.report.results import Row
from replicate.report.tables import Table
from replicate.targets.table3.best_times import best_time
from replicate.targets.table3.timing_rows import ALL, ONE
from replicate.targets.table3.timing_tables import compared_names
from replicate.timing.timed_names import RIGS, label_of

AGREED = 1.1  # ratios further apart than this don't agree
KINDS = {"time": "by the means", "median": "by the medians", "p05": "by the 5th percentiles"}

Ratios = Mapping[tuple[str, str, str, str], float]  # by character, method, rig and where


def agreement_table(before: Iterable[Row], after: Iterable[Row]) -> Table | None:
    """Return how many speed-ups over the rig agree in two runs; None where they have none in common."""
    one, other = (speed_ups_by_kind(rows) for rows in (before, after))
    body = []
    for kind, words in KINDS.items():
        apart = apart_by(one[kind], other[kind])
        if not apart:
            return None
        largest = max(apart, key=apart.__getitem__)
        beyond = sum(value > AGREED for value in apart.values())
        body.append((words, f"{len(apart)}", f"{beyond}", f"{100 * (apart[largest] - 1):.0f} %", _words(largest)))
    header = ("", "speed-ups", f"apart by more than {100 * (AGREED - 1):.0f} %", "largest difference", "of what")
    notes = (
        "Each method's best evaluation over the rig's two, on one core and on all.",
        "Other programs take memory from some methods and arithmetic from others, so that ratios change too.",
    )
    return Table("Table 3, this run and the one before it", (header,), tuple(body), notes)


def speed_ups_by_kind(rows: Iterable[Row]) -> dict[str, Ratios]:
    """Return the speed-ups over the rig of each method's best evaluation, by the kind of time that they are of."""
    rows = [row for row in rows if row.table == "table3"]
    found: dict[str, Ratios] = {}
    for kind in KINDS:
        times = {
            (character, name, where): best_time(rows, character, name, where, kind)
            for character in characters_of(rows)
            for name in (*RIGS, *compared_names(rows))
            for where in (ONE, ALL)
        }
        found[kind] = {
            (character, name, rig, where): slow / time
            for (character, name, where), time in times.items()
            for rig in RIGS
            if name not in RIGS and time and (slow := times[character, rig, where])
        }
    return found


def apart_by(one: Ratios, other: Ratios) -> dict[tuple[str, str, str, str], float]:
    """Return the larger over the smaller of two ratios, for those that both have."""
    return {key: max(one[key] / other[key], other[key] / one[key]) for key in one.keys() & other.keys()}


def _words(key: tuple[str, str, str, str]) -> str:
    character, name, rig, where = key
    return f"{character}, {label_of(name)}, {RIGS[rig].removeprefix('The rig, ')}, {where.replace('_', ' ')}"
