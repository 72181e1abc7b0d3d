"""Table 3 by a machine with a GPU: its committed rows stand apart from those of the machine that texts quote."""

from collections.abc import Iterable
from dataclasses import replace

from replicate.engine import paths
from replicate.report.notebooks import rows_if_there
from replicate.report.results import Row
from replicate.targets.table3 import FILE

GPU_TABLE = "table3_gpu"  # its rows' table where they stand beside those of the other machine


def gpu_machine_rows(results: str) -> list[Row]:
    """Return Table 3 by the machine with a GPU of committed results; none for a run of yours, whose own table has it.

    results: "reference", or the profile of a run of yours.
    """
    return rows_if_there(paths.GPU_MACHINE, FILE) if results in paths.committed_folders() else []


def beside(rows: Iterable[Row]) -> list[Row]:
    """Return rows of that machine as those of a table of their own, to be looked up beside Table 3."""
    return [replace(row, table=GPU_TABLE) for row in rows]
