"""The time of single poses, as §5.2 measures it: one pose a call, many calls, after a warm-up.

The functions take turns, so that a busy machine slows all of them alike and their ratios stay. In a turn each evaluates
some poses one after the other, as when a face is moved, so that it finds its weights in the caches; were the functions
to alternate pose by pose, each would be timed at fetching what the others have displaced.
"""

import gc
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from replicate.methods.method_registry import in_order, method_named

WARM_UP = 10  # evaluations of each way that don't count
TURN = 10  # evaluations of a way before the next one's turn; one more before them doesn't count

Evaluate = Callable[[np.ndarray], object]  # one pose, (1, …)


@dataclass(frozen=True)
class Way:
    """One way to evaluate a pose. every: a slow way takes part in every k-th turn only."""

    evaluate: Evaluate
    every: int = 1


@dataclass(frozen=True)
class Times:
    """How long evaluations of single poses take, in milliseconds."""

    mean: float
    median: float
    p05: float
    p95: float
    evaluations: int


class Turns:
    """Some ways to evaluate poses, which take turns, and how long each has taken so far."""

    def __init__(self, ways: Mapping[str, Way], poses: Float[np.ndarray, "t ..."]):
        """ways: by name. poses: what the ways evaluate, one after the other and over again."""
        self._ways, self._poses = ways, poses
        self._taken: dict[str, list[float]] = {name: [] for name in ways}
        self._turn = self._done = 0

    def take(self, evaluations: int, advance: Callable[[int], object]) -> None:
        """Take turns until each way that takes part in all turns has done so many more evaluations.

        The first call warms up all ways. advance: called after each turn with the count of evaluations in it.
        """
        if evaluations and not self._turn:
            self._warm_up()
        end = self._done + evaluations
        while self._done < end:
            last = min(self._done + TURN, end)
            for name, way in self._ways.items():
                if self._turn % way.every == 0:
                    self._taken[name] += _milliseconds(way.evaluate, self._poses, self._done, last)
            advance(last - self._done)
            self._turn, self._done = self._turn + 1, last

    def _warm_up(self) -> None:
        for way in self._ways.values():
            for k in range(WARM_UP):
                way.evaluate(self._poses[k % len(self._poses)][None])

    def times(self) -> dict[str, Times]:
        """Return each way's times by name."""
        return {name: summary(taken) for name, taken in self._taken.items()}


@contextmanager
def without_collections() -> Iterator[None]:
    """Switch Python's garbage collector off while the context lasts: it would slow whichever way has its turn."""
    collecting = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def time_single_poses(
    ways: Mapping[str, Way], poses: Float[np.ndarray, "t ..."], evaluations: int, advance: Callable[[int], object]
) -> dict[str, Times]:
    """Return the times of some ways to evaluate poses, by name.

    poses: as for `Turns`. evaluations, advance: as for `Turns.take`.
    """
    turns = Turns(ways, poses)
    with without_collections():
        turns.take(evaluations, advance)
    return turns.times()


def _milliseconds(evaluate: Evaluate, poses: np.ndarray, first: int, last: int) -> list[float]:
    """Return how long each of some poses takes; the pose before the first is evaluated too, but not timed."""
    taken = []
    for k in range(first - 1, last):
        pose = poses[k % len(poses)][None]
        start = time.perf_counter()
        evaluate(pose)
        taken.append(1e3 * (time.perf_counter() - start))
    return taken[1:]


def summary(milliseconds: list[float]) -> Times:
    """Return the mean, the median and the 5th and 95th percentile of some times in ms."""
    p05, median, p95 = np.quantile(milliseconds, (0.05, 0.5, 0.95))
    return Times(float(np.mean(milliseconds)), float(median), float(p05), float(p95), len(milliseconds))


# What is timed, as results name it: the rig, methods, other ways to evaluate them, and the rigid step.

RIG, NODES, RIGID_STEP = "rig", "rig_nodes", "rigid_step"
PLAIN, JAX, FAST, HALF = "_plain", "_jax", "_fast", "_half"  # endings of a method's name: how it is evaluated
ONNX, ONNX_THREADS, ONNX_SPINNING = "_onnx", "_onnx_threads", "_onnx_spinning"
GPU, GRAPH = "_gpu", "_gpu_graph"
BACKENDS = {
    "": "the suite's",
    PLAIN: "plain",
    JAX: "JAX",
    ONNX: "ONNX Runtime",
    ONNX_THREADS: "ONNX, all threads",
    ONNX_SPINNING: "ONNX, spinning",
    FAST: "fast",
    HALF: "fast, 16 bits",
    GPU: "torch on a GPU",
    GRAPH: "CUDA graph",
}
THREADED = (ONNX_THREADS, ONNX_SPINNING)  # which need several cores
ON_GPU = (GPU, GRAPH)  # which leave only the rigid step to the CPU
EXACT = ("", PLAIN, JAX, ONNX, *THREADED, FAST, *ON_GPU)  # which give the method's vertices up to float32's rounding
RIGS = {NODES: "The rig, node by node", RIG: "The rig, compiled"}
PARTS = {RIGID_STEP: "Rigid step alone"}
CHANGE = "change_"  # the beginning of metrics that compare a run with the one before it


def parted(name: str) -> tuple[str, str]:
    """Return the method's name and the ending that says how it is evaluated, "" for none."""
    for ending in filter(None, BACKENDS):
        if name.endswith(ending):
            return name.removesuffix(ending), ending
    return name, ""


def label_of(name: str, marked: bool = False) -> str:
    """Return a timed thing's name in tables. marked: with the mark of a method's footnote."""
    name, ending = parted(name)
    known = RIGS | PARTS
    if ending:
        return f"{known.get(name) or method_named(name).label}, {BACKENDS[ending]}"
    return known.get(name) or (method_named(name).title if marked else method_named(name).label)


def in_table_order(present: Iterable[str]) -> list[str]:
    """Return names in the order of tables: the rig, each method with its other evaluations, the rigid step."""
    names = set(present)
    methods = in_order({parted(name)[0] for name in names} - {*RIGS, *PARTS})
    every = (first + ending for first in (*RIGS, *methods, *PARTS) for ending in BACKENDS)
    return [name for name in every if name in names]
