"""The paper's numbers, the reference results and yours, side by side."""

import argparse

from replicate.engine import paths
from replicate.profiles import check_profile

ABOUT = "the paper's numbers, the reference results and yours, side by side"
WRITES = "printed"
OPTIONS = ("profile", "latex")


def run(options: argparse.Namespace) -> None:
    """Print every table that the reference results or yours hold."""
    from replicate.report.comparison import compare_folders
    from replicate.report.tables import as_latex, as_text
    from replicate.targets.target_registry import targets

    check_profile(options.profile)
    tables = [name for name, target in targets().items() if target.in_comparison]
    for table in compare_folders(paths.PAPER, paths.REFERENCE, paths.run_folder(options.profile), tables):
        print(as_latex(table) if options.latex else as_text(table))
