"""The laptop's numbers beside those of the paper's: how much is due to fewer samples and a shorter schedule?"""

from collections.abc import Sequence

from replicate.drawing.style import MEASURES
from replicate.engine import paths
from replicate.methods.method_registry import in_order, method_named
from replicate.report.cast import characters_of
from replicate.report.results import Row, find, read_results
from replicate.report.tables import Table, round_off
from replicate.targets.table2.character_part import ROWS

RATIOS = (("refined", "coarse"), ("refined", "dense"), ("regional", "refined"), ("regional", "dense"))


def paper_profile_rows(results: str) -> list[Row]:
    """Return the rows of the profile `paper` that belong to some results, none where there are none.

    results: "reference", or the profile of a run of yours.
    """
    folders = paths.committed_folders()
    folder = folders[paths.PAPER_PROFILE] if results in folders else paths.run_folder("paper")
    return read_results(folder / ROWS) if (folder / ROWS).is_file() else []


def profile_tables(rows: Sequence[Row], others: Sequence[Row]) -> list[Table]:
    """Return, for each character that both have, its errors with either profile: rows', and others'."""
    both = [name for name in characters_of(others) if name in characters_of(rows)]
    return [profile_table(rows, others, name) for name in both]


def profile_table(rows: Sequence[Row], others: Sequence[Row], character: str) -> Table:
    """Return both mean errors of each method and what its training takes, with either profile, and ratios of errors."""
    columns = (*((metric, label) for metric, _, label in MEASURES), ("training", "training, s"))
    body: list[tuple[str, ...] | None] = []
    for method in map(method_named, in_order({row.method for row in others})):
        both = [(metric, each) for metric, _ in columns for each in (rows, others)]
        cells = [find(each, "table2", character, method.name, metric) for metric, each in both]
        if all(cells[:4]):
            body.append((method.label, *(round_off(cell.value, cell.unit) if cell else "–" for cell in cells)))
    lines = [_ratios(rows, others, character, *pair) for pair in RATIOS]
    body += [None, *(line for line in lines if line)]
    profiles = [next(row.profile for row in each if row.character == character) for each in (rows, others)]
    spans = ("", *(cell for _, label in columns for cell in (label, "")))
    return Table(f"Two profiles: {character}", (spans, ("", *profiles * len(columns))), tuple(body))


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
