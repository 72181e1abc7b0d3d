"""Print Table 4: ours beside the paper's, and for each character what its IK networks are trained through."""

from collections.abc import Iterable, Mapping, Sequence

from replicate.inverse.ik_stage import RIG
from replicate.methods.method_registry import in_order, method_named
from replicate.report.results import STANDS_FOR, Row, characters_of, find, seeds_note
from replicate.report.tables import Table, our_value, paper_value
from replicate.targets.table2.rows import method_notes
from replicate.targets.table4.rows import COMPARED, FRESH_ENDING, INTERVAL, LIMITED, OWN

AS_GIVEN = {"": ""}
ENDINGS = AS_GIVEN | {LIMITED: ", within limits"}
WITHIN = (
    "Within limits: at the same parameters, each brought within the limits of its control. The rig's controls saturate "
    "at their limits; an approximation that has not seen parameters beyond them does not."
)
KINDS = (("vertex", "mm", "Distance error, mm"), ("normal", "deg", "Normal angle error, degrees"))
COLUMNS = (  # of the table about the IK networks: metric, unit, header
    ("point_error_mean", "mm", "points, mm"),
    ("point_error_mean[solver]", "mm", "by a solver, mm"),
    ("recovered_error_mean", "mm", "points of test poses, mm"),
    ("outside_limits", "ratio", "outside limits"),
    ("derivative_cosine", "ratio", "derivative: cosine"),
    ("derivative_size", "ratio", "derivative: size"),
)


def tables4(ours: Iterable[Row], paper: Sequence[Row]) -> list[Table]:
    """Return all tables: the paper's Table 4 with ours, then those of each character."""
    rows = [row for row in ours if row.table == "table4"]
    tables = [posing_table(rows, paper)]
    for character in characters_of(rows):
        its_rows = [row for row in rows if row.character == character]
        tables += [feeding_table(its_rows, character)]
        tables += [fresh_table(its_rows, character)] if any(FRESH_ENDING in row.metric for row in its_rows) else []
        tables += [networks_table(its_rows, character)]
    return tables


def posing_table(rows: Sequence[Row], paper: Sequence[Row], endings: Mapping[str, str] = ENDINGS) -> Table:
    """Return the paper's Table 4: mean errors in poses of inverse kinematics, of every character beside the paper's.

    endings: which errors it has; by default those within the controls' limits too.
    """
    characters = characters_of(rows)
    present = in_order({row.method for row in rows if row.metric in ("vertex_error_mean", "normal_error_mean")})
    body: list[tuple[str, ...] | None] = []
    for ending, addition in endings.items():
        for kind, _, words in KINDS:
            body += [None] if body else []
            body.append((words + addition, *[""] * (2 * len(characters))))
            for method in present:
                cells = [method_named(method).title]
                for character in characters:
                    mine = find(rows, "table4", character, method, f"{kind}_error_mean{ending}")
                    cells.append(our_value(mine))
                    theirs = STANDS_FOR.get(character, "")
                    cells.append(paper_value(find(paper, "table4", theirs, method, f"{kind}_error_mean{ending}")))
                body.append(tuple(cells))
    header = ("", *(name for character in characters for name in (character, STANDS_FOR.get(character, ""))))
    notes = (_about(rows), *((WITHIN,) if LIMITED in endings else ()), *method_notes(present))
    return Table("Table 4: errors in poses that inverse kinematics finds", (header,), tuple(body), notes)


