"""A full disk: which errors mean one, and the sentence that names the folder and what helps."""

import errno
import os
import resource
import shutil
import tempfile
from pathlib import Path

from replicate.engine.exceptions import InputError, RunError
from replicate.engine.paths import cache_folder, run_folder

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
    """Return "" unless a file found no room, else which folder is full, or which limit met, and what helps.

    folder: where the file was to be; an error that names its file knows better.
    """
    number = shortage_number(error, folder)
    if number is None:
        return ""
    if isinstance(error, OSError) and error.filename:
        folder = Path(os.fsdecode(error.filename)).parent
    if number == errno.EFBIG:
        limit = f" of {_limit() >> 10} KB" if _limit() else ""
        return f"a file would be larger than allowed{_at(folder)}: raise the limit{limit} with `ulimit -f`"
    free = f" ({free_bytes(folder) >> 20} MB free{_at(folder)})" if folder else ""
    return f"the disk is full{free}: make room{_elsewhere(folder)}"


def free_bytes(folder: Path) -> int:
    """Return how much room there is where a folder is, or will be."""
    folder = Path(folder).absolute()
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free


def _at(folder: Path | None) -> str:
    """Return " at <folder>", or nothing for no folder."""
    return f" at {folder}" if folder else ""


def _elsewhere(folder: Path | None) -> str:
    """Return the variable that moves a folder's contents to another disk, as the end of a piece of advice."""
    roots = {
        "REPLICATE_CACHE": cache_folder(),
        "REPLICATE_RESULTS": run_folder("any").parent,
        "TMPDIR": Path(tempfile.gettempdir()),
    }
    for variable, root in roots.items():
        if folder and folder.resolve().is_relative_to(root.resolve()):
            return f" or set {variable} to a folder elsewhere"
    return ""


def _limit() -> int:
    """Return the largest size of a file that this process may write, in bytes; 0 for none."""
    soft, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return 0 if soft == resource.RLIM_INFINITY else soft
