"""Artefacts: content-addressed folders in the cache, each with a manifest of checksums.

    <cache>/<stage>-<key>/            an artefact: its files, manifest.json and manifest.sha256
    <cache>/damaged-<stage>-<key>/    one that failed its check, kept to be looked at
    <cache>/kernels-<hash>/           compiled code, see `base.jit_cache`
    <cache>/scratch/, locks/, logs/               unfinished work, by the same names
    <cache>/partial/<stage>-<key>@<host>-<pid>/   an artefact that this process is filling

An artefact is filled in `partial/` and renamed into place when its manifest is written, so that the cache holds only
complete ones. Every file is hashed in full whenever an artefact is loaded: sizes and times don't show a flipped bit,
and SHA-256 takes a second or two for a gigabyte.
"""

import contextlib
import errno
import hashlib
import json
import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from replicate.base.exceptions import InputError, RunError
from replicate.base.files import check_writable, shortage, shortage_number, write_text
from replicate.base.paths import cache_folder

MANIFEST = "manifest.json"
MARKER = ".replicate-cache"  # stands in every folder that has been used as a cache
WORKING_FOLDERS = ("partial", "scratch", "locks", "logs")
_SEAL = "manifest.sha256"
_RUN = "run@"  # how the names of whole runs' locks begin


def artefact_folder(identifier: str) -> Path:
    """Return the folder that an artefact has or will have."""
    return cache_folder() / identifier


def make_cache_folder() -> None:
    """Make the cache's folder, with the file that marks it; raise InputError if something in it can't be written."""
    cache = cache_folder()
    for folder in (cache, *(cache / name for name in WORKING_FOLDERS)):
        check_writable(folder, "REPLICATE_CACHE")
    for file in (cache / "locks").glob("*.lock"):
        check_lock(file)
    if not (cache / MARKER).is_file():
        write_text(cache / MARKER, "Artefacts of a replication of Fast and Deep Facial Deformations.\n")


def scratch_folder(identifier: str) -> Path:
    """Return where the checkpoints of an unfinished artefact are kept."""
    return cache_folder() / "scratch" / identifier


def log_file(identifier: str) -> Path:
    """Return the file with what the stage that makes this artefact printed."""
    return cache_folder() / "logs" / f"{identifier}.log"


def read_manifest(folder: Path) -> dict:
    """Return an artefact's manifest."""
    return json.loads((Path(folder) / MANIFEST).read_text(encoding="utf-8"))


def is_sealed(folder: Path) -> bool:
    """Return whether a folder is an artefact with the right name, whose manifest agrees with its checksum."""
    try:
        text = (folder / MANIFEST).read_bytes()
        if (folder / _SEAL).read_bytes() != _seal(text):
            return False
        manifest = json.loads(text)
        return f"{manifest['stage']}-{manifest['key']}" == folder.name
    except (OSError, ValueError, KeyError, TypeError):
        return False


def find_damage(folder: Path, in_full: bool = True) -> str:
    """Return "" if every file of an artefact agrees with its manifest, else what is wrong with one of them.

    in_full: whether files are hashed; otherwise only their sizes are compared.
    """
    try:
        text = (folder / MANIFEST).read_bytes()
        seal = (folder / _SEAL).read_bytes()
    except OSError as error:
        return f"{Path(error.filename).name} can't be read"
    if seal != _seal(text):
        return f"{MANIFEST} differs from its checksum"
    files = json.loads(text)["files"]
    with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
        by_size = sorted(files, key=lambda name: -files[name]["bytes"])
        findings = pool.map(lambda name: _compare(folder / name, files[name], in_full), by_size)
        return next((finding for finding in findings if finding), "")


def load(identifier: str) -> Path | None:
    """Return the folder of a verified artefact, or None if there is none.

    A damaged one is named on standard error and set aside as `damaged-…`, to be made again. Its checkpoints are
    removed, since they may have the same damage.
    """
    folder = artefact_folder(identifier)
    if not folder.exists():
        return None
    if not find_damage(folder):
        return folder
    with lock(identifier):  # another process may have found and mended it
        damage = find_damage(folder) if folder.exists() else ""
        if damage:
            aside = cache_folder() / f"damaged-{identifier}"
            shutil.rmtree(scratch_folder(identifier), ignore_errors=True)
            shutil.rmtree(aside, ignore_errors=True)
            os.replace(folder, aside)
            print(f"{folder}: damaged ({damage}); set aside as {aside.name}, to be made again", file=sys.stderr)
    return folder if folder.exists() else None


