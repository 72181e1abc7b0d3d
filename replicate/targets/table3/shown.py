"""Print Table 3: ours beside the paper's, and for each character the details behind the means."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from replicate.drawing.panels import DPI, WIDTH, Words, enlarge, error_scale, tidy
from replicate.methods.method_registry import in_order, method_named
from replicate.report.results import STANDS_FOR, Row, characters_of, find, most_seeds, seeds_note
from replicate.report.tables import Table, paper_value, round_off
from replicate.targets.table3.rows import ALL, DISTURBED, GRAPHICS, ONE, best_row, best_time, cell
from replicate.timing.single_poses import (
    BACKENDS,
    CHANGE,
    EXACT,
    FAST,
    GPU,
    GRAPH,
    HALF,
    JAX,
    NODES,
    ONNX,
    ONNX_SPINNING,
    ONNX_THREADS,
    PARTS,
    PLAIN,
    RIG,
    RIGS,
    THREADED,
    in_table_order,
    label_of,
    parted,
)

if TYPE_CHECKING:
    import matplotlib.figure


PAPER_CPU = {NODES: ("rig", "time_cpu_engine")}  # else (method, time_high_end_cpu)
MILLION = 1e6
PERCENTILES = ("p05", "median", "p95")
NO_RIG = "–: a rig that is known by its samples alone; it has no function that could be timed."


def tables3(ours: Iterable[Row], paper: Sequence[Row]) -> list[Table]:
    """Return all tables: the paper's Table 3 with ours, that on a GPU if timed, and two kinds for each character."""
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
    spans = [text for character in characters for text in (character, "", STANDS_FOR.get(character, ""))]
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
    """Return, in a list, the table of milliseconds a pose on a GPU beside the CPU's, if there are such times."""
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
    spans = [text for character in characters for text in (character, "", STANDS_FOR.get(character, ""), "")]
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
    """Return how many times as fast as either evaluation of the rig every method's best one is, on all cores."""
    rows = [row for row in rows if row.table == "table3"]
    characters = characters_of(rows)
    body = []
    for name in compared_names(rows):
        cells = [label_of(name)]
        for character in characters:
            nodes, compiled, fastest = (best_time(rows, character, each, ALL) for each in (*RIGS, name))
            cells += [_over(nodes, fastest), _over(compiled, fastest)]
        body.append(tuple(cells))
    spans = [text for character in characters for text in (character, "")]
    columns = ("node by node", "compiled") * len(characters)
    notes = ("By the means on all cores. Each method's best evaluation, with the rigid step, over the rig's two.",)
    title = "Table 3 as speed-ups: how many times as fast as the rig"
    return Table(title, (("", *spans), ("", *columns)), tuple(body), notes)


def details_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's speed-ups over either evaluation of its rig, spreads, multiplications and sizes."""
    rows = [row for row in rows if row.character == character]

    def value(name: str, metric: str) -> float | None:
        row = find(rows, "table3", character, name, metric)
        return row.value if row else None

    body = []
    for name in names_in(rows):
        best = best_row(rows, character, name, ALL)
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
        _about(rows),
        *((NO_RIG,) if without_time(rows) else ()),
    )
    return Table(f"Times and costs of one pose: {character}", (header,), tuple(body), notes)


def names_in(rows: Sequence[Row]) -> list[str]:
    """Return the rigs, methods and parts that were timed, in the order of tables; the rig also if it can't be timed."""
    timed = {parted(row.method)[0] for row in rows if row.metric == f"time_{ALL}"}
    return in_table_order(timed | ({RIG} if without_time(rows) else set()))


def without_time(rows: Sequence[Row]) -> set[str]:
    """Return the characters with times but none of their rig, since they are known by their samples alone."""
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


# Table 3's second question: how long does each way to evaluate the same weights take?

COLUMNS = (PLAIN, "", JAX, ONNX, ONNX_THREADS, ONNX_SPINNING, FAST, HALF, GPU, GRAPH)
ABOUT = {
    "": "The suite's: what its errors are measured with; torch, with a kernel of our own for maps.",
    PLAIN: "Plain: torch's own operations, a module a segment, maps as Fig. 3 draws them.",
    JAX: "JAX: the networks as one function that XLA compiles, with the suite's compiled rigid step.",
    ONNX: "ONNX Runtime: the file that `make deploy` writes, on one thread that does not spin.",
    ONNX_THREADS: "All threads: the same file on a thread a core. They rest while they wait; one alone never waits.",
    ONNX_SPINNING: "Spinning: these threads keep their cores busy while they wait, which is the runtime's default.",
    FAST: "Fast: the suite's evaluation of single poses, compiled, on one thread (replicate/inference).",
    HALF: "16 bits: the same with weights of dense layers rounded to float16; vertices move by up to {} mm for it.",
    GPU: "Torch on a GPU: the CPU starts each operation on its own.",
    GRAPH: "CUDA graph: all operations, recorded once and started as a whole.",
}
WHERE = {ONE: "one core", ALL: "all cores", GRAPHICS: "a GPU"}


