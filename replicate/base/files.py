"""Files that are whole or absent: written beside their place and renamed, or sealed by a checksum; and full disks."""

import errno
import hashlib
import os
import resource
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TypeVar

from replicate.base.exceptions import InputError, RunError
from replicate.base.paths import CACHE_VARIABLE, RESULTS_VARIABLE, cache_folder, run_folder


@contextmanager
def replacing(file: Path, durable: bool = False) -> Iterator[Path]:
    """Yield a path to write to, which replaces `file` when the block ends and is removed if the block fails.

    durable: wait until the contents are on the disk; otherwise a power cut could leave the new name with half of them.

    The path is `.new-…-<name>` beside `file` and has its ending, since some writers look at that. Raises OSError, which
    names `file`, where it can't be written, with an error number where the disk is full.
    """
    file = Path(file)
    new = file.with_name(f".new-{os.urandom(4).hex()}-{file.name[-60:]}")  # a folder's names end at 255 bytes
    try:
        yield new
        if durable:
            with open(new, "rb") as stream:
                os.fsync(stream.fileno())
        os.replace(new, file)
    except OSError as error:
        code = shortage_number(error, file.parent) or error.errno
        if error.filename not in (None, str(new)) or code is None:
            raise
        raise OSError(code, os.strerror(code), str(file)) from error
    finally:
        with suppress(OSError):
            new.unlink()


def write_bytes(file: Path, data: bytes, durable: bool = False) -> None:
    """Write a file of bytes, whole or not at all."""
    with replacing(file, durable) as new:
        new.write_bytes(data)


def write_text(file: Path, text: str, durable: bool = False) -> None:
    """Write a text in UTF-8, its line ends as they are, whole or not at all."""
    write_bytes(file, text.encode("utf-8"), durable)


def copy_file(source: Path, target: Path) -> None:
    """Copy a file's contents, whole or not at all."""
    with replacing(target) as new:
        shutil.copyfile(source, new)


# Checkpoints that begin with a checksum of what follows: a damaged one is reported and not used.

Contents = TypeVar("Contents")
_BEGIN, _END = b"sha256:", b"\n"
_SEAL_BYTES = len(_BEGIN) + 64 + len(_END)


def write_sealed(file: Path, write: Callable[[BinaryIO], object], durable: bool = True) -> None:
    """Write a file whose first line is a checksum of the rest; even after a power cut it is whole or absent.

    write: writes the contents to the binary stream that it is called with.
    durable: as for `replacing`; without it, a power cut may leave a damaged file, which the checksum tells.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file, durable) as new, open(new, "w+b") as stream:
        stream.write(b" " * _SEAL_BYTES)
        write(stream)
        seal = _seal(stream)
        stream.seek(0)
        stream.write(seal)


def read_sealed(file: Path, read: Callable[[BinaryIO], Contents]) -> Contents | None:
    """Return the contents of a sealed file, or None if it is missing or damaged; damage is told on standard error.

    read: reads the contents from the binary stream that it is called with.
    """
    try:
        with open(file, "rb") as stream:
            if _seal(stream) == _first_line(stream):
                return read(stream)
        damage = "differs from its checksum"
    except FileNotFoundError:
        return None
    except OSError as error:
        damage = f"can't be read: {error.strerror}"
    print(f"{file}: damaged ({damage}); the work is done again from the last sound state", file=sys.stderr, flush=True)
    return None


def _seal(stream: BinaryIO) -> bytes:
    stream.seek(_SEAL_BYTES)
    return _BEGIN + hashlib.file_digest(stream, "sha256").hexdigest().encode() + _END


def _first_line(stream: BinaryIO) -> bytes:
    """Read the seal at the beginning of a stream."""
    stream.seek(0)
    return stream.read(_SEAL_BYTES)


# A full disk: which errors mean that, and a sentence that names the folder and the remedy.

_NEARLY_FULL_BYTES = 32 << 20  # below this, a write that failed without a reason failed for lack of space
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def shortage_number(error: BaseException, folder: Path | None = None) -> int | None:
    """Return ENOSPC, EDQUOT or EFBIG if a file found no room, as the error says or the free space shows, else None.

    folder: where the file should have been written; used where the error names no file.
    """
    if isinstance(error, (InputError, RunError)):
        return None
    for code in _NO_ROOM:
        if os.strerror(code) in str(error):  # some libraries lose the error number
            return code
    if not isinstance(error, OSError):
        return None
    if error.errno in _NO_ROOM:
        return error.errno
    if error.errno is None and free_bytes(folder or cache_folder()) < _NEARLY_FULL_BYTES:
        return errno.ENOSPC
    if error.errno is None and " requested and " in str(error):  # numpy's words for a short write
        return errno.EFBIG if _limit() else errno.ENOSPC
    return None


def shortage(error: BaseException, folder: Path | None = None) -> str:
    """Return "" unless a file found no room, else a sentence that names the full folder or the limit, and the remedy.

    folder: where the file should have been written; used where the error names no file.
    """
    code = shortage_number(error, folder)
    if code is None:
        return ""
    named = _named_folder(error)
    if code == errno.EFBIG:
        limit = f" of {_limit() >> 10} KB" if _limit() else ""
        return f"a file would be larger than allowed{_at(named or folder)}: raise the limit{limit} with `ulimit -f`"
    folder = named or next(filter(_is_full, [folder, *_roots().values()]), folder)
    if code == errno.EDQUOT:
        return f"your quota is used up{_at(folder)}: make room{_elsewhere(folder)}"
    if folder and _lacks_inodes(folder):
        free = f"{free_bytes(folder) >> 20} MB are free, but no inodes"
        return f"no more files can be made{_at(folder)} ({free}): remove some{_elsewhere(folder)}"
    free = f" ({free_bytes(folder) >> 20} MB free{_at(folder)})" if folder else ""
    return f"the disk is full{free}: make room{_elsewhere(folder)}"


def _named_folder(error: BaseException) -> Path | None:
    """Return the folder that an error names, or that of the file it names; of two files the one that was written."""
    name = isinstance(error, OSError) and (error.filename2 or error.filename)
    if not name:
        return None
    path = Path(os.fsdecode(name))
    return path if path.is_dir() else path.parent


def _is_full(folder: Path | None) -> bool:
    return folder is not None and (free_bytes(folder) < _NEARLY_FULL_BYTES or _lacks_inodes(folder))


def free_bytes(folder: Path) -> int:
    """Return how many bytes are free where a folder is or will be."""
    return shutil.disk_usage(_existing(folder)).free


def _lacks_inodes(folder: Path) -> bool:
    """Return whether a file system has room for bytes but for hardly any more files; false where it has no such limit.

    The file that found no room may have been removed since, so a few inodes count as none.
    """
    room = os.statvfs(_existing(folder))
    return room.f_favail * room.f_blocks < min(0.05 * room.f_blocks, room.f_bavail) * room.f_files


def _existing(folder: Path) -> Path:
    """Return a folder, or the nearest folder above it that exists."""
    folder = Path(folder).absolute()
    while not folder.exists():
        folder = folder.parent
    return folder


def _at(folder: Path | None) -> str:
    """Return " at <folder>", or nothing for no folder."""
    return f" at {folder}" if folder else ""


def _elsewhere(folder: Path | None) -> str:
    """Return the end of a piece of advice: the variable that would move a folder's contents to another disk."""
    above = {variable: root for variable, root in _roots().items() if folder and folder.resolve().is_relative_to(root)}
    variable = max(above, key=lambda name: len(above[name].parts), default="")  # one root may lie in another
    return f" or set {variable} to a folder elsewhere" if variable else ""


