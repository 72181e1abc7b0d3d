"""Table 3, printed: ours beside the paper's, and for each character what is behind the means."""

from collections.abc import Iterable, Sequence

from replicate.report.cast import STANDS_FOR, characters_of
from replicate.report.results import Row, find, most_seeds, seeds_note
from replicate.report.tables import Table, paper_value, round_off
from replicate.targets.table3.timing_rows import ALL, NODES_EVERY, ONE
from replicate.timing.single_poses import DISTURBED
from replicate.timing.timed_names import NODES, PLAIN, RIG, RIGS, in_table_order, label_of

PAPER_CPU = {NODES: ("rig", "time_cpu_engine")}  # else (method, time_high_end_cpu)
MILLION = 1e6
NO_RIG = "–: a rig that is known by its samples alone; it has no function that could be timed."


def tables3(ours: Iterable[Row], paper: Sequence[Row]) -> list[Table]:
    """Return all tables: the paper's Table 3 with ours, then one for each character."""
    rows = [row for row in ours if row.table == "table3"]
    return [timing_table(rows, paper), *(details_table(rows, character) for character in characters_of(rows))]


def timing_table(rows: Sequence[Row], paper: Sequence[Row]) -> Table:
    """Return mean milliseconds a pose of the rig and all methods, every character beside the paper's."""
    characters = characters_of(rows)
    body = []
    for name in names_in(rows):
        cells = [label_of(name)]
        for character in characters:
            cells += [_cell(rows, character, name, where) for where in (ONE, ALL)]
            method, metric = PAPER_CPU.get(name, (name, "time_high_end_cpu"))
            cells.append(paper_value(find(paper, "table3", STANDS_FOR.get(character, ""), method, metric)))
        body.append(tuple(cells))
    spans = [text for who in characters for text in (who, "", STANDS_FOR.get(who, ""))]
    columns = ("one core", "all cores", "paper, CPU") * len(characters)
    notes = (
        _about(rows),
        *((NO_RIG,) if without_time(rows) else ()),
        "Every approximation contains the rigid step, which runs on the CPU as in the paper.",
        "Plain: the same networks, evaluated by torch as Fig. 3 draws them, a module a segment.",
        "Node by node: the deformers one after the other, as an animation package runs a rig. Compiled: all of them as "
        "one function, which no closed rig allows.",
        "The paper's: a 28-thread Xeon E5-2697 v3, rigs in DreamWorks' multithreaded engine Libee.",
        f"~: disturbed; the 95th percentile is more than {DISTURBED:g} times the median.",
    )
    return Table("Table 3: milliseconds that one pose takes", (("", *spans), ("", *columns)), tuple(body), notes)


def details_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's speed-ups over both ways to evaluate its rig, spreads, and what else a pose costs."""
    own = [row for row in rows if row.character == character]

    def value(name: str, metric: str) -> float | None:
        row = find(own, "table3", character, name, metric)
        return row.value if row else None

    body = []
    for name in names_in(own):
        time = value(name, f"time_{ALL}")
        ratios = [_over(value(rig, f"time_{ALL}"), time) for rig in RIGS]
        spread = [round_off(value(name, f"{kind}_{ALL}"), "ms") for kind in ("p05", "median", "p95")]
        count = value(name.removesuffix(PLAIN), "multiplications")
        millions = "–" if count is None else f"{count / MILLION:,.1f}"
        body.append((label_of(name), *ratios, *spread, millions, round_off(value(name, "model_size"), "MB")))
    cores = value(RIG, "cores")
    header = ("", "× node by node", "× compiled", "5 %", "median", "95 %", "million multiplications", "MB")
    notes = (
        "×: how many times as fast as the rig, by the means on all cores. 5 %, median, 95 %: milliseconds there, "
        f"on {cores:.0f} cores."
        if cores
        else "×: how many times as fast as the rig.",
        _about(own),
        *((NO_RIG,) if without_time(own) else ()),
    )
    return Table(f"Times and costs of one pose: {character}", (header,), tuple(body), notes)


def names_in(rows: Sequence[Row]) -> list[str]:
    """Return what is timed, in the order of tables; and the rig where it can't be."""
    timed = {row.method for row in rows if row.metric == f"time_{ALL}"}
    return in_table_order(timed | ({RIG} if without_time(rows) else set()))


def without_time(rows: Sequence[Row]) -> set[str]:
    """Return the characters that are known by their samples alone: their rig was not timed, and all else was."""
    timed = {row.character for row in rows if row.method == RIG and row.metric == f"time_{ALL}"}
    return {row.character for row in rows if row.metric == f"time_{ALL}"} - timed


def is_disturbed(rows: Sequence[Row], character: str, name: str, where: str) -> bool:
    """Return whether the slow evaluations took so much longer than the usual ones that the mean says little."""
    median, p95 = (find(rows, "table3", character, name, f"{kind}_{where}") for kind in ("median", "p95"))
    return bool(median and p95 and p95.value > DISTURBED * median.value)


def _cell(rows: Sequence[Row], character: str, name: str, where: str) -> str:
    row = find(rows, "table3", character, name, f"time_{where}")
    mark = "~" if is_disturbed(rows, character, name, where) else ""
    return mark + round_off(row.value, "ms", row.sd) if row else "–"


def _over(rig: float | None, time: float | None) -> str:
    return f"{rig / time:.2f}" if rig and time else "–"


def _about(rows: Sequence[Row]) -> str:
    counts = [row.poses or 0 for row in rows if row.metric == f"time_{ALL}" and row.method != NODES]
    times = "" if most_seeds(rows) < 2 else f"; {seeds_note(rows)}"
    many = f"{max(counts, default=0):,}"
    return f"Means of {many} evaluations of single poses, in turns; node by node every {NODES_EVERY}th turn{times}."
