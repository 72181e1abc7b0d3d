"""Table 3's second question: the same weights, evaluated in several ways. What does each take?"""

from collections.abc import Sequence

from replicate.report.results import Row, find
from replicate.report.tables import Table
from replicate.targets.table3.best_times import best_row, cell
from replicate.targets.table3.timing_rows import ALL, GRAPHICS, ONE
from replicate.timing.timed_names import (
    BACKENDS,
    EXACT,
    FAST,
    GPU,
    GRAPH,
    HALF,
    JAX,
    ONNX,
    ONNX_SPINNING,
    ONNX_THREADS,
    PLAIN,
    THREADED,
    in_table_order,
    label_of,
    parted,
)

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
    """Return tables of one character's milliseconds a pose by backend, or none where there is one backend only.

    The first is that of one core, where it is measured. That of all cores is there too if a backend divides its work,
    and that of a GPU if one was timed.
    """
    own = [row for row in rows if row.table == "table3" and row.character == character]
    several = {where: {row.method for row in own if row.metric == f"time_{where}"} for where in WHERE}
    divided = any(parted(name)[1] in THREADED for name in several[ALL])
    shown = [ONE, ALL] if several[ONE] and divided else [ONE if several[ONE] else ALL]
    shown += [GRAPHICS] if several[GRAPHICS] else []
    tables = (_backends_table(own, character, where) for where in shown)
    return [table for table in tables if table]


def _backends_table(own: Sequence[Row], character: str, where: str) -> Table | None:
    timed = [row for row in own if row.metric == f"time_{where}"]
    several = {parted(row.method)[0] for row in timed if parted(row.method)[1]}
    columns = [ending for ending in COLUMNS if any(name + ending in {row.method for row in timed} for name in several)]
    if not several:
        return None
    body = []
    for name in in_table_order(several):
        times = [find(timed, "table3", character, name + ending, f"time_{where}") for ending in columns]
        eager = next(row for row in times if row)  # plain torch where it differs from the suite's
        best = best_row(timed, character, name, where)
        body.append((label_of(name), *(cell(own, row, where) for row in times), f"{eager.value / best.value:.1f}"))
    header = ("", *(BACKENDS[ending] for ending in columns), "best over torch")
    rigid = "the rigid step on the CPU" if where == GRAPHICS else "the rigid step with them"
    notes = (
        f"Means on {WHERE[where]}, {rigid}.",
        *(ABOUT[ending].format(_largest(own, ending)) for ending in columns),
        f"Best over torch: plain torch, or the suite's where there is none, over the best that keeps within "
        f"{_largest(own, *filter(None, EXACT))} mm of the suite's vertices.",
    )
    title = f"Backends of {character} on {WHERE[where]}: milliseconds a pose by way to evaluate the same weights"
    return Table(title, (header,), tuple(body), notes)


def _largest(rows: Sequence[Row], *endings: str) -> str:
    """Return the largest difference from the suite's vertices that some backends have."""
    differences = [row.value for row in rows if row.metric == "largest_difference" and parted(row.method)[1] in endings]
    return f"{max(differences):.1g}" if differences else "1e-3"