def backends_tables(rows: Sequence[Row], character: str) -> list[Table]:
    """Return tables of one character's milliseconds a pose by backend; none if there is one backend only.

    There is one for a single core if that was measured, one for all cores if it wasn't or if a backend uses several
    threads, and one for a GPU if that was timed.
    """
    rows = [row for row in rows if row.table == "table3" and row.character == character]
    several = {where: {row.method for row in rows if row.metric == f"time_{where}"} for where in WHERE}
    divided = any(parted(name)[1] in THREADED for name in several[ALL])
    shown = [ONE, ALL] if several[ONE] and divided else [ONE if several[ONE] else ALL]
    shown += [GRAPHICS] if several[GRAPHICS] else []
    tables = (_backends_table(rows, character, where) for where in shown)
    return [table for table in tables if table]


def _backends_table(rows: Sequence[Row], character: str, where: str) -> Table | None:
    timed = [row for row in rows if row.metric == f"time_{where}"]
    several = {parted(row.method)[0] for row in timed if parted(row.method)[1]}
    columns = [ending for ending in COLUMNS if any(name + ending in {row.method for row in timed} for name in several)]
    if not several:
        return None
    body = []
    for name in in_table_order(several):
        times = [find(timed, "table3", character, name + ending, f"time_{where}") for ending in columns]
        eager = next(row for row in times if row)  # plain torch where it differs from the suite's
        best = best_row(timed, character, name, where)
        body.append((label_of(name), *(cell(rows, row, where) for row in times), f"{eager.value / best.value:.1f}"))
    header = ("", *(BACKENDS[ending] for ending in columns), "best over torch")
    rigid = "the rigid step on the CPU" if where == GRAPHICS else "the rigid step with them"
    notes = (
        f"Means on {WHERE[where]}, {rigid}.",
        *(ABOUT[ending].format(_largest(rows, ending)) for ending in columns),
        f"Best over torch: plain torch, or the suite's where there is none, over the best that keeps within "
        f"{_largest(rows, *filter(None, EXACT))} mm of the suite's vertices.",
    )
    title = f"Backends of {character} on {WHERE[where]}: milliseconds a pose by way to evaluate the same weights"
    return Table(title, (header,), tuple(body), notes)


def _largest(rows: Sequence[Row], *endings: str) -> str:
    """Return the largest difference of some backends from the suite's vertices, mm, in words."""
    differences = [row.value for row in rows if row.metric == "largest_difference" and parted(row.method)[1] in endings]
    return f"{max(differences):.1g}" if differences else "1e-3"


# Error over milliseconds and over megabytes: what a smaller error costs, with a dot for each method.

ERROR = "normal_error_mean"
AXES = ((f"time_{ALL}", "ms", "milliseconds a pose, all cores"), ("model_size", "MB", "size, MB"))
HEIGHT = 5.2  # inches
BACKGROUND = {"facecolor": "white", "edgecolor": "none", "pad": 1}  # behind letters, where lines would cross them
LINES = {
    NODES: ("rig, node by node", "left", 4),
    RIG: ("rig, compiled", "right", -3),
}  # words, their side of the line, and points from it
ABOVE, BELOW = 10, -25  # a label's distance from its dot, points
INSIDE = 6  # pixels between a label and the end of its panel
NEAR = (0.45, 0.05)  # labels of nearer dots would meet: share of the costs' span, and powers of ten of the error


