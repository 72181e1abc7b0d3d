"""Table 2 beside itself: other charts, more samples and a longer schedule, and test poses of whole clips."""

from collections.abc import Sequence
from dataclasses import replace

from replicate.drawing.style import MEASURES
from replicate.engine import paths
from replicate.methods.method_registry import in_order, method_named
from replicate.report.cast import characters_of
from replicate.report.notebooks import rows_if_there
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off
from replicate.targets.table2.character_part import ROWS

RATIOS = (("refined", "coarse"), ("refined", "dense"), ("regional", "refined"), ("regional", "dense"))


def paper_profile_rows(results: str) -> list[Row]:
    """Return the rows of the profile `paper` that belong to some results, none where there are none.

    results: "reference", or the profile of a run of yours.
    """
    return rows_if_there(paths.PAPER_PROFILE if results in paths.committed_folders() else "paper", ROWS)


def clips_rows(results: str) -> list[Row]:
    """Return the rows of networks that are tested on whole clips, of committed results; none for a run of yours."""
    return rows_if_there(paths.WHOLE_CLIPS, ROWS) if results in paths.committed_folders() else []


def layout_tables(rows: Sequence[Row]) -> list[Table]:
    """Return, for each character that rows have with another layout of charts too, its errors with either layout."""
    tables, names = [], characters_of(rows)
    for name in names:
        character, _, layout = name.partition("@")
        if layout and not layout.isdecimal() and character in names:  # a number is a rung of the ladder
            others = [replace(row, character=character) for row in rows if row.character == name]
            layouts = ("its own charts", layout)
            tables.append(side_by_side(f"Two layouts of charts: {character}", rows, others, character, layouts))
    return tables


def profile_tables(rows: Sequence[Row], others: Sequence[Row]) -> list[Table]:
    """Return, for each character that both have, its errors with either profile: rows', and others'."""
    tables = []
    for name in _in_both(rows, others):
        profiles = [next(row.profile for row in each if row.character == name) for each in (rows, others)]
        tables.append(side_by_side(f"Two profiles: {name}", rows, others, name, profiles))
    return tables


def split_tables(rows: Sequence[Row], others: Sequence[Row]) -> list[Table]:
    """Return, for each character that both have, its errors by either split: of frames, and of clips."""
    splits = ("frames", "clips")
    return [side_by_side(f"Two splits: {name}", rows, others, name, splits) for name in _in_both(rows, others)]


def _in_both(rows: Sequence[Row], others: Sequence[Row]) -> list[str]:
    return [name for name in characters_of(others) if name in characters_of(rows)]


def side_by_side(title: str, rows: Sequence[Row], others: Sequence[Row], character: str, names: Sequence[str]) -> Table:
    """Return both mean errors of each method and what its training takes, of rows and others, and ratios of errors.

    names: what each of both is called.
    """
    columns = (*((metric, label) for metric, _, label in MEASURES), ("training", "training, s"))
    body: list[tuple[str, ...] | None] = []
    for method in map(method_named, in_order({row.method for row in others})):
        both = [(metric, each) for metric, _ in columns for each in (rows, others)]
        cells = [find(each, "table2", character, method.name, metric) for metric, each in both]
        if all(cells[:4]):
            body.append((method.label, *(round_off(cell.value, cell.unit) if cell else "–" for cell in cells)))
    lines = [_ratios(rows, others, character, *pair) for pair in RATIOS]
    body += [None, *(line for line in lines if line)]
    spans = ("", *(cell for _, label in columns for cell in (label, "")))
    return Table(title, (spans, ("", *names * len(columns))), tuple(body))


def _ratios(
    rows: Sequence[Row], others: Sequence[Row], character: str, above: str, below: str
) -> tuple[str, ...] | None:
    cells = []
    for metric, *_ in MEASURES:
        for each in (rows, others):
            ends = [find(each, "table2", character, method, metric) for method in (above, below)]
            if not all(ends):
                return None
            cells.append(round_off(ends[0].value / ends[1].value, "ratio"))
    return (f"{method_named(above).label} / {method_named(below).label}", *cells, "", "")
