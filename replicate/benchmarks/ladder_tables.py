"""The ladder's numbers as tables: the errors on each rig of a head, and the ratios that claims are about."""

from collections.abc import Sequence

from replicate.methods.method_registry import in_order, method_named
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off

TABLE = "bench_ladder"
UNIFORM, ONE_FACE, CLIPS, RAW = "uniform", "one_face", "clips", "raw"
APART = (UNIFORM, ONE_FACE, CLIPS, RAW)  # no steps of the ladder: a whole rig with other charts or poses
RUNGS = {  # of a ladder → what its rig adds to the one before, or what its poses are
    "1": "targets",
    "2": "+ pairs",
    "3": "+ turns",
    "4": "+ flesh",
    "5": "+ wrinkles",
    "6": "shorter wrinkles",
    UNIFORM: "uniform poses",
    ONE_FACE: "@5, the face in one chart",
    CLIPS: "@5, clips held out",
    RAW: "clips, raw animation",
}
ERRORS = {"vertex_error_mean": ("mm", "Distance error, mm"), "normal_error_mean": ("deg", "Normal error, degrees")}
RATIOS = (  # (what, method, over which other)
    ("C1: refined over coarse", "refined", "coarse"),
    ("C2: refined over dense", "refined", "dense"),
    ("C3: refined over LBS with 32 bones", "refined", "lbs32"),
    ("refined over a straight line", "refined", "linear"),
    ("ours over refined", "regional", "refined"),
    ("ours over dense", "regional", "dense"),
    ("ours over a straight line", "regional", "linear"),
)


def rungs_of(rows: Sequence[Row], head: str) -> list[str]:
    """Return the rungs of a head's ladder that some rows are of, in its order."""
    present = {row.character for row in rows if row.table == TABLE}
    return [rung for rung in RUNGS if f"{head}@{rung}" in present]


def ladder_tables(rows: Sequence[Row], head: str) -> list[Table]:
    """Return a head's errors on each rung of its ladder, and ratios of them that claims and bounds are about."""
    rungs = rungs_of(rows, head)
    values = {
        (method, metric, rung): row
        for method in in_order({row.method for row in rows if row.table == TABLE})
        for metric in ERRORS
        for rung in rungs
        if (row := find(rows, TABLE, f"{head}@{rung}", method, metric))
    }
    methods = list(dict.fromkeys(method for method, _, _ in values))
    header = ("", *(RUNGS[rung] if rung in APART else f"@{rung} {RUNGS[rung]}" for rung in rungs))
    errors: list[tuple[str, ...] | None] = []
    ratios: list[tuple[str, ...] | None] = []
    for metric, (unit, words) in ERRORS.items():
        errors += [None] if errors else []
        errors.append((words, *("" for _ in rungs)))
        for method in methods:
            cells = (values.get((method, metric, rung)) for rung in rungs)
            errors.append((method_named(method).title, *(round_off(row.value if row else None, unit) for row in cells)))
        ratios += [None] if ratios else []
        ratios.append((words.partition(",")[0], *("" for _ in rungs)))
        for question, method, other in RATIOS:
            pairs = [(values.get((method, metric, rung)), values.get((other, metric, rung))) for rung in rungs]
            if any(above and below for above, below in pairs):
                ratios.append((question, *map(_ratio, pairs)))
    poses = sorted({row.poses for row in values.values() if row.poses})
    count = f"{poses[0]:,}" if len(poses) == 1 else f"{poses[0]:,} to {poses[-1]:,}" if poses else "no"
    notes = (f"{count} test poses; one seed; a part of the profile's steps.",)
    return [
        Table(f"The ladder of {head}: mean errors", (header,), tuple(errors), notes),
        Table(f"The ladder of {head}: ratios", (header,), tuple(ratios), ("Below 1 the first has the smaller error.",)),
    ]


def _ratio(pair: tuple[Row | None, Row | None]) -> str:
    above, below = pair
    return round_off(above.value / below.value if above and below and below.value else None, "ratio")
