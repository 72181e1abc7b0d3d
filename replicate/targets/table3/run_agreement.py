"""Do two runs of Table 3 agree? How far the speed-ups over the rig of one are from those of the other."""

import re
from collections.abc import Iterable, Mapping

from replicate.report.cast import characters_of
from replicate.report.results import Row
from replicate.report.tables import Table
from replicate.targets.table3.best_times import best_time
from replicate.targets.table3.timing_rows import ALL, ONE
from replicate.targets.table3.timing_tables import compared_names
from replicate.timing.timed_names import CHANGE, RIGS, label_of

AGREED = 1.1  # ratios further apart than this don't agree
KINDS = {"time": "by the means", "median": "by the medians", "p05": "by the 5th percentiles"}

Ratios = Mapping[tuple[str, str, str, str], float]  # by character, method, rig and where


def agreement_rows(before: Iterable[Row], after: Iterable[Row]) -> list[Row]:
    """Return one row a speed-up over the rig that two runs have: the later run's over the earlier one's.

    A row is named as a time of the later run is, as `change_time_one_core[rig]`: of the means, on one core, over the
    compiled rig.
    """
    after = list(after)
    one, other = (speed_ups_by_kind(rows) for rows in (before, after))
    profile, run = (after[0].profile, after[0].run) if after else ("", "")
    return [
        Row(
            "table3", character, name, f"{CHANGE}{kind}_{where}[{rig}]", "ratio", new / old, None, 1, None, profile, run
        )
        for kind in KINDS
        for (character, name, rig, where), new in other[kind].items()
        if (old := one[kind].get((character, name, rig, where)))
    ]


def agreement_table(rows: Iterable[Row]) -> Table | None:
    """Return how many speed-ups over the rig agree with the run before; None where no row says so."""
    changes = [row for row in rows if row.table == "table3" and row.metric.startswith(CHANGE)]
    body = []
    for kind, words in KINDS.items():
        apart = {row: max(row.value, 1 / row.value) for row in changes if row.metric.startswith(f"{CHANGE}{kind}_")}
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


def _words(row: Row) -> str:
    where, rig = re.fullmatch(rf"{CHANGE}[a-z0-9]+_(\w+)\[(\w+)\]", row.metric).groups()
    return f"{row.character}, {label_of(row.method)}, {RIGS[rig].removeprefix('The rig, ')}, {where.replace('_', ' ')}"
