"""Time rigs and their methods' models together, and return the rows of Table 3.

Torch and the backends take seconds to import. They are imported only when something is timed, since graphs and tables
need settings and rows alone.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_recipes.rig import Rig, has_function
from replicate.approximation.metrics import unique_poses
from replicate.approximation.rigid import attach
from replicate.engine.provenance import core_count
from replicate.engine.stage import stage_function
from replicate.engine.store import read_manifest
from replicate.methods import artefacts
from replicate.methods.measurement import MeasurementSettings, predictor
from replicate.report.results import Row, find, run_name, write_results
from replicate.report.tables import our_value
from replicate.timing.single_poses import (
    BACKENDS,
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
class RigSettings:
    """What is timed of one rig, and how often.

    character, profile: for the columns of its rows
    methods: how each method predicts
    models: (method, "module:function" of its model) for methods with a model
    turns: evaluations of each way
    sources: (name, title) of each stage that the rig and the methods are read from
    file: the name of the file with its rows
    """

    character: str
    profile: str
    methods: tuple[MeasurementSettings, ...]
    models: tuple[tuple[str, str], ...]
    turns: int
    sources: tuple[tuple[str, str], ...]
    file: str

    def inputs_of(self, inputs: Mapping[str, Path]) -> dict[str, Path]:
        """Return this rig's artefacts by their stages' names, from those of all rigs by their stages' titles."""
        return {name: inputs[title] for name, title in self.sources}


@dataclass(frozen=True)
class TimingSettings:
    """The rigs that are timed together, and the time of the request, so that no later run reuses a measurement."""

    rigs: tuple[RigSettings, ...]
    measured: str


@dataclass(frozen=True)
class RowsSettings:
    """The file of the measurement that has a rig's rows."""

    file: str


NODES_EVERY = 2  # node by node, which takes long, the rig is evaluated in every second turn
PEERS_EVERY = 5  # where a method has a fast evaluation, its others run in every fifth turn
ROUND = 50  # turns of a rig and its methods before those of the next rig
DISTURBED = 1.5  # 95th percentile over median: beyond it something else ran on the machine
COMPARED = 20  # poses in which every backend is compared with the method's own prediction
ONE, ALL, GRAPHICS = "one_core", "all_cores", "gpu"  # where a time is measured, and endings of the metrics


def write_all(rigs: Sequence[RigSettings], inputs: Mapping[str, Path], progress: Callable, out: Path) -> None:
    """Write the rows of some rigs to a folder, one file each.

    inputs: artefacts of all rigs by their stages' titles. progress: (total, label) → a context manager.
    """
    timed = {}
    with progress(len(rigs), "loading") as bar:
        for rig in rigs:
            timed[rig] = TimedRig(rig, rig.inputs_of(inputs))
            bar.update(1)
    take_turns(timed, progress)
    for rig, timed_rig in timed.items():
        write_results(out / rig.file, timed_rig.rows())


def take_turns(timed: Mapping[RigSettings, "TimedRig"], progress: Callable) -> None:
    """Time all rigs in rounds: in each, every rig on all cores, on one core and on a GPU, where there is one.

    Other work of the machine comes and goes within seconds to minutes. In rounds it slows all rigs alike; if each rig
    were timed at a stretch, it would slow some more than others.
    """
    wheres = [where for where, _ in settings_of_cores()]
    most = max(rig.turns for rig in timed)
    with without_collections(), progress(len(wheres) * sum(rig.turns for rig in timed), "timing") as bar:
        for first in range(0, most, ROUND):
            for rig, timed_rig in timed.items():
                for where, confined in settings_of_cores():
                    with confined:
                        timed_rig.turns[where].take(max(0, min(ROUND, rig.turns - first)), bar.update)