def make(identifier: str, build: Callable[[Path, Path], dict], waiting: Callable[[], None] = lambda: None) -> Path:
    """Return a verified artefact, made by `build` if there is none yet.

    build: (empty folder to fill, scratch folder that outlives a kill) → the facts for the manifest.
    waiting: called once if another process is making the same artefact, which is then waited for.

    Raises RunError when the disk is full; nothing half-written is left in place.
    """
    partial = _partial_folder(identifier, os.getpid(), cache_folder())
    scratch = scratch_folder(identifier)
    with _tell_if_full(identifier), lock(identifier, waiting):
        if load(identifier) is None:
            _discard_partials(identifier)
            try:
                partial.mkdir(parents=True)
                scratch.mkdir(parents=True, exist_ok=True)
                facts = build(partial, scratch)
                _write_manifest(partial, facts)
                _put_in_place(partial, identifier)
            except BaseException:
                shutil.rmtree(partial, ignore_errors=True)
                raise
        shutil.rmtree(scratch, ignore_errors=True)
    return artefact_folder(identifier)


def discard_partial(identifier: str, pid: int, cache: Path) -> None:
    """Remove the unfinished artefact of a process of this machine that has ended."""
    shutil.rmtree(_partial_folder(identifier, pid, cache), ignore_errors=True)


def lock(
    identifier: str, waiting: Callable[[], None] = lambda: None, wait: bool = True
) -> contextlib.AbstractContextManager[None]:
    """Return a context manager that holds an artefact's lock; arguments and errors are those of `hold`."""
    return hold(cache_folder() / "locks" / f"{identifier}.lock", waiting, wait)


@contextlib.contextmanager
def used_by_a_run() -> Iterator[None]:
    """Hold a lock that tells other processes that a run uses this cache, also between two of its stages."""
    name = f"{_RUN}{platform.node()}-{os.getpid()}"
    try:
        with lock(name):
            yield
    finally:
        (cache_folder() / "locks" / f"{name}.lock").unlink(missing_ok=True)


def is_in_use() -> bool:
    """Return whether another process holds one of the cache's locks."""
    for file in sorted((cache_folder() / "locks").glob("*.lock")):
        try:
            with lock(file.stem, wait=False):
                if file.name.startswith(_RUN):
                    file.unlink(missing_ok=True)  # left by a killed run
        except Timeout:
            return True
    return False


@contextlib.contextmanager
def _tell_if_full(identifier: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        short = shortage(error, cache_folder())
        if not short:
            raise
        raise RunError(f"{identifier}: {short}, then run the same command; finished work is kept") from error


def _put_in_place(partial: Path, identifier: str) -> None:
    """Rename a complete folder into the cache, unless another machine has put the same artefact there by now.

    Locks keep processes of one machine apart; on some network file systems other machines don't see them.
    """
    try:
        os.replace(partial, artefact_folder(identifier))
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        if load(identifier) is None:  # theirs was damaged, and `load` has set it aside
            os.replace(partial, artefact_folder(identifier))
        shutil.rmtree(partial, ignore_errors=True)


def _partial_folder(identifier: str, pid: int, cache: Path) -> Path:
    return cache / "partial" / f"{identifier}@{platform.node()}-{pid}"


def _discard_partials(identifier: str) -> None:
    """Remove what killed processes of this machine have left of an artefact, whose lock is held."""
    for folder in (cache_folder() / "partial").glob(f"{identifier}@{platform.node()}-*"):
        shutil.rmtree(folder, ignore_errors=True)


def _write_manifest(folder: Path, facts: dict) -> None:
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    files = {name: {"bytes": (folder / name).stat().st_size, "sha256": _digest(folder / name)} for name in names}
    text = (json.dumps({**facts, "files": files}, indent=1, ensure_ascii=False) + "\n").encode()
    (folder / MANIFEST).write_bytes(text)
    (folder / _SEAL).write_bytes(_seal(text))


def _seal(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest().encode() + b"\n"


def _compare(file: Path, facts: dict, in_full: bool) -> str:
    try:
        if file.stat().st_size != facts["bytes"]:
            return f"{file.name} has {file.stat().st_size} bytes instead of {facts['bytes']}"
        return "" if not in_full or _digest(file) == facts["sha256"] else f"{file.name} differs from its checksum"
    except OSError:
        return f"{file.name} can't be read"


def _digest(file: Path) -> str:
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


# Locks between processes, as files; the system frees a lock when its process dies.


def check_lock(file: Path) -> None:
    """Raise InputError if something other than a file has a lock's name."""
    if file.exists() and not file.is_file():
        raise InputError(f"{file}: expected a lock's file, got a folder: remove it")


@contextmanager
def hold(file: Path, waiting: Callable[[], None] = lambda: None, wait: bool = True) -> Iterator[None]:
    """Hold a lock; the same process may hold it twice.

    waiting: called once if another process holds it.
    wait: whether to wait for that process; otherwise filelock's Timeout is raised.

    Raises InputError if the file can't be a lock.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file_lock = FileLock(file, is_singleton=True)
        file_lock.acquire(timeout=0)
    except Timeout:
        if not wait:
            raise
        waiting()
        file_lock.acquire(poll_interval=0.2)
    except OSError as error:
        if shortage_number(error, file.parent):
            raise
        raise InputError(f"{file} can't be locked ({error.strerror}): remove it, or name another folder") from None
    try:
        yield
    finally:
        file_lock.release()
