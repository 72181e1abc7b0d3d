"""A full disk: which errors mean one, and the sentence that names the folder and what helps."""

import errno
import os
import resource
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

from replicate.engine.exceptions import InputError, RunError
from replicate.engine.paths import CACHE_VARIABLE, RESULTS_VARIABLE, cache_folder, run_folder

_NEARLY_FULL_BYTES = 32 << 20  # below this, a write that failed without a reason failed for lack of space
_NUMBERS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def shortage_number(error: BaseException, folder: Path | None = None) -> int | None:
    """Return ENOSPC, EDQUOT or EFBIG if an error says, or by the free space must mean, that a file found no room.

    folder: where the file was to be, for errors that name none.
    """
    if isinstance(error, (InputError, RunError)):
        return None
    for number in _NUMBERS:
        if os.strerror(number) in str(error):  # some libraries wrap the number away
            return number
    if not isinstance(error, OSError):
        return None
    if error.errno in _NUMBERS:
        return error.errno
    if error.errno is None and free_bytes(folder or cache_folder()) < _NEARLY_FULL_BYTES:
        return errno.ENOSPC
    if error.errno is None and " requested and " in str(error):  # so numpy tells of a short write, without a number
        return errno.EFBIG if _limit() else errno.ENOSPC
    return None


def shortage(error: BaseException, folder: Path | None = None) -> str:
    """Return "" unless a file found no room, else which folder has no more, or which limit was met, and what helps.

    folder: where the file was to be; an error that names its file knows better.
    """
    number = shortage_number(error, folder)
    if number is None:
        return ""
    named = _named_folder(error)
    if number == errno.EFBIG:
        limit = f" of {_limit() >> 10} KB" if _limit() else ""
        return f"a file would be larger than allowed{_at(named or folder)}: raise the limit{limit} with `ulimit -f`"
    folder = named or next(filter(_is_full, [folder, *_roots().values()]), folder)
    if number == errno.EDQUOT:
        return f"your quota is used up{_at(folder)}: make room{_elsewhere(folder)}"
    if folder and _lacks_inodes(folder):
        free = f"{free_bytes(folder) >> 20} MB are free, but no inodes"
        return f"no more files can be made{_at(folder)} ({free}): remove some{_elsewhere(folder)}"
    free = f" ({free_bytes(folder) >> 20} MB free{_at(folder)})" if folder else ""
    return f"the disk is full{free}: make room{_elsewhere(folder)}"


def _named_folder(error: BaseException) -> Path | None:
    """Return the folder that an error names, or that of its file: of two, the one that was to be written."""
    name = isinstance(error, OSError) and (error.filename2 or error.filename)
    if not name:
        return None
    path = Path(os.fsdecode(name))
    return path if path.is_dir() else path.parent


def _is_full(folder: Path | None) -> bool:
    return folder is not None and (free_bytes(folder) < _NEARLY_FULL_BYTES or _lacks_inodes(folder))


def free_bytes(folder: Path) -> int:
    """Return how much room there is where a folder is, or will be."""
    return shutil.disk_usage(_existing(folder)).free


def _lacks_inodes(folder: Path) -> bool:
    """Return whether a file system can hold hardly any more files, though more bytes; false where it counts no files.

    What found no room may have been removed by now, so that a few of them are free again.
    """
    room = os.statvfs(_existing(folder))
    return room.f_favail * room.f_blocks < min(0.05 * room.f_blocks, room.f_bavail) * room.f_files


def _existing(folder: Path) -> Path:
    """Return a folder, or the nearest one above it that is there."""
    folder = Path(folder).absolute()
    while not folder.exists():
        folder = folder.parent
    return folder


def _at(folder: Path | None) -> str:
    """Return " at <folder>", or nothing for no folder."""
    return f" at {folder}" if folder else ""


def _elsewhere(folder: Path | None) -> str:
    """Return the variable that moves a folder's contents to another disk, as the end of a piece of advice."""
    above = {variable: root for variable, root in _roots().items() if folder and folder.resolve().is_relative_to(root)}
    variable = max(above, key=lambda name: len(above[name].parts), default="")  # one root may lie in another
    return f" or set {variable} to a folder elsewhere" if variable else ""


def _roots() -> dict[str, Path]:
    """Return the folders that this project writes to, resolved, by the variables that name them."""
    roots = {CACHE_VARIABLE: cache_folder(), RESULTS_VARIABLE: run_folder("any").parent}
    with suppress(FileNotFoundError):  # there is none, should all disks be full
        roots["TMPDIR"] = Path(tempfile.gettempdir())
    return {variable: root.resolve() for variable, root in roots.items()}


def _limit() -> int:
    """Return the largest size of a file that this process may write, in bytes; 0 for none."""
    soft, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return 0 if soft == resource.RLIM_INFINITY else soft
