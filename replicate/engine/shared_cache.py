"""What a cache on a network file system needs: other machines see a new artefact a while after it was put in place."""

import os
import time
from collections.abc import Iterable
from pathlib import Path

VISIBLE_WITHIN_S = 90.0  # NFS looks again at a folder after 60 seconds at the latest, unless it is told otherwise


def not_visible(cache: Path, identifiers: Iterable[str], timeout_s: float = VISIBLE_WITHIN_S) -> list[str]:
    """Return which of these artefacts do not stand in a cache, seen from this machine, after waiting for them."""
    deadline = time.monotonic() + timeout_s
    while True:
        with os.scandir(cache) as entries:  # to read a folder makes NFS look at it anew
            standing = {entry.name for entry in entries}
        hidden = [identifier for identifier in identifiers if identifier not in standing]
        if not hidden or time.monotonic() >= deadline:
            return hidden
        time.sleep(0.5)
