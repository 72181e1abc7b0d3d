"""Progress bars with an estimate of the time left, for work of more than two seconds."""

import sys
import time
from collections.abc import Callable

from tqdm import tqdm

DELAY_S = 2.0  # nothing is drawn for work that is done sooner
_INTERVAL_S = 0.1  # the shortest time between two reports of a worker

_reporter: Callable[[str, float, float], None] | None = None


def report_to(reporter: Callable[[str, float, float], None] | None) -> None:
    """Send progress to `reporter(label, done, total)` instead of a bar; None brings the bar back.

    A worker process has no terminal: it reports to the process that started it, which draws.
    """
    global _reporter
    _reporter = reporter


class Progress:
    """How much of a piece of work is done; made by `progress`."""

    def __init__(self, total: float, label: str, initial: float = 0):
        self.total, self.label, self.steps = total, label, initial
        self._last_report = -float("inf")
        self._bar: tqdm | None = None

    def __enter__(self) -> "Progress":
        if _reporter is None:
            self._bar = tqdm(
                total=self.total,
                initial=self.steps,
                desc=self.label,
                delay=DELAY_S,
                leave=False,
                dynamic_ncols=True,
                disable=not sys.stderr.isatty(),
            )
        else:
            self._report()
        return self

    def __exit__(self, *exception) -> None:
        if self._bar is not None:
            self._bar.close()
        elif _reporter is not None:
            self._report()

    def update(self, amount: float = 1) -> None:
        """Report `amount` more steps as done."""
        self.steps += amount
        if self._bar is not None:
            self._bar.update(amount)
        elif time.monotonic() - self._last_report >= _INTERVAL_S:
            self._report()

    def _report(self) -> None:
        self._last_report = time.monotonic()
        if _reporter is not None:
            _reporter(self.label, self.steps, self.total)


def progress(total: float, label: str, initial: float = 0) -> Progress:
    """Return a context manager whose `.update(k)` moves a bar of `total` steps, of which `initial` are done.

    Nothing is drawn if standard error is no terminal; inside a stage, the scheduler draws.
    """
    return Progress(total, label, initial)