def _roots() -> dict[str, Path]:
    """Return the folders that this project writes to, resolved, by the variables that name them."""
    roots = {CACHE_VARIABLE: cache_folder(), RESULTS_VARIABLE: run_folder("any").parent}
    with suppress(FileNotFoundError):  # all disks may be full
        roots["TMPDIR"] = Path(tempfile.gettempdir())
    return {variable: root.resolve() for variable, root in roots.items()}


def _limit() -> int:
    """Return the largest file that this process may write, in bytes; 0 for no limit."""
    soft, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return 0 if soft == resource.RLIM_INFINITY else soft


# Folders to write to, which are checked before hours of work; and one with a short path, for sockets.

_LONGEST_BYTES = 60  # of a temporary folder's path; with two more names a socket's path may have 103


def check_writable(folder: Path, variable: str) -> None:
    """Make a folder unless it exists, and raise InputError if no file can be written into it.

    variable: the environment variable that names it, for the message.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return
    except OSError as error:
        if shortage_number(error, folder):
            raise
        file = next((part for part in (folder, *folder.parents) if part.exists() and not part.is_dir()), None)
        reason = f"{file} is a file" if file else error.strerror
    raise InputError(f"{folder} can't be written to ({reason}): set {variable} to a folder that can")


def check_creatable(folder: Path, variable: str) -> None:
    """Raise InputError, as `check_writable` does, if a folder can't be made or written; leave nothing behind."""
    check_writable(next(part for part in (folder, *folder.parents) if part.exists()), variable)


@contextmanager
def short_temporary_folder() -> Iterator[Path]:
    """Yield a temporary folder for a socket, whose path may have about a hundred bytes.

    It is in `$TMPDIR` if that is short enough, and goes when the block ends. Raises InputError if none can be made.
    """
    parents = [Path(name) for name in (os.environ.get("TMPDIR"), "/tmp", "/var/tmp", "/dev/shm") if name]
    for parent in parents:
        if len(os.fsencode(parent.absolute())) > _LONGEST_BYTES:
            continue
        try:
            folder = tempfile.TemporaryDirectory(dir=parent.absolute(), ignore_cleanup_errors=True)
        except OSError as error:
            if shortage_number(error, parent):
                raise
            continue
        with folder as name:
            yield Path(name)
        return
    raise InputError(
        f"no temporary folder can be made in {' or '.join(map(str, parents))}: set TMPDIR to a folder that can be "
        f"written, with a path of at most {_LONGEST_BYTES} bytes"
    )
