"""Runs a graph of stages on this machine or on a cluster, shows their progress, and ends all if one fails."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence, Set
from pathlib import Path

from replicate.base.exceptions import InputError, RunError
from replicate.base.signals import ended_by_signals
from replicate.engine import store
from replicate.engine.cluster.config import Cluster, read_cluster
from replicate.engine.display import RunDisplay, StageDisplay, duration
from replicate.engine.executor import Executor, Task
from replicate.engine.provenance import core_count
from replicate.engine.stage import Stage, in_order
from replicate.engine.workers import LocalWorkers

_TICK_S = 0.5  # the longest time between two updates of what is shown
_TRUST_S = 60.0  # of work done, until which the expected times are hardly corrected


def run(
    stages: list[Stage],
    workers: int | None = None,
    facts: dict | None = None,
    cluster: str | None = None,
    foresee: Callable[[list[Stage]], tuple[str, Mapping[str, float | None]]] | None = None,
    failures: dict[str, InputError | RunError] | None = None,
    arrived: Callable[[Set[str]], None] = lambda there: None,
) -> dict[str, Path]:
    """Make what is missing of a graph, and return the artefacts' folders by the stages' titles.

    stages: those to make, the most urgent first; their inputs are made too.
    workers: processes side by side; by default as many as cores.
    facts: provenance for the manifests.
    cluster: where the stages run instead, as CLUSTER names it (see `cluster.config`).
    foresee: missing stages → a line to print first, or "", and the expected seconds of each by its identifier, or None.
    failures: if given, a failed stage stops only those that need it, and its error is put here by its title.
    arrived: called with the identifiers of the artefacts that are there, before one is made and after each that is.

    Prints what was made, or that there was nothing to do. Raises the InputError or RunError of a stage, RunError if one
    fails otherwise or is killed; then all others are ended, as they are by SIGINT, SIGTERM and SIGHUP. Raises
    InputError for a cluster that can't be understood or reached.
    """
    start = time.monotonic()
    elsewhere = read_cluster(cluster) if cluster else None
    graph = in_order(stages)
    store.make_cache_folder()
    with store.used_by_a_run():
        missing = [stage for stage in graph if store.load(stage.identifier) is None]
        if missing:
            line, expected = foresee(missing) if foresee else ("", {})
            if line:
                print(line, flush=True)
            count = workers or core_count()
            forecast = Forecast(expected, None if elsewhere else count)
            there = {stage.identifier for stage in graph} - {stage.identifier for stage in missing}
            arrived(there)
            with ended_by_signals():
                tasks, executor = _tasks(missing, facts or {}), _executor(elsewhere, count)
                lost = _make(tasks, executor, failures, forecast, lambda made: arrived(there | made))
    if not missing:
        print(f"nothing to do: {len(graph)} artefact{'s' * (len(graph) != 1)} up to date", flush=True)
    else:
        took = duration(time.monotonic() - start)
        rest = f"{lost} could not be made" if lost else "the rest were up to date"
        print(f"made {len(missing) - lost} of {len(graph)} artefacts in {took}; {rest}", flush=True)
    return {stage.title: store.artefact_folder(stage.identifier) for stage in graph}


def _executor(cluster: Cluster | None, cores: int) -> Executor:
    if cluster is None:
        return LocalWorkers(cores)
    from replicate.engine.cluster.workers import DaskWorkers  # it loads Dask

    return DaskWorkers(cluster)


def _tasks(missing: list[Stage], facts: dict) -> list[Task]:
    identifiers = {stage.identifier for stage in missing}
    return [
        Task(stage, tuple(sorted(identifiers & {other.identifier for other in stage.inputs})), facts)
        for stage in missing
    ]


class Forecast:
    """About how long a run still takes: expected times, corrected by how long finished stages took."""

    def __init__(self, expected_s: Mapping[str, float | None], workers: int | None):
        """expected_s: by the stages' identifiers. workers: processes side by side, None if that is unknown."""
        self._expected = {name: seconds for name, seconds in expected_s.items() if seconds}
        self._workers, self._most = workers, 1
        self._spent: dict[str, float] = {}

    def done(self, identifier: str, seconds: float) -> None:
        """Note how long a stage took."""
        self._spent[identifier] = seconds

    def left_s(
        self, undone: Sequence[Stage], running_s: Mapping[str, float], at_least_s: Mapping[str, float] | None = None
    ) -> float | None:
        """Return about how many seconds are left, None if nothing is known.

        running_s: how long the running stages have been at it, by their identifiers.
        at_least_s: how long the part that they are at still takes, of those that say it.
        """
        self._most = max(self._most, len(running_s))
        left = self._left(undone, running_s, at_least_s or {})
        return None if left is None else wall_s(undone, left, self._workers or self._most)

    def is_late(self, undone: Sequence[Stage], running_s: Mapping[str, float], at_least_s: Mapping[str, float]) -> bool:
        """Return whether all running stages have taken as long as expected or longer; arguments as of `left_s`.

        What is left no longer shrinks then. Stages whose times nobody knows are not late.
        """
        left = self._left(undone, running_s, at_least_s) or {}
        return not self._known(undone).keys().isdisjoint(running_s) and not any(left.get(name) for name in running_s)

    def _known(self, undone: Sequence[Stage]) -> Mapping[str, float]:
        if self._expected or not self._spent:
            return self._expected
        return dict.fromkeys((stage.identifier for stage in undone), statistics.fmean(self._spent.values()))

    def _left(
        self, undone: Sequence[Stage], running_s: Mapping[str, float], at_least_s: Mapping[str, float]
    ) -> dict[str, float] | None:
        known = self._known(undone)
        if not known and not at_least_s:
            return None
        both = known.keys() & self._spent.keys()
        pace = (sum(self._spent[name] for name in both) + _TRUST_S) / (sum(known[name] for name in both) + _TRUST_S)
        names = [stage.identifier for stage in undone]
        return {
            name: max(at_least_s.get(name, 0.0), pace * known.get(name, 0.0) - running_s.get(name, 0.0))
            for name in names
        }


