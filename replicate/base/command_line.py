"""How every command ends: whatever goes wrong inside becomes one sentence and an exit code, without a traceback.

Exit codes: 0 done; 1 the run could not go on, the disk is full, memory ran out; 2 bad input; 130 Ctrl-C; 141 nobody
reads the output. A program of this project ends with

    if __name__ == "__main__":
        sys.exit(run("replicate.somewhere:main"))

and imports only this module before that, which loads next to nothing: Ctrl-C may come during the first imports.
"""

import contextlib
import errno
import gc
import importlib
import os
import select
import signal
import sys
from collections.abc import Callable

from replicate.base.exceptions import InputError, RunError
from replicate.base.signals import end_with_make

_NO_MEMORY = (
    os.strerror(errno.ENOMEM), "bad_alloc", "out of memory", "Out of memory", "can't allocate memory",
    "failed to map segment",
)  # fmt: skip
INTERRUPTION = "interrupted: what is finished is kept, and the same command goes on from there"


def run(function: str) -> int:
    """Import a function, "module:name", call it without arguments, and return the exit code as `guard` does.

    Ctrl-C ends the process at once during imports and after the work: there an exception could turn into any other.
    """
    end_with_make()
    collect_seldom()
    prepare_streams()
    has_interrupts = signal.getsignal(signal.SIGINT) is not signal.SIG_IGN  # a shell's background job ignores it

    def on_interrupt(handler: Callable[[int, object], None]) -> None:
        if has_interrupts:
            signal.signal(signal.SIGINT, handler)

    def body() -> int | None:
        on_interrupt(_leave)
        module, _, name = function.partition(":")
        entry = getattr(importlib.import_module(module), name)
        on_interrupt(signal.default_int_handler)
        return entry()

    code = guard(body)
    on_interrupt(lambda signum, frame: os._exit(code))
    return code


def guard(body: Callable[[], int | None]) -> int:
    """Call a function and return its exit code, or that of the error it raises, which is printed as one sentence.

    Unforeseen errors are raised as they are.
    """
    try:
        try:
            code = body()
        except SystemExit as end:
            code = end.code
        sys.stdout.flush()
        return code if isinstance(code, int) else 0 if code is None else _tell(str(code), 1)
    except InputError as error:
        return _tell(str(error), 2)
    except RunError as error:
        return _tell(str(error), 1)
    except KeyboardInterrupt:
        return _tell(INTERRUPTION, 130)
    except BrokenPipeError:
        if not _is_unread():
            raise
        _silence()
        return 141
    except Exception as error:
        if is_out_of_memory(error):
            return _tell("memory ran out: what is finished is kept; close other programs or name fewer JOBS", 1)
        from replicate.base.files import shortage

        short = shortage(error)
        if not short:
            raise
        code = _tell(f"{short}, then run the same command; what is finished is kept", 1)
        _silence()  # it may be standard output that found no room
        return code


def is_out_of_memory(error: Exception) -> bool:
    """Return whether an error means that memory ran out, whatever words its library has for that."""
    return isinstance(error, MemoryError) or any(words in str(error) for words in _NO_MEMORY)


def exit_in_words(end: SystemExit) -> str:
    """Return a sentence that names the function that called sys.exit; it may belong to a user's method."""
    import traceback

    place = traceback.extract_tb(end.__traceback__)[-1]
    return f"{place.filename}: {place.name} called sys.exit({end.code!r}), where it had to return"


def collect_seldom() -> None:
    """Have Python look for cycles of objects less often than it does by itself.

    Imports of libraries and JAX's traces make millions of objects, few of them in cycles: looking took a fifth of the
    time of a process that loads torch and evaluates a rig.
    """
    gc.set_threshold(20_000, 10, 50)


def prepare_streams() -> None:
    """Make the standard streams accept whatever is printed.

    A closed stream is connected to the null device, or the next file that is opened would take its place. Characters
    that the output's encoding lacks are replaced.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is the closed one's
            os.set_inheritable(nowhere, True)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _tell(sentence: str, code: int) -> int:
    with contextlib.suppress(OSError, ValueError):  # nobody may be left to read it
        print(" ".join(sentence.split()), file=sys.stderr, flush=True)
    return code


def _leave(signum: int, frame: object) -> None:
    _tell(INTERRUPTION, 130)
    os._exit(130)


def _is_unread() -> bool:
    """Return whether nobody reads standard output or standard error any more."""
    poll = select.poll()
    for stream in (1, 2):
        poll.register(stream, 0)
    return any(event & select.POLLERR for _, event in poll.poll(0))


def _silence() -> None:
    """Discard what is still to be printed, or the interpreter's end would fail on it."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
