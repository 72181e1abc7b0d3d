"""Where things lie: the project, the cache and the results."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results"
PAPER = RESULTS / "paper"
REFERENCE = RESULTS / "reference"


def cache_folder() -> Path:
    """Return the folder of all artefacts: `$REPLICATE_CACHE`, else `.cache` in the project; it need not exist."""
    named = os.environ.get("REPLICATE_CACHE", "").strip()
    return Path(named).expanduser().resolve() if named else ROOT / ".cache"


def run_folder(profile: str) -> Path:
    """Return the folder that a run with this profile writes to, in `$REPLICATE_RESULTS` or else results/runs."""
    named = os.environ.get("REPLICATE_RESULTS", "").strip()
    return (Path(named).expanduser().resolve() if named else RESULTS / "runs") / profile


def shown(path: Path) -> str:
    """Return a path as messages show it: from the project's folder on, or whole if it lies elsewhere."""
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path)
