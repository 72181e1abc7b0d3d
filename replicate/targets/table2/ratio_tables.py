"""What Table 2 says apart from millimetres: ratios between methods, and where on the face the errors are."""

from collections.abc import Iterable, Sequence

from replicate.methods.method_registry import in_order, method_named
from replicate.report.cast import STANDS_FOR, characters_of
from replicate.report.results import Row, find, most_seeds
from replicate.report.tables import Table, round_off

# (method, over which other, error): what a replication on another rig can compare, and our own measures of success.
RATIOS = (
    ("refined", "coarse", "vertex"),
    ("refined", "coarse", "normal"),
    ("refined", "dense", "vertex"),
    ("refined", "dense", "normal"),
    ("refined", "lbs32", "vertex"),
    ("refined", "lbs32", "normal"),
    ("coarse", "floor", "normal"),
    ("refined", "floor_refined", "normal"),
    ("refined", "neutral", "vertex"),
)
ERRORS = {"vertex": "distance", "normal": "normal angle"}
# (question, method, over which other, error): what README asks of all characters together.
QUESTIONS = (
    ("Does refinement help?", "refined", "coarse", "normal"),
    ("Are the normals of dense networks worse?", "dense", "refined", "normal"),
    ("Does LBS lose the wrinkles?", "lbs32", "refined", "normal"),
    ("Is LBS as close in distance?", "lbs32", "refined", "vertex"),
    ("How far does a straight line get in normals?", "linear", "refined", "normal"),
    ("And in distance?", "linear", "refined", "vertex"),
    ("Could the maps hold more than the networks learn?", "floor", "coarse", "normal"),
    ("Does our own method do better?", "regional", "refined", "normal"),
)
READING = (
    "Below 1 the first method has the smaller error. A column of the paper's has the ratios of its own numbers; it has "
    "no straight line, no floors and not our method."
)


def table2_ratios(ours: Sequence[Row], paper: Sequence[Row], character: str) -> Table:
    """Return ratios of mean errors beside the same ratios in the paper's own numbers."""
    columns = [(ours, character), *((paper, name) for who, name in STANDS_FOR.items() if who == character)]
    body = []
    for method, other, kind in RATIOS:
        ratios = [_ratio(rows, who, method, other, kind) for rows, who in columns]
        if ratios[0] is not None:
            label = f"{method_named(method).title} / {method_named(other).title}, {ERRORS[kind]}"
            body.append((label, *(round_off(ratio, "ratio") for ratio in ratios)))
    names = [name for _, name in columns]
    header = ("mean error of one method over another's", *names)
    return Table(f"Table 2 as ratios: {' beside '.join(names)}", (header,), tuple(body))


def table2_questions(ours: Sequence[Row], paper: Sequence[Row]) -> Table:
    """Return ratios of mean errors for all characters that stand for one of the paper's, each answering a question."""
    characters = [who for who in characters_of(ours) if who in STANDS_FOR]
    columns = [(rows, name) for who in characters for rows, name in ((ours, who), (paper, STANDS_FOR[who]))]
    body = []
    for question, method, other, kind in QUESTIONS:
        ratios = [_ratio(rows, name, method, other, kind) for rows, name in columns]
        if any(ratio is not None for ratio in ratios[::2]):
            what = f"{method_named(method).title} / {method_named(other).title}, {ERRORS[kind]}"
            body.append((question, what, *(round_off(ratio, "ratio") for ratio in ratios)))
    header = ("question", "ratio of mean errors", *(name for _, name in columns))
    return Table("Table 2 as ratios", (header,), tuple(body), (READING,), text_columns=2)


def _ratio(rows: Iterable[Row], character: str, method: str, other: str, kind: str) -> float | None:
    rows = list(rows)
    above, below = (find(rows, "table2", character, m, f"{kind}_error_mean") for m in (method, other))
    return above.value / below.value if above and below and below.value else None


def table2_segments(ours: Iterable[Row], character: str) -> Table:
    """Return each segment's mean vertex and normal error for every method, segments in the order of their names.

    Without spreads, which would make it wider than a page; a note says where they are.
    """
    rows = [row for row in ours if row.table == "table2_segments" and row.character == character]
    methods = [method for method in in_order({row.method for row in rows}) if method != "attachment"]
    names = sorted({row.metric.partition("[")[2].rstrip("]") for row in rows if "_error_" in row.metric})
    body: list[tuple[str, ...] | None] = []
    for kind, unit in (("vertex", "mm"), ("normal", "deg")):
        body += [None] if body else []
        for name in names:
            errors = (find(rows, "table2_segments", character, m, f"{kind}_error_mean[{name}]") for m in methods)
            cells = (round_off(row.value, unit) if row else "–" for row in errors)
            body.append((f"{name}, {unit}", *cells))
    header = (
        "",
        *(method_named(m).title.replace("LBS: ", "LBS ").replace(" bones", "").replace(", ", " ") for m in methods),
    )
    seeds = most_seeds(rows)
    notes = (f"Means over {seeds} seeds; their standard deviations are in table2.csv.",) if seeds > 1 else ()
    return Table(f"Table 2 by segment: {character}, mean errors", (header,), tuple(body), notes)
