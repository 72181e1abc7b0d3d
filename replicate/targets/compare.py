"""The paper's numbers, the reference results and yours, side by side."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.config import check_profile
from replicate.methods.method_registry import in_order
from replicate.report.results import STANDS_FOR, Row, find, order_of, read_results
from replicate.report.tables import Table, paper_value, round_off
from replicate.timing.single_poses import CHANGE, label_of


def run(options: argparse.Namespace) -> None:
    """Print every table that the reference results or yours hold."""
    from replicate.cli.target_list import targets
    from replicate.report.tables import as_latex, as_text

    check_profile(options.profile)
    tables = [name for name, target in targets().items() if target.in_comparison]
    for table in compare_folders(paths.PAPER, paths.REFERENCE, paths.run_folder(options.profile), tables):
        print(as_latex(table) if options.latex else as_text(table))


# `make compare`: the paper's number, the reference result's, and yours, side by side.

SPREAD = tuple(f"{kind}_{cores}" for kind in ("median", "p05", "p95") for cores in ("one_core", "all_cores"))
TABLE1_NAMES = {"model": "Model", "dense_released": "Dense, 256 and 512"}  # what Table 1 calls what is no method of it


def compare(paper: Sequence[Row], reference: Sequence[Row], yours: Sequence[Row], table: str) -> Table:
    """Return one printed table: a line for every number of `table` that the reference results or yours have.

    The last column is yours over the reference's. Percentiles, maxima and brackets stay in the full tables, and so does
    what compares a run with the one before it.
    """
    keys = {row.key[1:]: row.unit for row in (*reference, *yours) if row.table == table and _has_line(row)}
    body: list[tuple[str, ...] | None] = []
    last = None
    order = in_order({method for _, method, _ in keys})
    for character, method, metric in sorted(keys, key=lambda key: _order(key, order)):
        group = (character,) if table == "table1" else (character, metric)  # counts and sizes stand together
        if last is not None and group != last:
            body.append(None)
        last = group
        theirs = find(paper, table, STANDS_FOR.get(character, ""), method, metric)
        old, new = (find(rows, table, character, method, metric) for rows in (reference, yours))
        unit = keys[character, method, metric]
        ratio = f"{new.value / old.value:.3f}" if old and new and old.value else "–"
        cells = (round_off(row.value, unit, row.sd) if row else "–" for row in (old, new))
        name = (TABLE1_NAMES.get(method) if table == "table1" else None) or label_of(method, marked=True)
        body.append((f"{character}, {name}, {metric} [{unit}]", paper_value(theirs), *cells, ratio))
    return Table(f"{table}: the paper's rig | the reference results | yours", (_header(reference, yours),), tuple(body))


def compare_folders(paper: Path, reference: Path, yours: Path, tables: Sequence[str]) -> list[Table]:
    """Return the comparison of every one of some tables, "table1" …, that `reference` or `yours` holds.

    Raises InputError, with the targets that make them, where `yours` holds none of them.
    """
    present = {folder: [t for t in tables if (folder / f"{t}.csv").is_file()] for folder in (reference, yours)}
    if not present[yours]:
        raise InputError(
            f"{yours}: there are no results of yours to compare yet; "
            f"{' or '.join(f'`make {table}`' for table in tables)} makes some."
        )
    comparisons = []
    for table in tables:
        if table in present[reference] or table in present[yours]:
            rows = (
                read_results(folder / f"{table}.csv") if table in present[folder] else []
                for folder in (reference, yours)
            )
            comparisons.append(compare(read_results(paper / f"{table}.csv"), *rows, table))
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


def _header(reference: Sequence[Row], yours: Sequence[Row]) -> tuple[str, ...]:
    profiles = (", ".join(sorted({row.profile for row in rows})) for rows in (reference, yours))
    old, new = (f" ({profile})" if profile else "" for profile in profiles)
    return "", "paper", f"reference{old}", f"yours{new}", "yours / reference"
