"""The progress of stages that run side by side: bars on a terminal, a line now and then elsewhere."""

import sys
import time
from io import TextIOBase

from tqdm import tqdm

from replicate.base.progress import DELAY_S

LINE_EVERY_S = 30.0  # between two lines about a stage, without a terminal
FEW = 0.05  # the share of a part's steps that may have waited for something


class StageDisplay:
    """The bar, or the lines, of one running stage; silent for its first two seconds."""

    def __init__(self, title: str, slot: int, stream: TextIOBase | None = None):
        self.title, self.slot = title, slot
        self.stream = stream or sys.stderr
        self.start = self._last_line = time.monotonic()
        self._announced = False
        self._bar: tqdm | None = None
        self._label, self._label_start, self._label_initial = "", self.start, 0.0
        self._is_warm = False  # whether the part that the stage is at has made its first steps
        self._left_s, self._told = None, self.start  # of the part that the stage is at, and when it was told

    @property
    def seconds(self) -> float:
        """How long the stage has been running."""
        return time.monotonic() - self.start

    @property
    def left_s(self) -> float | None:
        """How long the part that the stage is at still takes, as it last said; None if it hasn't or the time is up."""
        left_s = 0.0 if self._left_s is None else self._left_s - (time.monotonic() - self._told)
        return left_s if left_s > 0 else None

    def tick(self) -> None:
        """Announce the stage once it has run for two seconds."""
        if not self._announced and self.seconds >= DELAY_S:
            self._announced = True
            self._line("started")

    def waiting(self) -> None:
        """Say that another process is making the same artefact."""
        self._announced = True
        self._line("being made by another process; waiting for it")

    def progress(self, label: str, steps: float, total: float) -> None:
        """Show that `steps` of `total` steps of the part `label` are done."""
        self.tick()
        is_new = label != self._label
        if is_new:
            self._close()
        # a few first steps wait for what is compiled: they say nothing of the others
        if is_new or (not self._is_warm and 0 < steps - self._label_initial < FEW * total):
            self._is_warm = not is_new
            self._label, self._label_start, self._label_initial = label, time.monotonic(), steps
        seconds, here = time.monotonic() - self._label_start, steps - self._label_initial
        self._left_s = seconds * (total - steps) / here if here > 0 else None
        self._told = time.monotonic()
        if self.stream.isatty():
            self._draw(steps, total)
        elif self._announced and time.monotonic() - self._last_line >= LINE_EVERY_S and steps < total:
            left = "" if self._left_s is None else f", about {duration(self._left_s)} left"
            self._line(f"{label} {steps:,.0f} of {total:,.0f}{left}")

    def end(self, outcome: str) -> None:
        """Remove the bar and, if the stage took two seconds or more, say how long it took."""
        self._close()
        if self.seconds >= DELAY_S:
            self._line(f"{outcome} in {duration(self.seconds)}")

    def _draw(self, steps: float, total: float) -> None:
        if self._bar is None:
            self._bar = tqdm(
                total=total,
                initial=steps,
                desc=f"{self.title}: {self._label}",
                position=self.slot,
                delay=max(0.0, self.start + DELAY_S - time.monotonic()),
                leave=False,
                dynamic_ncols=True,
                file=self.stream,
            )
        self._bar.update(steps - self._bar.n)

    def _line(self, text: str) -> None:
        self._last_line = time.monotonic()
        tqdm.write(f"{self.title}: {text}", file=self.stream)
        self.stream.flush()

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None


class RunDisplay:
    """The progress of a whole run: a row below all bars on a terminal, a line now and then elsewhere."""

    def __init__(self, total: int, stream: TextIOBase | None = None):
        """total: artefacts to make; nothing is shown for a single one, which has its stage's display."""
        self.total, self.stream = total, stream or sys.stderr
        self.start = self._last_line = time.monotonic()
        self._bar: tqdm | None = None

    def show(self, done: int, running: int, left_s: float | None, row: int, late: bool = False) -> None:
        """Show how many artefacts are done and being made, and about how many seconds are left, if that is known.

        row: the first row below the bars of the stages.
        late: whether what is being made has taken longer than expected; the seconds are then those of the others.
        """
        now = time.monotonic()
        if self.total < 2 or now - self.start < DELAY_S:
            return
        about = f"about {duration(left_s)}" if left_s and left_s >= 1 else ""
        if late:
            left = ", longer than expected" + (f"; then {about}" if about else "")
        else:
            left = f", {about} left" if about else ""
        text = f"{done} of {self.total} artefacts, {running} under way{left}"
        if self.stream.isatty():
            self._draw(text, done, row)
        elif now - self._last_line >= LINE_EVERY_S:
            self._last_line = now
            tqdm.write(text, file=self.stream)
            self.stream.flush()

    def end(self) -> None:
        """Remove the row; what is printed next begins at the left."""
        if self._bar is not None:
            self._bar.clear()
            self._bar.pos = 0
            self._bar.close()
            self._bar = None

    def _draw(self, text: str, done: int, row: int) -> None:
        if self._bar is None:
            looks = {"bar_format": "{desc} |{bar}|", "leave": False, "dynamic_ncols": True}
            self._bar = tqdm(total=self.total, desc=text, position=row, file=self.stream, **looks)
        if self._bar.pos != -row:  # a stage has begun or ended: stay below all of them
            self._bar.clear()
            self._bar.pos = -row
        self._bar.n = done
        self._bar.set_description_str(text)


def duration(seconds: float) -> str:
    """Return a time in a few words."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"
