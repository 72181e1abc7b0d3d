"""Signals that end a run: they become exceptions, so that the run ends its workers and says so on its way out."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Stopped(SystemExit):
    """A signal, or the end of the `make` that started it, ends this process; the exit code is 128 + the signal's."""

    def __init__(self, number: int, reason: str):
        super().__init__(128 + number)
        self.reason = reason
        self.announced = False


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
            raise Stopped(number, f"ended by {signal.Signals(number).name}")

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
        with suppress(OSError, ValueError):  # the terminal may be gone
            line = f"{end.reason}: what is finished is kept, and the same command goes on from there"
            print(line, file=sys.stderr, flush=True)


class ParentWatch:
    """Notices the end of the `make` that started this process.

    Whoever starts a process otherwise may leave it behind on purpose, as with `nohup`; a killed `make` never does.
    """

    def __init__(self):
        self._make = os.getppid() if "MAKELEVEL" in os.environ else None

    def check(self) -> None:
        """Raise `Stopped` if the `make` is gone."""
        if self._make is not None and os.getppid() != self._make:
            raise Stopped(signal.SIGTERM, "ended, since the make that started it is gone")
