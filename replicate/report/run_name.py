"""The name of a run, as results have it in the column `run`."""

import hashlib
from collections.abc import Mapping
from pathlib import Path


def run_name(inputs: Mapping[str, Path]) -> str:
    """Return the name of a run: a hash of the keys of the artefacts that its numbers come from."""
    return hashlib.sha256("\n".join(sorted(path.name for path in inputs.values())).encode()).hexdigest()[:12]
