"""What is of no more use in the cache, removed."""

import argparse

from replicate.base import paths


def run(options: argparse.Namespace) -> None:
    """Remove what is stale, damaged or unfinished from the cache, or everything."""
    from replicate.engine.cache_report import clean

    count, size_bytes = clean(options.all)
    print(f"removed {count} folders, {size_bytes / 1e6:,.1f} MB, from {paths.cache_folder()}")
