"""Where things lie: the project, the recipes, the cache and the results."""

import os
from pathlib import Path

from replicate.base.exceptions import InputError
from replicate.base.schema import shown

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results"
PAPER = RESULTS / "paper"
REFERENCE = RESULTS / "reference"
PAPER_PROFILE = "reference_paper_profile"  # committed results of the profile `paper`, beside those of `laptop`
WHOLE_CLIPS = "reference_clips"  # and those of networks whose test poses are of whole clips, not of single frames
GPU_MACHINE = "reference_gpu"  # and Table 3 by a machine with a GPU
LONGEST_NAME = 255  # bytes of a file's name, on every file system in use


CACHE_VARIABLE, RESULTS_VARIABLE = "REPLICATE_CACHE", "REPLICATE_RESULTS"


def cache_folder() -> Path:
    """Return the folder of all artefacts: `$REPLICATE_CACHE`, else `.cache` in the project; it need not exist.

    Raises InputError for a variable that can't name a folder.
    """
    return named_folder(CACHE_VARIABLE) or ROOT / ".cache"


def run_folder(profile: str) -> Path:
    """Return the folder that a run with this profile writes to, in `$REPLICATE_RESULTS` or else results/runs.

    Raises InputError for a variable that can't name a folder.
    """
    return (named_folder(RESULTS_VARIABLE) or RESULTS / "runs") / profile


def committed_folders() -> dict[str, Path]:
    """Return the folders of committed results by name: those that texts quote, and what stands beside them."""
    return {"reference": REFERENCE} | {name: REFERENCE / name for name in (PAPER_PROFILE, WHOLE_CLIPS, GPU_MACHINE)}


def settle_folders(*others: str) -> None:
    """Make the folders that environment variables name absolute, for processes that work in another folder.

    others: variables beside those of the cache and the results.

    It is called once, when a command starts. Raises InputError for a variable that can't name a folder.
    """
    for variable in (CACHE_VARIABLE, RESULTS_VARIABLE, *others):
        if (folder := named_folder(variable)) is not None:
            os.environ[variable] = str(folder)


def named_folder(variable: str) -> Path | None:
    """Return the absolute path of the folder that an environment variable names, or None if it is not set."""
    name = os.environ.get(variable, "").strip()
    if not name:
        return None
    folder = Path(os.path.abspath(with_home(name, variable, "folder")))
    if any(len(os.fsencode(part)) > LONGEST_NAME for part in folder.parts):
        raise InputError(f"{variable}: expected a folder's path, got one with a name of more than {LONGEST_NAME} bytes")
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise InputError(f"{variable}: expected a folder, got {name}, which is something else")
    return Path(os.path.realpath(folder))


def with_home(text: str, what: str, kind: str = "file") -> Path:
    """Return a path with its ~ replaced by the home folder; raise InputError where there is no such home folder.

    what: the option or variable that names it, for messages.
    kind: "file" or "folder", for messages.
    """
    try:
        return Path(text).expanduser()
    except RuntimeError:  # ~nobody
        raise InputError(f"{what}: expected a {kind}'s path, got {shown(text)}: there is no such home folder") from None


def display_path(path: Path) -> str:
    """Return a path as messages show it: from the project's folder on, or whole if it lies elsewhere."""
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path)
