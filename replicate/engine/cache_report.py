"""What the cache holds, and which of it is still of use."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from replicate.engine.code_hash import sources_digest
from replicate.engine.paths import cache_folder
from replicate.engine.stage import Stage, in_order
from replicate.engine.store import MANIFEST, artefact_folder, find_damage, lock, read_manifest

_UNFINISHED = ("partial", "scratch", "logs")


@dataclass(frozen=True)
class Entry:
    """One folder of the cache; its state is "current", "stale" (sources have changed), "damaged" or "unfinished"."""

    folder: Path
    state: str
    size_bytes: int


def inventory() -> list[Entry]:
    """Return every folder of the cache that this suite has put there; files are not hashed."""
    found, stale = [], {}
    for folder in sorted(cache_folder().glob("*")):
        if folder.name.startswith("damaged-"):
            found.append(Entry(folder, "damaged", _size_bytes(folder)))
        elif folder.name in _UNFINISHED:
            found += [Entry(item, "unfinished", _size_bytes(item)) for item in sorted(folder.glob("*"))]
        elif (folder / MANIFEST).is_file():
            found.append(Entry(folder, "stale" if _is_stale(folder.name, stale) else "current", _size_bytes(folder)))
    return found


def _is_stale(identifier: str, known: dict[str, bool]) -> bool:
    """Return whether the sources of an artefact, or of what it was made from, have changed or are gone."""
    if identifier not in known:
        known[identifier] = True
        try:
            manifest = read_manifest(artefact_folder(identifier))
            changed = sources_digest(manifest["function"]) != manifest["sources"]
            known[identifier] = changed or any(_is_stale(needed, known) for needed in manifest["inputs"].values())
        except (OSError, KeyError, ValueError):
            pass
    return known[identifier]


def states(stages: list[Stage]) -> Iterator[tuple[Stage, str]]:
    """Yield the stages of a graph with "up to date", "missing" or "damaged: why"; every file is hashed."""
    for stage in in_order(stages):
        folder = artefact_folder(stage.identifier)
        damage = find_damage(folder) if folder.exists() else ""
        yield stage, f"damaged: {damage}" if damage else "up to date" if folder.exists() else "missing"


def clean(everything: bool = False) -> tuple[int, int]:
    """Remove what is stale, damaged or unfinished, or everything; return how many folders, of how many bytes."""
    removed = [entry for entry in inventory() if everything or entry.state != "current"]
    for entry in removed:
        with lock(entry.folder.name.removesuffix(".log").partition("@")[0]):
            if entry.folder.is_dir():
                shutil.rmtree(entry.folder)
            else:
                entry.folder.unlink(missing_ok=True)
    return len(removed), sum(entry.size_bytes for entry in removed)


def _size_bytes(path: Path) -> int:
    if path.is_file():
        return path.stat().st_size
    return sum(item.stat().st_size for item in path.rglob("*") if item.is_file())
