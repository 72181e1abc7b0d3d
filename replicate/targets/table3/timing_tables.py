"""Table 3, printed: ours beside the paper's, and for each character what is behind the means."""

from collections.abc import Iterable, Sequence

from replicate.methods.method_registry import method_named
from replicate.report.cast import STANDS_FOR, characters_of
from replicate.report.results import Row, find, most_seeds, seeds_note
from replicate.report.tables import Table, paper_value, round_off
from replicate.targets.table3.backend_tables import backends_tables
from replicate.targets.table3.best_times import best_row, best_time, cell
from replicate.targets.table3.timing_rows import ALL, GRAPHICS, ONE
from replicate.timing.single_poses import DISTURBED
from replicate.timing.timed_names import NODES, PARTS, RIG, RIGS, in_table_order, label_of, parted

PAPER_CPU = {NODES: ("rig", "time_cpu_engine")}  # else (method, time_high_end_cpu)
MILLION = 1e6
PERCENTILES = ("p05", "median", "p95")
NO_RIG = "–: a rig that is known by its samples alone; it has no function that could be timed."


def tables3(ours: Iterable[Row], paper: Sequence[Row]) -> list[Table]:
    """Return all tables: the paper's Table 3 with ours, on a GPU too if one was timed, then for each character its
    backends and its details.
    """
    rows = [row for row in ours if row.table == "table3"]
    tables = [timing_table(rows, paper), *gpu_tables(rows, paper)]
    for character in characters_of(rows):
        tables += [*backends_tables(rows, character), details_table(rows, character)]
    return tables


def timing_table(rows: Sequence[Row], paper: Sequence[Row]) -> Table:
    """Return mean milliseconds a pose of the rig and of every method's best evaluation, beside the paper's."""
    characters = characters_of(rows)
    body = []
    for name in names_in(rows):
        cells = [label_of(name)]
        for character in characters:
            cells += [cell(rows, best_row(rows, character, name, where), where) for where in (ONE, ALL)]
            method, metric = PAPER_CPU.get(name, (name, "time_high_end_cpu"))
            cells.append(paper_value(find(paper, "table3", STANDS_FOR.get(character, ""), method, metric)))
        body.append(tuple(cells))
    spans = [text for who in characters for text in (who, "", STANDS_FOR.get(who, ""))]
    columns = ("one core", "all cores", "paper, CPU") * len(characters)
    notes = (
        _about(rows),
        *((NO_RIG,) if without_time(rows) else ()),
        "Of each method it is the best of all evaluations of the same weights, to 1e-3 mm, with the rigid step.",
        "Node by node: the deformers one after the other, as an animation package runs a rig. Compiled: all of them as "
        "one function, which no closed rig allows.",
        "The paper's: a 28-thread Xeon E5-2697 v3, rigs in DreamWorks' multithreaded engine Libee.",
        f"~: the 95th percentile is more than {DISTURBED:g} times the median. The machine was disturbed, or poses that "
        "move more controls take longer.",
    )
    return Table("Table 3: milliseconds that one pose takes", (("", *spans), ("", *columns)), tuple(body), notes)


def gpu_tables(rows: Iterable[Row], paper: Sequence[Row]) -> list[Table]:
    """Return the table of milliseconds a pose with the networks on a GPU, beside the CPU's; none without such times."""
    rows = [row for row in rows if row.table == "table3"]
    timed = [row for row in rows if row.metric == f"time_{GRAPHICS}"]
    if not timed:
        return []
    characters = characters_of(timed)
    body = []
    for name in in_table_order({parted(row.method)[0] for row in timed}):
        cells = [label_of(name)]
        for character in characters:
            cells += [cell(rows, best_row(rows, character, name, where), where) for where in (ALL, GRAPHICS)]
            for metric in ("time_high_end_cpu", "time_high_end_gpu"):
                cells.append(paper_value(find(paper, "table3", STANDS_FOR.get(character, ""), name, metric)))
        body.append(tuple(cells))
    spans = [text for who in characters for text in (who, "", STANDS_FOR.get(who, ""), "")]
    columns = ("CPU", "GPU", "paper, CPU", "paper, GPU") * len(characters)
    notes = (
        "Means of single poses. CPU: on all cores. GPU: the networks there and the rigid step on the CPU, as in the "
        "paper. Both are the best of all evaluations of the same weights.",
        "The paper's: a 28-thread Xeon E5-2697 v3 and a Quadro K5200, which was new in 2014.",
    )
    title = "Table 3 on a GPU: milliseconds that one pose takes"
    return [Table(title, (("", *spans), ("", *columns)), tuple(body), notes)]


