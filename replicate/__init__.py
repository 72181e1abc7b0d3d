"""The paper: *Fast and Deep Facial Deformations*, a module an idea."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas


def results(run: str = "reference") -> "pandas.DataFrame":
    """Return all results of a run as one tidy DataFrame, a number a row, with the columns of results/README.md.

    run: a profile, "quick", "laptop" or "paper", for your run with it; "bench" for your benchmarks; "reference" for the
    results that the project comes with; "published" for the paper's own. Raises InputError for another name, with the
    `make` target that writes them for results that aren't there, and with file and line for a file of anything else.
    """
    from replicate.report.tidy_results import read_run  # not before it is asked for: it loads pandas

    return read_run(run)
