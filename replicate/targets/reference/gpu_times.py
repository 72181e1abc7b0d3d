"""Table 3 of a run on a machine with a GPU, among the committed results in a folder of its own."""

from pathlib import Path

from replicate.benchmarks.common import merge
from replicate.engine import paths
from replicate.engine.exceptions import InputError
from replicate.report import manifest
from replicate.report.results import read_results
from replicate.targets.table3 import FILE
from replicate.targets.table3.timing_rows import GRAPHICS

TARGET = "table3"


def is_of_gpu(run: Path) -> bool:
    """Return whether a run's Table 3 has times on a GPU. Raises InputError where some characters lack them."""
    rows = read_results(run / FILE) if (run / FILE).is_file() else []
    every = dict.fromkeys(row.character for row in rows)
    timed = {row.character for row in rows if row.metric == f"time_{GRAPHICS}"}
    if timed and (others := [name for name in every if name not in timed]):
        where = paths.display_path(run)
        raise InputError(f"{where}: Table 3 has no times on a GPU for {', '.join(others)}: publish these apart")
    return bool(timed)


def put_gpu_times(run: Path, into: Path) -> list[Path]:
    """Put a run's Table 3 into a folder, numbers and manifest; characters that it lacks stay. Return the file."""
    rows = read_results(run / FILE)
    characters = {row.character for row in rows}
    into.mkdir(parents=True, exist_ok=True)
    merge(into / FILE, rows, lambda row: row.character not in characters)
    entries = manifest.entries(into, TARGET) | manifest.entries(run, TARGET)
    manifest.write_entries(into, TARGET, dict(sorted(entries.items())))
    return [into / FILE]