def compared_names(rows: Sequence[Row]) -> list[str]:
    """Return the methods whose speed is compared with the rig's, in the order of tables."""
    names = (name for name in names_in(rows) if name not in RIGS and name not in PARTS)
    return [name for name in names if method_named(name).in_charts]


def speed_table(rows: Sequence[Row]) -> Table:
    """Return how many times as fast as both evaluations of the rig every method's best one is, on all cores."""
    rows = [row for row in rows if row.table == "table3"]
    characters = characters_of(rows)
    body = []
    for name in compared_names(rows):
        cells = [label_of(name)]
        for character in characters:
            nodes, compiled, own = (best_time(rows, character, each, ALL) for each in (*RIGS, name))
            cells += [_over(nodes, own), _over(compiled, own)]
        body.append(tuple(cells))
    spans = [text for who in characters for text in (who, "")]
    columns = ("node by node", "compiled") * len(characters)
    notes = ("By the means on all cores. Each method's best evaluation, with the rigid step, over the rig's two.",)
    title = "Table 3 as speed-ups: how many times as fast as the rig"
    return Table(title, (("", *spans), ("", *columns)), tuple(body), notes)


def details_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's speed-ups over both ways to evaluate its rig, spreads, and what else a pose costs."""
    own = [row for row in rows if row.character == character]

    def value(name: str, metric: str) -> float | None:
        row = find(own, "table3", character, name, metric)
        return row.value if row else None

    body = []
    for name in names_in(own):
        best = best_row(own, character, name, ALL)
        ratios = [_over(value(rig, f"time_{ALL}"), best and best.value) for rig in RIGS]
        spread = [round_off(value(best.method if best else name, f"{kind}_{ALL}"), "ms") for kind in PERCENTILES]
        count = value(name, "multiplications")
        millions = "–" if count is None else f"{count / MILLION:,.1f}"
        body.append((label_of(name), *ratios, *spread, millions, round_off(value(name, "model_size"), "MB")))
    cores = value(RIG, "cores")
    header = ("", "× node by node", "× compiled", "5 %", "median", "95 %", "million multiplications", "MB")
    notes = (
        "×: how many times as fast as the rig the best evaluation is, by the means on all cores. 5 %, median, 95 %: "
        f"milliseconds there, on {cores:.0f} cores."
        if cores
        else "×: how many times as fast as the rig.",
        _about(own),
        *((NO_RIG,) if without_time(own) else ()),
    )
    return Table(f"Times and costs of one pose: {character}", (header,), tuple(body), notes)


def names_in(rows: Sequence[Row]) -> list[str]:
    """Return the rigs, methods and parts that are timed, in the order of tables; and the rig where it can't be."""
    timed = {parted(row.method)[0] for row in rows if row.metric == f"time_{ALL}"}
    return in_table_order(timed | ({RIG} if without_time(rows) else set()))


def without_time(rows: Sequence[Row]) -> set[str]:
    """Return the characters that are known by their samples alone: their rig was not timed, and all else was."""
    timed = {row.character for row in rows if row.method == RIG and row.metric == f"time_{ALL}"}
    return {row.character for row in rows if row.metric == f"time_{ALL}"} - timed


def _over(rig: float | None, time: float | None) -> str:
    return f"{rig / time:.2f}" if rig and time else "–"


def _about(rows: Sequence[Row]) -> str:
    timed = [row for row in rows if row.metric == f"time_{ALL}"]
    counts = {row.poses or 0 for row in timed if row.method != NODES}
    nodes = {row.poses or 0 for row in timed if row.method == NODES}
    times = "" if most_seeds(rows) < 2 else f"; {seeds_note(rows)}"
    fewer = f" ({min(counts):,} where a method has a quicker way)" if len(counts) > 1 else ""
    many = f"{max(counts, default=0):,} evaluations of single poses{fewer}"
    slow = f"; {min(nodes):,} node by node" if nodes else ""
    return f"Means of {many}, in turns{slow}{times}."
