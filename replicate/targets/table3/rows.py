"""The numbers of Table 3, from rigs and their methods' models, which are timed together.

Torch and the ways to evaluate a model take seconds to import: that waits until something is timed, since graphs and
tables come here for settings and rows alone.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_recipes.rig import Rig, has_function
from replicate.approximation.metrics import unique_poses
from replicate.approximation.rigid import attach
from replicate.engine.stage import stage_function
from replicate.engine.store import read_manifest
from replicate.methods import artefacts
from replicate.methods.measurement import MeasurementNumbers, predictor
from replicate.report.results import Row, find, run_name, write_results
from replicate.report.tables import round_off
from replicate.timing.single_poses import (
    BACKENDS,
    DISTURBED,
    EXACT,
    FAST,
    HALF,
    NODES,
    ON_GPU,
    RIG,
    RIGID_STEP,
    THREADED,
    Times,
    Turns,
    Way,
    parted,
    without_collections,
)

# The settings of Table 3's stages.


@dataclass(frozen=True)
class RigNumbers:
    """Whose rows they are, what is timed, and how often.

    models: by method's name "module:function" of its model, of those that have one. sources: the names of the stages
    that it is read from, each with its title. file: where the rows are written.
    """

    character: str
    profile: str
    methods: tuple[MeasurementNumbers, ...]
    models: tuple[tuple[str, str], ...]
    turns: int
    sources: tuple[tuple[str, str], ...]
    file: str

    def own(self, inputs: Mapping[str, Path]) -> dict[str, Path]:
        """Return those of some artefacts, by their stages' titles, that are this rig's, by their stages' names."""
        return {name: inputs[title] for name, title in self.sources}


@dataclass(frozen=True)
class TimingNumbers:
    """The rigs that are timed together, and when that was asked for: no later run can take over a time."""

    rigs: tuple[RigNumbers, ...]
    measured: str


@dataclass(frozen=True)
class RowsNumbers:
    """Which file of the measurement has a rig's rows."""

    file: str


NODES_EVERY = 2  # turns: node by node the rig takes long
PEERS_EVERY = 5  # turns: the other evaluations of what has a fast one
ROUND = 50  # evaluations of a rig and its methods before the next one's; those that every fifth turn has, have one turn
COMPARED = 20  # poses in which every backend is compared with the method's own prediction
ONE, ALL, GRAPHICS = "one_core", "all_cores", "gpu"  # where: endings of the metrics


def write_all(rigs: Sequence[RigNumbers], inputs: Mapping[str, Path], progress: Callable, out: Path) -> None:
    """Write the rows of some rigs to a folder, a file each. progress: (total, label) → a context manager."""
    timed = {}
    with progress(len(rigs), "loading") as bar:
        for rig in rigs:
            timed[rig] = TimedRig(rig, rig.own(inputs))
            bar.update(1)
    take_turns(timed, progress)
    for rig, own in timed.items():
        write_results(out / rig.file, own.rows())


def take_turns(timed: Mapping[RigNumbers, "TimedRig"], progress: Callable) -> None:
    """Time all rigs in rounds: in each, every rig on all cores, on one core and on a GPU, where there is one.

    What else a machine does comes and goes in seconds to minutes. In rounds it slows all of them alike; a rig that was
    timed as a whole before the next one would have its own share of it.
    """
    wheres = [where for where, _ in settings_of_cores()]
    most = max(rig.turns for rig in timed)
    with without_collections(), progress(len(wheres) * sum(rig.turns for rig in timed), "timing") as bar:
        for first in range(0, most, ROUND):
            for rig, own in timed.items():
                for where, confined in settings_of_cores():
                    with confined:
                        own.turns[where].take(max(0, min(ROUND, rig.turns - first)), bar.update)


