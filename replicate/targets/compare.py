"""Compare the paper's numbers, the reference results and yours, side by side."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.cli.target_list import targets
from replicate.config import check_profile
from replicate.methods.method_registry import in_order
from replicate.report.results import STANDS_FOR, Row, find, order_of, read_results
from replicate.report.tables import Table, as_latex, as_text, our_value, paper_value
from replicate.timing.single_poses import CHANGE, label_of


def run(options: argparse.Namespace) -> None:
    """Print a table for every target with results of yours; with `all` also for those of the reference alone."""
    check_profile(options.profile)
    tables = [name for name, target in targets().items() if target.in_comparison]
    folders = paths.PAPER, paths.REFERENCE, paths.run_folder(options.profile)
    for table in compare_folders(*folders, tables, options.all):
        print(as_latex(table) if options.latex else as_text(table))


# `make compare`: the paper's number, the reference result's, and yours, side by side.

SPREAD = tuple(f"{kind}_{cores}" for kind in ("median", "p05", "p95") for cores in ("one_core", "all_cores"))
TABLE1_NAMES = {"model": "Model", "dense_released": "Dense, 256 and 512"}  # lines of Table 1 that are no methods


def compare(
    paper: Sequence[Row], reference: Sequence[Row], yours: Sequence[Row], table: str, everything: bool = False
) -> Table:
    """Compare one table: a line for each of your numbers, those of new characters first.

    The last column is yours over the reference's. Percentiles, maxima and changes since the run before are left out.

    paper: the paper's rows
    reference: the rows of the reference results
    yours: the rows of your run
    table: the name of the table, "table1"
    everything: show numbers by region or source, metric[region], too, and those of the reference alone after yours;
        otherwise a note says how many lines that would be
    """
    your_units, reference_units = (
        {row.key[1:]: row.unit for row in rows if row.table == table and _has_line(row)} for rows in (yours, reference)
    )
    units = reference_units | your_units
    shown = [key for key in units if everything or (key in your_units and "[" not in key[2])]
    old_characters = {character for character, _, _ in reference_units}
    order = in_order({method for _, method, _ in shown})

    def place(key: tuple[str, str, str]) -> tuple:
        return key not in your_units, key[0] in old_characters, *_order(key, order)

    body: list[tuple[str, ...] | None] = []
    last, seen = "", []
    for key in sorted(shown, key=place):
        character, method, metric = key
        named = f"{metric} [{units[key]}]"
        heading = character if table == "table1" else f"{character}, {named}"  # counts and sizes stand together
        if heading != last:
            body += [None] * bool(body) + [(heading, "", "", "", "")]
        last = heading
        published = find(paper, table, STANDS_FOR.get(character, ""), method, metric)
        old, new = (find(rows, table, character, method, metric) for rows in (reference, yours))
        seen.append((old, new))
        ratio = f"{new.value / old.value:.3f}" if old and new and old.value else "–"
        cells = map(our_value, (old, new))
        name = f"{TABLE1_NAMES.get(method) or label_of(method, marked=True)}, {named}" if table == "table1" else ""
        body.append((f"  {name or label_of(method, marked=True)}", paper_value(published), *cells, ratio))
    title = f"{table}: the paper's rig | the reference results | yours"
    return Table(title, _headers(seen), tuple(body), _left_out(your_units, reference_units, shown))


def _left_out(your_units: Mapping, reference_units: Mapping, shown: Sequence) -> tuple[str, ...]:
    """Return a note on how many rows a table leaves out and how to see them; none where it shows all."""
    lacking, finer = len(reference_units.keys() - your_units.keys()), len(your_units.keys() - set(shown))
    parts = [f"{lacking:,} rows of the reference that yours lacks"] * bool(lacking)
    parts += [f"{finer:,} of yours by region or source"] * bool(finer)
    return (
        (f"Left out: {' and '.join(parts)}; ALL=1 shows them.",)
        if len(shown) < len({*your_units, *reference_units})
        else ()
    )


def compare_folders(
    paper: Path, reference: Path, yours: Path, tables: Sequence[str], everything: bool = False
) -> list[Table]:
    """Compare each table that you have results of. Raises InputError, with the targets that make some, for none.

    paper: the folder with the paper's numbers
    reference: the folder of the reference results
    yours: the folder of your run
    tables: names of tables, "table1" …
    everything: compare tables that `reference` alone holds too, with all of their rows
    """
    present = {folder: [t for t in tables if (folder / f"{t}.csv").is_file()] for folder in (reference, yours)}
    if not present[yours]:
        raise InputError(
            f"{yours}: there are no results to compare yet; "
            f"{' or '.join(f'`make {table}`' for table in tables)} makes some."
        )
    comparisons = []
    for table in tables:
        if table in present[yours] or (everything and table in present[reference]):
            rows = (
                read_results(folder / f"{table}.csv") if table in present[folder] else []
                for folder in (reference, yours)
            )
            comparisons.append(compare(read_results(paper / f"{table}.csv"), *rows, table, everything))
    return comparisons


def _has_line(row: Row) -> bool:
    return (
        not row.metric.endswith(("_p95", "_max", "_left_out", "_least", "_most", *SPREAD))
        and not row.metric.startswith(CHANGE)
        and "texels" not in row.metric
    )


def _order(key: tuple[str, str, str], order: Sequence[str]) -> tuple:
    character, method, metric = key
    place = order.index(method) if method in order else len(order)
    return order_of(character), metric != "vertex_error_mean", metric, place, method


def _headers(seen: Sequence[tuple[Row | None, Row | None]]) -> tuple[tuple[str, ...], ...]:
    """Return the two header rows: whose numbers the columns hold, and the profiles of the rows that are shown."""
    old, new = (", ".join(sorted({row.profile for row in rows if row})) for rows in zip(*seen, strict=True))
    return ("", "paper", "reference", "yours", "yours /"), ("", "", old, new, "reference")
