"""Where things lie: the project, the recipes, the cache and the results."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RECIPES = ROOT / "data_recipes"
RESULTS = ROOT / "results"
PAPER = RESULTS / "paper"
REFERENCE = RESULTS / "reference"
OUTSIDE = {"ict": "ICT_FACEKIT"}  # characters whose data is not in the project → the variable that names its folder


def cache_folder() -> Path:
    """Return the folder of all artefacts: `$REPLICATE_CACHE`, else `.cache` in the project; it need not exist."""
    named = os.environ.get("REPLICATE_CACHE", "").strip()
    return Path(named).expanduser().resolve() if named else ROOT / ".cache"


def run_folder(profile: str) -> Path:
    """Return the folder that a run with this profile writes to, in `$REPLICATE_RESULTS` or else results/runs."""
    named = os.environ.get("REPLICATE_RESULTS", "").strip()
    return (Path(named).expanduser().resolve() if named else RESULTS / "runs") / profile


def character_names() -> tuple[str, ...]:
    """Return the names of the characters: one recipe file each, and those whose data a variable names."""
    outside = tuple(name for name, variable in OUTSIDE.items() if os.environ.get(variable, "").strip())
    return (*sorted(path.stem for path in RECIPES.glob("*.toml")), *outside)


def recipe_file(character: str) -> Path:
    """Return the recipe of a character, given by its name or as the path of a `.toml` file of one's own."""
    if character.endswith(".toml"):
        return Path(character).resolve()
    inner = RECIPES / character / f"{character}.toml"  # of a character whose data lies elsewhere
    return inner if inner.is_file() else RECIPES / f"{character}.toml"


def shown(path: Path) -> str:
    """Return a path as messages show it: from the project's folder on, or whole if it lies elsewhere."""
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path)