def wall_s(missing: Sequence[Stage], times: Mapping[str, float | None], workers: int) -> float:
    """Return how long stages take side by side: all work divided by the workers, or the longest chain of inputs.

    times: seconds by the stages' identifiers; unknown ones count as 0.
    """
    times = {name: seconds or 0.0 for name, seconds in times.items()}
    ends: dict[str, float] = {}
    for stage in in_order(list(missing)):
        before = max((ends.get(source.identifier, 0.0) for source in stage.inputs), default=0.0)
        ends[stage.identifier] = before + times.get(stage.identifier, 0.0)
    return max(sum(times.values()) / workers, max(ends.values(), default=0.0))


def _make(
    tasks: list[Task],
    executor: Executor,
    failures: dict[str, InputError | RunError] | None,
    forecast: Forecast,
    arrived: Callable[[Set[str]], None],
) -> int:
    """Run tasks to their end and return how many were lost; raises as `run` does, with nothing left running."""
    lost: set[str] = set()
    made: set[str] = set()
    run_display, next_look_s = RunDisplay(len(tasks)), 0.0
    undone = {task.identifier: task.stage for task in tasks}
    displays: dict[str, StageDisplay] = {}
    try:
        executor.submit(tasks)
        while undone:
            for identifier, message in executor.listen(_TICK_S):
                if identifier in undone:  # a cluster may run a task again whose result was lost
                    display = displays.get(identifier)
                    try:
                        _show(undone[identifier], message, displays)
                    except (InputError, RunError) as error:
                        if failures is None:
                            raise
                        failures[undone[identifier].title] = error
                        lost |= _without(identifier, tasks, undone)
                    if message["event"] == "done" and display:
                        forecast.done(identifier, display.seconds)
                if message["event"] == "done" and undone.pop(identifier, None):
                    made.add(identifier)
                    arrived(made)
            for display in displays.values():
                display.tick()
            if time.monotonic() >= next_look_s:
                next_look_s = time.monotonic() + _TICK_S
                seconds = {name: display.seconds for name, display in displays.items()}
                row = max((display.slot + 1 for display in displays.values()), default=0)
                done = len(tasks) - len(lost) - len(undone)
                parts = {name: display.left_s for name, display in displays.items() if display.left_s}
                known = list(undone.values()), seconds, parts
                run_display.show(done, len(displays), forecast.left_s(*known), row, forecast.is_late(*known))
    finally:
        executor.close()
        run_display.end()
        for display in displays.values():
            display.end("stopped")
    return len(lost)


def _without(identifier: str, tasks: list[Task], undone: dict[str, Stage]) -> set[str]:
    """Remove a task, and all that need it, from those to be done; return their identifiers."""
    lost = {identifier}
    for task in tasks:  # inputs first
        if not lost.isdisjoint(task.needs):
            lost.add(task.identifier)
    for name in lost:
        undone.pop(name, None)
    return lost


def _show(stage: Stage, message: dict, displays: dict[str, StageDisplay]) -> None:
    """Show what an executor reports of a stage; raise the error if it failed or died."""
    event = message["event"]
    if stage.identifier not in displays:
        rows = {display.slot for display in displays.values()}
        row = next(row for row in range(len(rows) + 1) if row not in rows)
        displays[stage.identifier] = StageDisplay(stage.title, row)
    display = displays[stage.identifier]
    if event == "progress":
        display.progress(message["label"], message["done"], message["total"])
    elif event == "waiting":
        display.waiting()
    elif event == "done":
        displays.pop(stage.identifier).end("made" if message["made"] else "made by another process")
    elif event == "failed":
        displays.pop(stage.identifier).end("ended")
        raise _failure(stage, message["kind"], message["message"])


def _failure(stage: Stage, kind: str, message: str) -> InputError | RunError:
    if kind == "InputError":
        return InputError(message)
    if kind == "RunError":
        return RunError(message)
    manner = message if kind == "died" else f"failed ({message})"
    return RunError(f"stage {stage.title} {manner}; its log is {store.log_file(stage.identifier)}")
