"""The machine that times are of: how many cores work, what they take in energy, and the most that they could do."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import no_type_check

import llvmlite.binding
import numpy as np
import torch
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.typing.templates import Signature
from numba.extending import intrinsic
from threadpoolctl import threadpool_limits

from replicate.base.jit_cache import kept
from replicate.kernels.map_kernel import REORDER
from replicate.kernels.vector_code import CHANNELS, INDEX, VECTOR, splat

TASKS = Path("/proc/self/task")


def can_confine() -> bool:
    """Return whether this system lets a process keep its threads on one core; Linux does."""
    return sys.platform == "linux" and hasattr(os, "sched_setaffinity") and TASKS.is_dir()


@contextmanager
def one_core() -> Iterator[None]:
    """Keep all threads of the process on one core while the context lasts, XLA's too, whose count is fixed at start.

    Raises OSError where `can_confine` is False.
    """
    before = os.sched_getaffinity(0)
    with threads(1):
        _keep({min(before)})
        try:
            yield
        finally:
            _keep(before)


def confined() -> AbstractContextManager[None]:
    """Keep the process on one core while the context lasts, or where the system can't, let it use one thread."""
    return one_core() if can_confine() else threads(1)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Let BLAS, OpenMP and torch use so many threads while the context lasts."""
    usual = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        with threadpool_limits(count):
            yield
    finally:
        torch.set_num_threads(usual)


def _keep(cores: set[int]) -> None:
    for task in TASKS.iterdir():
        with suppress(ProcessLookupError):  # a thread that has ended since
            os.sched_setaffinity(int(task.name), cores)


# The energy that a processor uses, where the machine tells: Linux's powercap counters, as Intel's RAPL fills them.

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


def energy_j(call: Callable[[], object], processors: list[Counter], least_s: float = LEAST_S) -> tuple[float, int]:
    """Repeat a call for `least_s` seconds; return the mean joules that the processors use for one, and how many ran."""
    call()
    before, start, calls = [counter.read() for counter in processors], time.perf_counter(), 0
    while not calls or time.perf_counter() - start < least_s:
        call()
        calls += 1
    used = sum(counter.joules(first, counter.read()) for counter, first in zip(processors, before, strict=True))
    return used / calls, calls


def why_no_energy(processors: list[Counter], folder: Path = FOLDER) -> str:
    """Return a sentence that says why no energy is measured, or "" where there are counters."""
    if processors:
        return ""
    if not list(folder.glob(ZONES)):
        return f"Energy is not measured: this machine has no counters under {folder}, as most virtual machines."
    return f"Energy is not measured: the counters under {folder} can't be read; `sudo chmod a+r` on energy_uj lets us."


# What one core of this machine can do at most, measured: multiply-adds in float32, and bytes that it reads.

ROUNDS = 200_000  # of the loop of multiply-adds
REPEATS = 15  # of which the best counts: whatever else runs only takes away
WIDE = "avx512f"  # the feature of processors whose registers hold 32 vectors of 16 numbers
SUMS = 12 if llvmlite.binding.get_host_cpu_features().get(WIDE) else 6  # independent, enough to hide how long one takes
MEMORY_BYTES, CACHE_BYTES = 256_000_000, 4_000_000  # far beyond all caches; about what a model's weights take


@intrinsic
def _add_products(typing: object, rounds: types.Type, factor: types.Type) -> tuple[Signature, Callable]:
    """Multiply and add vectors of numbers again and again, and return the sum of what they come to."""

    def generate(context, builder, signature, args):
        fma = cgutils.get_or_insert_function(builder.module, ir.FunctionType(VECTOR, [VECTOR] * 3), "llvm.fma.v16f32")
        value = splat(builder, args[1])
        sums = [cgutils.alloca_once_value(builder, value) for _ in range(SUMS)]
        with cgutils.for_range(builder, args[0], intp=INDEX):
            for total in sums:
                builder.store(builder.call(fma, [builder.load(total), value, value]), total)
        whole = builder.load(sums[0])
        for total in sums[1:]:
            whole = builder.fadd(whole, builder.load(total))
        parts = [builder.extract_element(whole, ir.Constant(ir.IntType(32), k)) for k in range(CHANNELS)]
        result = parts[0]
        for part in parts[1:]:
            result = builder.fadd(result, part)
        return result

    return types.float32(types.int64, types.float32), generate


@kept
@njit(nogil=True)
@no_type_check
def _multiply(rounds, factor):
    return _add_products(rounds, factor)


@kept
@njit(error_model="numpy", fastmath=REORDER, nogil=True)
@no_type_check
def _read(numbers):
    total = np.float32(0)
    for k in range(len(numbers)):
        total += numbers[k]
    return total


def multiply_adds_per_s() -> float:
    """Return how many float32 multiply-adds one core does in a second, in registers alone."""
    seconds = _best(lambda: _multiply(ROUNDS, np.float32(0.5)))
    return ROUNDS * SUMS * CHANNELS / seconds


def bytes_per_s(size: int = MEMORY_BYTES) -> float:
    """Return how many bytes one core reads in a second, over and over from an array of `size` bytes."""
    numbers = np.ones(size // 4, np.float32)
    return numbers.nbytes / _best(lambda: _read(numbers))


def _best(call: Callable[[], object]) -> float:
    """Return the shortest time of `REPEATS` calls in seconds, after one that compiles."""
    seconds = []
    for _ in range(1 + REPEATS):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return min(seconds[1:])
