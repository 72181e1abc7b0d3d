"""Signals that end a run: they become exceptions, so that the run ends its workers and says so on its way out."""

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
    """A signal ends this process; the exit code is 128 + the signal's."""

    def __init__(self, number: int):
        super().__init__(128 + number)
        self.reason = f"ended by {signal.Signals(number).name}"
        self.announced = _ended_with_make.is_set()  # which has been said


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into `Stopped`, and say in a line that they ended the work.

    Ctrl-C is an exception already. A signal that is ignored stays ignored, as SIGHUP is under `nohup`. Only the first
    signal counts: further ones do not disturb the ending. Outside the main thread nothing changes.
    """
    stopping = False

    def stop(number: int, frame: object) -> None:
        nonlocal stopping
        if not stopping:
            stopping = True
            raise Stopped(number)

    before = {}
    try:
        for number in _ENDING:
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, stop)
    except ValueError:  # not the main thread: signals are somebody else's
        pass
    try:
        yield
    except Stopped as end:
        _announce(end)
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _announce(end: Stopped) -> None:
    if not end.announced:
        end.announced = True
        _say(end.reason)


def _say(reason: str) -> None:
    with suppress(OSError, ValueError):  # the terminal may be gone
        line = f"{reason}: what is finished is kept, and the same command goes on from there"
        print(line, file=sys.stderr, flush=True)


def end_with_make() -> None:
    """Have this process ended by SIGTERM when the `make` that started it is gone, and say so.

    The Makefile says `--from-make` with make's own number, which make found before it started anything, and starts
    Python with `exec`, so that its parent is make for as long as make lives. Whoever starts a process otherwise may
    leave it behind on purpose, as with `nohup`; a killed `make` never does. To be called first of all: a `make` may be
    killed while modules are imported.
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
    """Return whether SIGHUP has reached make alone: it waits for its recipes then, and tells them nothing (Linux).

    Its handler blocks the signal and has given up catching it.
    """
    try:
        with open(f"/proc/{make}/status", encoding="utf-8", errors="replace") as stream:
            masks = dict(line.split(":", 1) for line in stream if line.startswith("Sig"))
    except OSError:
        return False
    blocked, ignored, caught = (int(masks[name], 16) & 1 for name in ("SigBlk", "SigIgn", "SigCgt"))
    return bool(blocked and not ignored and not caught)


# The options that `make` hands on: all variables that are set go to every target, which leaves out what it lacks.

FROM_MAKE = "--from-make"
ALWAYS_SET = ("--profile",)  # by the Makefile, whoever asks for what


def without_foreign(words: list[str], options: Collection[str]) -> list[str]:
    """Return a command line's words; those from make without the options, and their values, that a command lacks.

    options: those that the command takes, as "--profile". Standard error says which variables count for nothing.
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
        print(f"left out, since this command doesn't take it: {', '.join(map(_variable, foreign))}", file=sys.stderr)
    return rest


def _variable(option: str) -> str:
    return option.removeprefix("--").replace("-", "_").upper()