def feeding_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's errors of every method, with a column for the poses of each source's IK networks."""
    sources = _sources(rows)
    methods = in_order({row.method for row in rows if row.metric.startswith("normal_error_mean[")})
    body: list[tuple[str, ...] | None] = []
    for ending, addition in ENDINGS.items():
        for kind, _, words in KINDS:
            body += [None] if body else []
            body.append((words + addition, *[""] * len(sources)))
            for method in methods:
                metric = f"{kind}_error_mean{ending}"
                found = [find(rows, "table4", character, method, f"{metric}[{source}]") for source in sources]
                cells = map(our_value, found)
                body.append((method_named(method).label, *cells))
    header = ("in poses of networks that are trained through", *map(source_label, sources))
    note = "A line is an approximation, a column the poses that it is measured in; both are compared with the rig."
    return Table(f"Who leads where: {character}", (header,), tuple(body), (note, _about(rows)))


def fresh_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's errors in drags that a script draws, and the CNN's beside those of dense networks."""
    start = f"vertex_error_mean{FRESH_ENDING}["
    ways = sorted({row.metric.removeprefix(start)[:-1] for row in rows if row.metric.startswith(start)}, key=_way_place)
    methods = in_order({row.method for row in rows if f"_error_mean{FRESH_ENDING}[" in row.metric})
    body: list[tuple[str, ...] | None] = []
    for kind, _, words in KINDS:
        body += [None] if body else []
        body.append((words, *[""] * len(ways)))
        for method in methods:
            found = [find(rows, "table4", character, method, f"{kind}_error_mean{FRESH_ENDING}[{way}]") for way in ways]
            cells = map(our_value, found)
            body.append((method_named(method).label, *cells))
        body.append((_ratio_words(), *(_ratio_cell(rows, character, kind, way) for way in ways)))
    header = (
        "in poses of networks that are trained through",
        *("the method itself" if w == OWN else source_label(w) for w in ways),
    )
    poses = max(row.poses or 0 for row in rows if row.metric.startswith(start))
    note = (
        f"{poses} drags that a script draws. Whatever gives the parameters, each is brought within the limits of its "
        "control. In brackets the 95 % interval of the ratio, by the bootstrap over drags: the networks are the same."
    )
    return Table(f"Fresh drags: {character}", (header,), tuple(body), (note,))


def _way_place(way: str) -> tuple[bool, bool]:
    return way != OWN, way == RIG


def _ratio_words() -> str:
    return " / ".join(method_named(method).label for method in COMPARED)


def _ratio_cell(rows: Sequence[Row], character: str, kind: str, way: str) -> str:
    found = [
        find(rows, "table4", character, COMPARED[0], f"{kind}_error_ratio{FRESH_ENDING}{ending}[{way}]")
        for ending in ("", *INTERVAL)
    ]
    if not all(found):
        return "–"
    ratio, low, high = (f"{row.value:.2f}" for row in found if row)
    return f"{ratio} ({low} to {high})"


def networks_table(rows: Sequence[Row], character: str) -> Table:
    """Return how well one character's IK networks work, with a line for each source that they are trained through."""
    body = []
    for source in _sources(rows):
        found = (find(rows, "table4", character, source, metric) for metric, *_ in COLUMNS)
        body.append((source_label(source), *map(our_value, found)))
    notes = (
        "points: how far the rig's control points are from where they shall go; most targets are beyond its reach.",
        "by a solver: the same where Eq. 8 is minimised anew for each configuration (L-BFGS, within the limits).",
        "points of test poses: the same for the control points of held-out poses, which the rig reaches exactly.",
        "outside limits: the share of the driven parameters that the networks set beyond their controls' limits.",
        "derivative: of the points by the parameters, against the rig's; 1 and 1 is the rig's own.",
        _about(rows),
    )
    header = ("trained through", *(words for *_, words in COLUMNS))
    return Table(f"The IK networks: {character}", (header,), tuple(body), notes)


def source_label(source: str) -> str:
    """Return the name of a source of IK networks in tables."""
    return "the rig itself" if source == RIG else method_named(source).label


def _sources(rows: Sequence[Row]) -> list[str]:
    names = {row.method for row in rows if row.metric == "point_error_mean"}
    return [*in_order(names - {RIG}), *(names & {RIG})]


def _about(rows: Sequence[Row]) -> str:
    poses = max((row.poses or 0 for row in rows if row.metric == "vertex_error_mean"), default=0)
    profiles = ", ".join(sorted({row.profile for row in rows}))
    return f"{poses} configurations of control points; {seeds_note(rows)}; profile {profiles}."
