"""The paper's numbers, the reference results and yours, side by side."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.config import check_profile
from replicate.methods.method_registry import in_order
from replicate.report.results import STANDS_FOR, Row, find, order_of, read_results
from replicate.report.tables import Table, paper_value, round_off
from replicate.timing.single_poses import CHANGE, label_of


def run(options: argparse.Namespace) -> None:
    """Print a table for every target that you have results of; with `all` for those of the reference too."""
    from replicate.cli.target_list import targets
    from replicate.report.tables import as_latex, as_text

    check_profile(options.profile)
    tables = [name for name, target in targets().items() if target.in_comparison]
    folders = paths.PAPER, paths.REFERENCE, paths.run_folder(options.profile)
    for table in compare_folders(*folders, tables, options.all):
        print(as_latex(table) if options.latex else as_text(table))


# `make compare`: the paper's number, the reference result's, and yours, side by side.

SPREAD = tuple(f"{kind}_{cores}" for kind in ("median", "p05", "p95") for cores in ("one_core", "all_cores"))
TABLE1_NAMES = {"model": "Model", "dense_released": "Dense, 256 and 512"}  # what Table 1 calls what is no method of it


def compare(
    paper: Sequence[Row], reference: Sequence[Row], yours: Sequence[Row], table: str, everything: bool = False
) -> Table:
    """Return one printed table: a line for every number of `table` that yours has, those of new characters first.

    The last column is yours over the reference's. Percentiles, maxima and brackets stay in the full tables, and so does
    what compares a run with the one before it. everything: numbers by region or source, as metric[region], have lines
    too, and those of the reference alone come after yours; otherwise a note says how many lines that is.
    """
    own, theirs = (
        {row.key[1:]: row.unit for row in rows if row.table == table and _has_line(row)} for rows in (yours, reference)
    )
    units = theirs | own
    shown = [key for key in units if everything or (key in own and "[" not in key[2])]
    old_characters = {character for character, _, _ in theirs}
    order = in_order({method for _, method, _ in shown})

    def place(key: tuple[str, str, str]) -> tuple:
        return key not in own, key[0] in old_characters, *_order(key, order)

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
        cells = (round_off(row.value, units[key], row.sd) if row else "–" for row in (old, new))
        name = f"{TABLE1_NAMES.get(method) or label_of(method, marked=True)}, {named}" if table == "table1" else ""
        body.append((f"  {name or label_of(method, marked=True)}", paper_value(published), *cells, ratio))
    title = f"{table}: the paper's rig | the reference results | yours"
    return Table(title, _headers(seen), tuple(body), _left_out(own, theirs, shown))


def _left_out(own: Mapping, theirs: Mapping, shown: Sequence) -> tuple[str, ...]:
    """Return how many rows a table leaves out, and how to see them, as a note; none where it has all."""
    lacking, finer = len(theirs.keys() - own.keys()), len(own.keys() - set(shown))
    parts = [f"{lacking:,} rows of the reference that yours lacks"] * bool(lacking)
    parts += [f"{finer:,} of yours by region or source"] * bool(finer)
    return (f"Left out: {' and '.join(parts)}; ALL=1 shows them.",) if len(shown) < len({*own, *theirs}) else ()


def compare_folders(
    paper: Path, reference: Path, yours: Path, tables: Sequence[str], everything: bool = False
) -> list[Table]:
    """Return the comparison of every one of some tables, "table1" …, that `yours` holds.

    everything: also of those that `reference` alone holds, and with all rows of it. Raises InputError, with the targets
    that make them, where `yours` holds none of them.
    """
    present = {folder: [t for t in tables if (folder / f"{t}.csv").is_file()] for folder in (reference, yours)}
    if not present[yours]:
        raise InputError(
            f"{yours}: there are no results of yours to compare yet; "
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
    """Return what stands above the columns: whose numbers they are, and of which profile those that are shown."""
    old, new = (", ".join(sorted({row.profile for row in rows if row})) for rows in zip(*seen, strict=True))
    return ("", "paper", "reference", "yours", "yours /"), ("", "", old, new, "reference")
