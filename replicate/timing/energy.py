"""The energy that a processor uses, where the machine tells: Linux's powercap counters, as Intel's RAPL fills them.

A counter is of a whole processor, so that all that runs beside a measurement counts too. Virtual machines have none,
and many systems let the administrator alone read them.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

FOLDER, ZONES = Path("/sys/class/powercap"), "intel-rapl:*"  # of AMD's processors too; intel-rapl-mmio repeats them
MICRO = 1e-6
LEAST_S = 1.0  # how long a measurement runs at least: counters move every millisecond


@dataclass(frozen=True)
class Counter:
    """A counter of one processor. file: its microjoules so far. largest: where it starts again from zero."""

    file: Path
    largest: int

    def read(self) -> int:
        """Return the counter in microjoules."""
        return int(self.file.read_text())

    def joules(self, before: int, after: int) -> float:
        """Return the joules between two readings, between which the counter has started anew at most once."""
        return MICRO * (after - before + (self.largest + 1 if after < before else 0))


def counters(folder: Path = FOLDER) -> list[Counter]:
    """Return the counters of all processors that this machine has and that we may read."""
    found = []
    for zone in sorted(folder.glob(ZONES)):
        try:
            if (zone / "name").read_text().startswith("package"):
                counter = Counter(zone / "energy_uj", int((zone / "max_energy_range_uj").read_text()))
                counter.read()
                found.append(counter)
        except (OSError, ValueError):
            continue  # a zone without a counter, or one that only the administrator reads
    return found


def energy_j(call: Callable[[], object], over: list[Counter], least_s: float = LEAST_S) -> tuple[float, int]:
    """Return the joules that some processors use a call, and how many calls that is the mean of.

    call: what is done again and again for `least_s` seconds.
    """
    call()
    before, start, calls = [counter.read() for counter in over], time.perf_counter(), 0
    while not calls or time.perf_counter() - start < least_s:
        call()
        calls += 1
    used = sum(counter.joules(first, counter.read()) for counter, first in zip(over, before, strict=True))
    return used / calls, calls


def why_no_energy(over: list[Counter], folder: Path = FOLDER) -> str:
    """Return a sentence that says why no energy is measured, or "" where some counters are there."""
    if over:
        return ""
    if not list(folder.glob(ZONES)):
        return f"Energy is not measured: this machine has no counters under {folder}, as most virtual machines."
    return f"Energy is not measured: the counters under {folder} can't be read; `sudo chmod a+r` on energy_uj lets us."