def frontier_chart(
    times: Sequence[Row], errors: Sequence[Row], character: str
) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): a character's normal errors over time and over size, on logarithmic axes.

    times: rows of Table 3. errors: rows of Table 2. None if no method has both.
    """
    from matplotlib.figure import Figure

    # the methods with a time, an error and a size
    names = in_order(
        parted(row.method)[0]
        for row in times
        if row.character == character
        and row.metric == AXES[0][0]
        and find(errors, "table2", character, parted(row.method)[0], ERROR)
    )
    names = [name for name in names if find(times, "table3", character, name, "model_size")]
    if not names:
        return None
    figure = Figure((WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    phrases = []
    for axes, (metric, unit, label) in zip(figure.subplots(1, 2, sharey=True), AXES, strict=True):
        dots = {
            name: (_cost(times, character, name, metric), find(errors, "table2", character, name, ERROR).value)
            for name in names
        }
        # a labelled dot for each method
        for name, (cost, error) in dots.items():
            method = method_named(name)
            axes.plot(cost, error, "o", color=method.colour, markersize=10, zorder=3)
            place = {"textcoords": "offset points", "ha": "center", "zorder": 2, "bbox": BACKGROUND}
            axes.annotate(method.label, (cost, error), (0, BELOW if _is_crowded(name, dots) else ABOVE), **place)
            phrases.append(f"{method.label}: {round_off(cost, unit)} {unit}, {round_off(error, 'deg')}°")
        # a line for each evaluation of the rig
        for name, (words, side, aside) in LINES.items() if unit == "ms" else ():
            if row := find(times, "table3", character, name, metric):
                axes.axvline(row.value, color="0.45", linestyle=":", zorder=1)
                style = {"rotation": 90, "ha": side, "va": "bottom", "color": "0.35"}
                axes.annotate(words, (row.value, 0), (aside, 4), ("data", "axes fraction"), "offset points", **style)
        axes.margins(x=0.22, y=0.16)
        axes.set_xlabel(label)
        error_scale(axes)
        error_scale(axes, "y")
        tidy(axes)
        enlarge(axes)
    figure.axes[0].set_ylabel("normal error, degrees")
    enlarge(figure.axes[0])
    _keep_inside(figure, {method_named(name).label for name in names})
    return figure, Words(
        f"Two dot charts for {character}, normal error against time and against size: {'; '.join(phrases)}.",
        f"Error against time and size: {character}. The axes are logarithmic; lower and further left is better. "
        "Dotted: the rig, whose error is zero.",
    )


def _keep_inside(figure: "matplotlib.figure.Figure", labels: Collection[str]) -> None:
    """Move labels of dots that would cross the left or the right end of their panel back inside."""
    figure.draw_without_rendering()  # only the layout knows how wide a panel is
    for axes in figure.axes:
        room = axes.get_window_extent()
        for text in axes.texts:
            if text.get_text() in labels:
                extent = text.get_window_extent()
                pixels = max(room.x0 + INSIDE - extent.x0, 0) or min(room.x1 - INSIDE - extent.x1, 0)
                across, up = text.xyann
                text.xyann = (across + pixels * 72 / figure.dpi, up)


def _is_crowded(name: str, dots: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether another dot of larger cost is so near that their labels would meet."""
    places = {each: np.log10(dot) for each, dot in dots.items()}
    span = np.ptp([cost for cost, _ in places.values()])
    for other, place in places.items():
        cost, error = place - places[name]
        if (cost, other) > (0, name) and cost <= NEAR[0] * span and abs(error) < NEAR[1]:
            return True
    return False


def _cost(times: Sequence[Row], character: str, name: str, metric: str) -> float:
    row = find(times, "table3", character, name, metric)
    return (best_row(times, character, name, ALL) if metric == AXES[0][0] else row).value


# Do two runs of Table 3 agree? The ratios of their speed-ups over the rig.

AGREED = 1.1  # ratios further apart than this don't agree
KINDS = {"time": "by the means", "median": "by the medians", "p05": "by the 5th percentiles"}

Ratios = Mapping[tuple[str, str, str, str], float]  # by character, method, rig and where


def agreement_rows(before: Iterable[Row], after: Iterable[Row]) -> list[Row]:
    """Return a row for each speed-up over the rig that two runs share: the later run's over the earlier one's.

    Its metric, such as `change_time_one_core[rig]`, names the kind of time (here the mean), the place and the rig's
    evaluation (here compiled).
    """
    after = list(after)
    earlier, later = (speed_ups_by_kind(rows) for rows in (before, after))
    profile, run = (after[0].profile, after[0].run) if after else ("", "")
    return [
        Row(
            "table3", character, name, f"{CHANGE}{kind}_{where}[{rig}]", "ratio", new / old, None, 1, None, profile, run
        )
        for kind in KINDS
        for (character, name, rig, where), new in later[kind].items()
        if (old := earlier[kind].get((character, name, rig, where)))
    ]


def agreement_table(rows: Iterable[Row]) -> Table | None:
    """Return how many speed-ups over the rig agree with the run before; None if there was none."""
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
    """Return the speed-ups over the rig of each method's best evaluation, by the kind of time (`KINDS`)."""
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