class TimedRig:
    """A rig and its methods: all ways to evaluate a pose, and their turns on all cores, on one core and on a GPU."""

    def __init__(self, settings: RigSettings, inputs: Mapping[str, Path]):
        """Load the rig and its methods. inputs: artefacts by the names of their stages."""
        rig, samples = artefacts.load_rig(inputs), artefacts.load_samples(inputs)
        self._settings, self._inputs = settings, inputs
        self._poses = np.asarray(samples.test_params[unique_poses(samples.test_params)], np.float32)
        self._ways = ways_of(settings, inputs, rig)
        self.turns = {where: Turns(ways_on(where, self._ways), self._poses) for where, _ in settings_of_cores()}

    def rows(self) -> list[Row]:
        """Return the rig's rows."""
        settings, poses = self._settings, self._poses
        facts = settings.profile, run_name(self._inputs)
        values = [
            (name, f"{metric}_{where}", "ms", value, times.evaluations)
            for where, turns in self.turns.items()
            for name, times in turns.times().items()
            for metric, value in metrics(times)
        ]
        values += [(RIG, "cores", "count", core_count(), None), *costs(settings, self._inputs)]
        values += differences(self._ways, poses[:: -(-len(poses) // COMPARED)])
        return [
            Row("table3", settings.character, method, metric, unit, float(value), None, 1, evaluations, *facts)
            for method, metric, unit, value, evaluations in values
        ]


def settings_of_cores() -> Iterator[tuple[str, AbstractContextManager[None]]]:
    """Yield each of `ALL`, `ONE` and `GRAPHICS` that this machine can measure, with the context to measure it in.

    On a GPU the rigid step has all cores.
    """
    import torch

    from replicate.timing.machine import can_confine, one_core, threads

    yield ALL, threads(core_count())
    if can_confine():
        yield ONE, one_core()
    if torch.cuda.is_available():
        yield GRAPHICS, threads(core_count())


def ways_on(where: str, ways: Mapping[str, Way]) -> dict[str, Way]:
    """Return the ways that are timed in a place: on one core those that use several threads are left out."""
    left_out = {ONE: (*THREADED, *ON_GPU), ALL: ON_GPU, GRAPHICS: {*BACKENDS} - {*ON_GPU}}[where]
    return {name: way for name, way in ways.items() if parted(name)[1] not in left_out}


def metrics(times: Times) -> list[tuple[str, float]]:
    """Return (beginning of a metric's name, value) for the times of one way."""
    return [("time", times.mean), ("median", times.median), ("p05", times.p05), ("p95", times.p95)]


def ways_of(settings: RigSettings, inputs: Mapping[str, Path], rig: Rig) -> dict[str, Way]:
    """Return all ways that are timed, by name.

    They are the rig compiled and, where it has nodes, node by node; every method, as the suite evaluates it and by all
    other backends; and the rigid step alone, which all approximations contain. A rig that is known by its samples alone
    is not timed.
    """
    from replicate.timing.backends import fast_rigid_step, gpu_backends, other_backends

    mesh, attachments = rig.mesh, artefacts.load_attachments(inputs)
    ways = {RIG: Way(rig)} if has_function(rig) else {}
    if run_nodes := getattr(rig, "run_nodes", None):
        ways[NODES] = Way(run_nodes, NODES_EVERY)
    models = dict(settings.models)
    for entry in settings.methods:
        backends = {"": _without_truth(entry, inputs)}
        model = stage_function(models[entry.method])(inputs) if entry.method in models else None
        if model is not None:
            backends |= other_backends(model, mesh, attachments) | gpu_backends(model, mesh, attachments)
        for ending, evaluate in backends.items():
            ways[entry.method + ending] = Way(evaluate, turns_of(ending, backends))
    posed = rig(rig.default[None])
    ways[RIGID_STEP] = Way(lambda params: attach(mesh, attachments, posed))
    ways[RIGID_STEP + FAST] = Way(fast_rigid_step(mesh, attachments, posed))
    return ways


def turns_of(ending: str, endings: Collection[str]) -> int:
    """Return how many turns apart an evaluation runs. ending: its ending; endings: those of all for the same model."""
    return PEERS_EVERY if FAST in endings and ending not in (FAST, HALF, *ON_GPU) else 1


def costs(settings: RigSettings, inputs: Mapping[str, Path]) -> list[tuple[str, str, str, float, None]]:
    """Return each method's multiplications for a pose, and its size, where they are known."""
    found = []
    for entry in settings.methods:
        if entry.multiplications:
            count = stage_function(entry.multiplications)(inputs, entry.settings)
            found.append((entry.method, "multiplications", "count", count, None))
        folder = inputs.get(entry.method)
        size = read_manifest(folder)["notes"].get("size_mb") if folder else None
        if size is not None:
            found.append((entry.method, "model_size", "MB", size, None))
    return found


def differences(ways: Mapping[str, Way], poses: np.ndarray) -> list[tuple[str, str, str, float, int]]:
    """Return the largest distance of each backend's vertices from the method's own, in mm."""
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


def _without_truth(settings: MeasurementSettings, inputs: Mapping[str, Path]) -> Callable[[np.ndarray], np.ndarray]:
    predict = predictor(settings, inputs)
    nothing = np.zeros((1, 0, 3), np.float32)
    return lambda params: predict(params, nothing)


# The time of a method's best evaluation, by the fastest of all exact backends.


def best_row(rows: Iterable[Row], character: str, method: str, where: str, table: str = "table3") -> Row | None:
    """Return the row with a method's least mean time among its exact evaluations, or None.

    Exact ones give the method's own vertices up to rounding in float32; weights rounded to 16 bits do not.

    method: a method, or an evaluation of the rig
    where: "one_core", "all_cores" or "gpu"
    table: the name of the rows' table
    """
    metric, names = f"time_{where}", {method + ending for ending in EXACT}
    timed = (row for row in rows if row.metric == metric and row.method in names)
    own = (row for row in timed if row.character == character and row.table == table)
    return min(own, key=lambda row: row.value, default=None)


def best_time(rows: Sequence[Row], character: str, method: str, where: str, kind: str = "time") -> float | None:
    """Return the milliseconds of a method's best evaluation, or of a rig, or None.

    method: a method, or an evaluation of the rig
    where: "one_core", "all_cores" or "gpu"
    kind: "time", which is the mean, or "median", "p05", "p95"
    """
    best = best_row(rows, character, method, where)
    row = find(rows, "table3", character, best.method, f"{kind}_{where}") if best else None
    return row.value if row else None


def is_disturbed(rows: Sequence[Row], character: str, name: str, where: str) -> bool:
    """Return whether the slowest evaluations took so much longer than the usual ones that the mean says little."""
    median, p95 = (find(rows, "table3", character, name, f"{kind}_{where}") for kind in ("median", "p95"))
    return bool(median and p95 and p95.value > DISTURBED * median.value)


def cell(rows: Sequence[Row], row: Row | None, where: str) -> str:
    """Return a mean time for a table, with a mark where it is disturbed."""
    if row is None:
        return "–"
    mark = "~" if is_disturbed(rows, row.character, row.method, where) else ""
    return mark + our_value(row)
