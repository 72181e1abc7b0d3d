"""Remove from the cache what is of no more use."""

import argparse

from replicate.base import paths
from replicate.engine.cache_report import clean


def run(options: argparse.Namespace) -> None:
    """Remove what is stale, damaged or unfinished from the cache, or everything."""
    count, size_bytes = clean(options.all)
    print(f"removed {count} folders, {size_bytes / 1e6:,.1f} MB, from {paths.cache_folder()}")
