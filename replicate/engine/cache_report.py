"""What the cache holds, and which of it can still be used."""

import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import Timeout

from replicate.base import jit_cache
from replicate.base.code_hash import sources_digest
from replicate.base.paths import ROOT, cache_folder
from replicate.engine import store
from replicate.engine.stage import Stage, in_order
from replicate.engine.store import MANIFEST, MARKER, artefact_folder, find_damage, lock, read_manifest

_IDENTIFIER = r"([\w.@-]+-[0-9a-f]{16})"  # as `Stage.identifier` makes them
_WORK_NAMES = {"partial": f"{_IDENTIFIER}@.+", "scratch": _IDENTIFIER, "logs": rf"{_IDENTIFIER}\.log"}
UP_TO_DATE = "up to date"
_LONGEST_LIST = 10  # items in a message; the others are counted


@dataclass(frozen=True)
class Entry:
    """A folder or log in the cache.

    state: "current", "stale" (sources have changed), "damaged" or "unfinished".
    identifier: that of its artefact; of a folder of kernels, its name.
    """

    folder: Path
    state: str
    size_bytes: int
    identifier: str


def inventory() -> list[Entry]:
    """Return everything that this suite has put into the cache; files are not hashed."""
    return _survey()[0]


def states(stages: list[Stage]) -> Iterator[tuple[Stage, str]]:
    """Yield the stages of a graph with "up to date", "missing" or "damaged: why".

    Only sizes are compared: hashing all files takes minutes, and every run does that anyway.
    """
    for stage in in_order(stages):
        folder = artefact_folder(stage.identifier)
        damage = find_damage(folder, in_full=False) if folder.exists() else ""
        yield stage, f"damaged: {damage}" if damage else UP_TO_DATE if folder.exists() else "missing"


def known_titles() -> set[str]:
    """Return the titles of all stages with an artefact in the cache, whatever its configuration and sources."""
    names = (re.fullmatch(_IDENTIFIER, folder.name) for folder in cache_folder().glob("*"))
    return {match[1].rpartition("-")[0] for match in names if match}


def clean(everything: bool = False) -> tuple[int, int]:
    """Remove what is stale, damaged or unfinished, or everything; return how many folders, and their bytes.

    Only what has a name of this suite's is removed, artefacts only with a valid seal, and only from a cache: a folder
    with the file `.replicate-cache`, or with nothing foreign in it. Links are neither removed nor followed. During a
    run, artefacts stay, as does what a stage is working on. Standard error lists what is left alone, with the reason.
    """
    cache = cache_folder()
    entries, left, foreign = _survey()
    if not (cache / MARKER).is_file() and (left or foreign):
        reason = f"it has no file {MARKER} and holds things that this suite has not made; to clean it, make that file"
        _tell({cache: reason})
        return 0, 0
    busy = store.is_in_use()
    sizes = []
    for entry in entries:
        is_artefact = entry.state in ("current", "stale")
        if entry.state == "current" and not everything:
            continue
        if is_artefact and busy:
            left[entry.folder] = "a run goes on in this cache: clean it again afterwards"
            continue
        try:
            with lock(entry.identifier, wait=False):
                _remove(entry.folder)
            sizes.append(entry.size_bytes)
        except Timeout:
            left[entry.folder] = "in use by a run"
        except OSError as error:
            left[entry.folder] = f"it can't be removed: {error.strerror}"
    _tell(left)
    return len(sizes), sum(sizes)


def _survey() -> tuple[list[Entry], dict[Path, str], list[Path]]:
    """Return the entries of the cache; what only looks like one, with the reason; and what is foreign."""
    entries, left, foreign = [], {}, []
    stale: dict[str, bool] = {}
    kernels = jit_cache.folder_name(jit_cache.kernel_sources())
    for item in sorted(cache_folder().glob("*")):
        wreck = re.fullmatch(f"damaged-{_IDENTIFIER}", item.name)
        if item.is_symlink():
            (left if item.name in _WORK_NAMES else {})[item] = "it is a link"
            foreign.append(item)
        elif item.name in _WORK_NAMES and item.is_dir():
            for inner in sorted(item.iterdir()):
                match = re.fullmatch(_WORK_NAMES[item.name], inner.name)
                if match and not inner.is_symlink():
                    entries.append(Entry(inner, "unfinished", _size_bytes(inner), match[1]))
                else:
                    left[inner] = "it is a link" if inner.is_symlink() else "this suite gives no such name"
        elif wreck and item.is_dir():
            entries.append(Entry(item, "damaged", _size_bytes(item), wreck[1]))
        elif re.fullmatch(jit_cache.FOLDER_NAME, item.name) and _holds_kernels(item):
            state = "current" if item.name == kernels else "stale"
            entries.append(Entry(item, state, _size_bytes(item), item.name))
        elif re.fullmatch(_IDENTIFIER, item.name) and store.is_sealed(item):
            state = "stale" if _is_stale(item.name, stale) else "current"
            entries.append(Entry(item, state, _size_bytes(item), item.name))
        elif (item / MANIFEST).is_file():
            left[item] = "it isn't an artefact of this suite, or it is damaged and no run has met it since"
        elif item.name not in store.WORKING_FOLDERS:
            foreign.append(item)
    return entries, left, foreign


def _holds_kernels(folder: Path) -> bool:
    """Return whether a folder holds nothing but compiled kernels, whole or half-written by a killed process."""
    name = rf"{jit_cache.FILE_NAME}|\.new-[0-9a-f]{{8}}-.+\.code"
    try:
        files = list(folder.iterdir())
    except OSError:
        return False
    return all(re.fullmatch(name, file.name) and file.is_file() and not file.is_symlink() for file in files)


def _is_stale(identifier: str, answers: dict[str, bool]) -> bool:
    """Return whether the sources of an artefact, or of its inputs, have changed or are gone.

    An input that is missing or damaged is not a reason: what was made from it is as good as before.
    """
    if identifier not in answers:
        answers[identifier] = False
        if store.is_sealed(folder := artefact_folder(identifier)):
            manifest = read_manifest(folder)
            inputs = manifest["inputs"].values()
            answers[identifier] = _has_changed(manifest) or any(_is_stale(name, answers) for name in inputs)
    return answers[identifier]


def _has_changed(manifest: dict) -> bool:
    """Return whether the sources behind an artefact differ from those it was made with.

    A function from outside the project may not be found just now; then nothing is said to have changed.
    """
    try:
        return sources_digest(manifest["function"]) != manifest["sources"]
    except SyntaxError:
        return False
    except ValueError:  # no such module or function
        return (ROOT / manifest["function"].partition(".")[0]).is_dir()


def _remove(item: Path) -> None:
    if item.is_symlink():
        raise OSError(0, "it has become a link")
    if item.is_dir():
        shutil.rmtree(item)
    else:
        item.unlink(missing_ok=True)


def _tell(left: dict[Path, str]) -> None:
    """Print what was left alone, one line for each reason."""
    for reason in dict.fromkeys(left.values()):
        items = [str(item) for item in left if left[item] == reason]
        others = f" and {len(items) - _LONGEST_LIST} more" if len(items) > _LONGEST_LIST else ""
        print(f"left alone: {', '.join(items[:_LONGEST_LIST])}{others} ({reason})", file=sys.stderr)


def _size_bytes(item: Path) -> int:
    size = 0
    for path in (item, *item.rglob("*")):
        with suppress(OSError):  # it has just been removed by somebody else
            size += path.lstat().st_size if path.is_file() and not path.is_symlink() else 0
    return size
