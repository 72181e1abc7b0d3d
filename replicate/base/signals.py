"""Signals that end a run become exceptions, so that the run can end its workers and say why it stopped."""

import os
import signal
import sys
import threading
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress

_LOOK_EVERY_S = 0.5
_ended_with_make = threading.Event()
_ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Stopped(SystemExit):
    """A signal ends this process; the exit code is 128 plus the signal's number."""

    def __init__(self, signum: int):
        super().__init__(128 + signum)
        self.reason = f"ended by {signal.Signals(signum).name}"
        self.announced = _ended_with_make.is_set()  # `_watch` has printed the reason then


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into `Stopped`, and print a line that says so.

    Ctrl-C is an exception already. An ignored signal stays ignored, as SIGHUP under `nohup`. Only the first signal
    counts; more of them don't disturb the ending. Outside the main thread nothing changes.
    """
    stopping = False

    def stop(signum: int, frame: object) -> None:
        nonlocal stopping
        if not stopping:
            stopping = True
            raise Stopped(signum)

    before = {}
    try:
        for signum in _ENDING:
            if signal.getsignal(signum) is not signal.SIG_IGN:
                before[signum] = signal.signal(signum, stop)
    except ValueError:  # only the main thread can handle signals
        pass
    try:
        yield
    except Stopped as end:
        _announce(end)
        raise
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)


def _announce(end: Stopped) -> None:
    if not end.announced:
        end.announced = True
        _say(end.reason)


def _say(reason: str) -> None:
    with suppress(OSError, ValueError):  # the terminal may be gone
        line = f"{reason}: what is finished is kept, and the same command goes on from there"
        print(line, file=sys.stderr, flush=True)


def end_with_make() -> None:
    """End this process by SIGTERM, with a line that says so, when the `make` that started it is gone.

    The Makefile passes make's process id after `--from-make`, and starts Python with `exec`, so that make is its parent
    for as long as make lives. A process that was started in another way may outlive its parent on purpose, as with
    `nohup`. This is called first of all, since `make` may be killed while modules are imported.
    """
    if FROM_MAKE in sys.argv:
        make = int(sys.argv[sys.argv.index(FROM_MAKE) + 1])
        threading.Thread(target=_watch, args=(make,), daemon=True).start()


def _watch(make: int) -> None:
    while os.getppid() == make and not _is_hung_up(make):
        time.sleep(_LOOK_EVERY_S)
    _say("ended with the make that started it")
    _ended_with_make.set()
    signal.pthread_kill(threading.main_thread().ident, signal.SIGTERM)


def _is_hung_up(make: int) -> bool:
    """Return whether SIGHUP has reached make but not this process: make then waits for its recipes (Linux).

    make's handler shows by a signal that is blocked and no longer caught.
    """
    try:
        with open(f"/proc/{make}/status", encoding="utf-8", errors="replace") as stream:
            masks = dict(line.split(":", 1) for line in stream if line.startswith("Sig"))
    except OSError:
        return False
    blocked, ignored, caught = (int(masks[name], 16) & 1 for name in ("SigBlk", "SigIgn", "SigCgt"))
    return bool(blocked and not ignored and not caught)


# The options that `make` passes on: every target gets all variables that are set, and drops those it has no use for.

FROM_MAKE = "--from-make"
ALWAYS_SET = ("--profile",)  # by the Makefile, for every target


def without_foreign(words: list[str], options: Collection[str]) -> list[str]:
    """Return the words of a command line, without options that the command lacks if the line comes from make.

    options: those that the command has, such as "--profile". Standard error lists the variables that are left out.
    """
    if FROM_MAKE not in words:
        return words
    rest, foreign, keep = [], [], True
    for word in words:
        if word.startswith("--"):
            keep = word in options
            if not keep and word not in (FROM_MAKE, *ALWAYS_SET):
                foreign.append(word)
        if keep:
            rest.append(word)
    if foreign:
        print(f"left out, since this command has no such option: {', '.join(map(_variable, foreign))}", file=sys.stderr)
    return rest


def _variable(option: str) -> str:
    return option.removeprefix("--").replace("-", "_").upper()