class TimedRig:
    """A rig and its methods: all ways to evaluate a pose, and their turns on all cores, on one and on a GPU."""

    def __init__(self, settings: RigNumbers, inputs: Mapping[str, Path]):
        """inputs: artefacts by the names of their stages."""
        rig, samples = artefacts.load_rig(inputs), artefacts.load_samples(inputs)
        self._settings, self._inputs = settings, inputs
        self._poses = np.asarray(samples.test_params[unique_poses(samples.test_params)], np.float32)
        self._ways = ways_of(settings, inputs, rig)
        self.turns = {where: Turns(ways_on(where, self._ways), self._poses) for where, _ in settings_of_cores()}

    def rows(self) -> list[Row]:
        """Return the rig's rows."""
        from replicate.timing.machine import core_total

        settings, poses = self._settings, self._poses
        facts = settings.profile, run_name(self._inputs)
        numbers = [
            (name, f"{metric}_{where}", "ms", value, one.evaluations)
            for where, turns in self.turns.items()
            for name, one in turns.times().items()
            for metric, value in metrics(one)
        ]
        numbers += [(RIG, "cores", "count", core_total(), None), *costs(settings, self._inputs)]
        numbers += differences(self._ways, poses[:: -(-len(poses) // COMPARED)])
        return [
            Row("table3", settings.character, method, metric, unit, float(value), None, 1, evaluations, *facts)
            for method, metric, unit, value, evaluations in numbers
        ]


def settings_of_cores() -> Iterator[tuple[str, AbstractContextManager[None]]]:
    """Yield what is measured, and the context that it is measured in: on all cores, on one where that can be, and on a
    GPU where there is one, whose rigid step has all cores.
    """
    import torch

    from replicate.timing.machine import can_confine, core_total, one_core, threads

    yield ALL, threads(core_total())
    if can_confine():
        yield ONE, one_core()
    if torch.cuda.is_available():
        yield GRAPHICS, threads(core_total())


def ways_on(where: str, ways: Mapping[str, Way]) -> dict[str, Way]:
    """Return what is timed on one core, on all of them or on a GPU.

    A way that divides its work among threads is none on one core.
    """
    left_out = {ONE: (*THREADED, *ON_GPU), ALL: ON_GPU, GRAPHICS: {*BACKENDS} - {*ON_GPU}}[where]
    return {name: way for name, way in ways.items() if parted(name)[1] not in left_out}


def metrics(times: Times) -> list[tuple[str, float]]:
    """Return a way's numbers by the beginnings of their metrics' names."""
    return [("time", times.mean), ("median", times.median), ("p05", times.p05), ("p95", times.p95)]


def ways_of(settings: RigNumbers, inputs: Mapping[str, Path], rig: Rig) -> dict[str, Way]:
    """Return all that is timed by name: the rig compiled and, where it has nodes, node by node; every method, as the
    suite evaluates it and by all other backends; and the rigid step alone, which all approximations contain.

    A rig that is known by its samples alone has no time. Where a method has a fast evaluation, its others take part in
    each PEERS_EVERYth turn.
    """
    from replicate.timing.backends import fast_rigid_step, gpu_backends, other_backends

    mesh, attachments = rig.mesh, artefacts.load_attachments(inputs)
    ways = {RIG: Way(rig)} if has_function(rig) else {}
    if run_nodes := getattr(rig, "run_nodes", None):
        ways[NODES] = Way(run_nodes, NODES_EVERY)
    models = dict(settings.models)
    for numbers in settings.methods:
        backends = {"": _without_truth(numbers, inputs)}
        model = stage_function(models[numbers.method])(inputs) if numbers.method in models else None
        if model is not None:
            backends |= other_backends(model, mesh, attachments) | gpu_backends(model, mesh, attachments)
        for ending, evaluate in backends.items():
            ways[numbers.method + ending] = Way(evaluate, turns_of(ending, backends))
    posed = rig(rig.default[None])
    ways[RIGID_STEP] = Way(lambda params: attach(mesh, attachments, posed))
    ways[RIGID_STEP + FAST] = Way(fast_rigid_step(mesh, attachments, posed))
    return ways


def turns_of(ending: str, endings: Collection[str]) -> int:
    """Return in each which turn an evaluation of a model takes part, by its ending and those of all of them."""
    return PEERS_EVERY if FAST in endings and ending not in (FAST, HALF, *ON_GPU) else 1


def costs(settings: RigNumbers, inputs: Mapping[str, Path]) -> list[tuple[str, str, str, float, None]]:
    """Return what else a pose costs: each method's multiplications, and its size where it has one."""
    found = []
    for numbers in settings.methods:
        if numbers.multiplications:
            count = stage_function(numbers.multiplications)(inputs, numbers.numbers)
            found.append((numbers.method, "multiplications", "count", count, None))
        own = inputs.get(numbers.method)
        size = read_manifest(own)["notes"].get("size_mb") if own else None
        if size is not None:
            found.append((numbers.method, "model_size", "MB", size, None))
    return found


def differences(ways: Mapping[str, Way], poses: np.ndarray) -> list[tuple[str, str, str, float, int]]:
    """Return how far each backend's vertices are at most from the method's own, in mm."""
    from replicate.timing.backends import largest_difference

    found, expected = [], {}
    for name, way in ways.items():
        method, ending = parted(name)
        if ending and method in ways:
            if method not in expected:
                expected[method] = np.concatenate([ways[method].evaluate(pose[None]) for pose in poses])
            value = largest_difference(way.evaluate, poses, expected[method])
            found.append((name, "largest_difference", "mm", value, len(poses)))
    return found


def _without_truth(numbers: MeasurementNumbers, inputs: Mapping[str, Path]) -> Callable[[np.ndarray], np.ndarray]:
    predict = predictor(numbers, inputs)
    nothing = np.zeros((1, 0, 3), np.float32)
    return lambda params: predict(params, nothing)


# The time of a method's best evaluation: what its weights need, by whichever exact backend is the fastest.


def best_row(rows: Iterable[Row], character: str, method: str, where: str, table: str = "table3") -> Row | None:
    """Return the row with the least mean time of a method among its exact evaluations.

    where: "one_core", "all_cores" or "gpu". table: what the rows' table is called.

    The exact ones give the method's own vertices, but for rounding in float32; weights rounded to 16 bits do not. None
    where there is no row.
    """
    keys = {(table, character, method + ending, f"time_{where}") for ending in EXACT}
    return min((row for row in rows if row.key in keys), key=lambda row: row.value, default=None)


def best_time(rows: Sequence[Row], character: str, method: str, where: str, kind: str = "time") -> float | None:
    """Return the milliseconds of a method's best evaluation, or of a rig. kind: "time", the mean, "median", "p05", …"""
    best = best_row(rows, character, method, where)
    row = find(rows, "table3", character, best.method, f"{kind}_{where}") if best else None
    return row.value if row else None


def is_disturbed(rows: Sequence[Row], character: str, name: str, where: str) -> bool:
    """Return whether the slow evaluations took so much longer than the usual ones that the mean says little."""
    median, p95 = (find(rows, "table3", character, name, f"{kind}_{where}") for kind in ("median", "p95"))
    return bool(median and p95 and p95.value > DISTURBED * median.value)


def cell(rows: Sequence[Row], row: Row | None, where: str) -> str:
    """Return a mean time as tables show it, with a mark where it is disturbed."""
    if row is None:
        return "–"
    mark = "~" if is_disturbed(rows, row.character, row.method, where) else ""
    return mark + round_off(row.value, "ms", row.sd)
