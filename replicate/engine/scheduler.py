"""Runs a graph of stages on this machine or on a cluster, shows how far they are, and ends all if one fails."""

import time
from collections.abc import Callable
from pathlib import Path

from replicate.base.exceptions import InputError, RunError
from replicate.base.signals import ended_by_signals
from replicate.engine import store
from replicate.engine.cluster.config import Cluster, read_cluster
from replicate.engine.display import StageDisplay, duration
from replicate.engine.executor import Executor, Task
from replicate.engine.provenance import core_count
from replicate.engine.stage import Stage, in_order
from replicate.engine.workers import LocalWorkers

_TICK_S = 0.5  # the longest time between two looks at what is shown


def run(
    stages: list[Stage],
    workers: int | None = None,
    facts: dict | None = None,
    cluster: str | None = None,
    foresee: Callable[[list[Stage]], str] | None = None,
    failures: dict[str, InputError | RunError] | None = None,
) -> dict[str, Path]:
    """Make what is missing of a graph and return the artefacts' folders by the stages' titles.

    stages: those to make, the more urgent first; their inputs are made too. workers: processes side by side, by
    default one a core. facts: provenance for the manifests. cluster: where they run instead, as CLUSTER names it (see
    `cluster_config`). foresee: what is missing → a line to print before it is made, "" for none. failures: where given,
    a stage that fails costs only what needs it, and its error is put there by its title. Prints what was done, or
    that there was nothing to do. Raises InputError or RunError if a stage does, RunError if one fails or is killed;
    the others are ended then, as they are by SIGINT, SIGTERM and SIGHUP. Raises InputError for a cluster that is none
    or can't be reached.
    """
    start = time.monotonic()
    elsewhere = read_cluster(cluster) if cluster else None
    graph = in_order(stages)
    store.make_cache_folder()
    with store.used_by_a_run():
        missing = [stage for stage in graph if store.load(stage.identifier) is None]
        if missing:
            if line := foresee(missing) if foresee else "":
                print(line, flush=True)
            with ended_by_signals():
                lost = _make(_tasks(missing, facts or {}), _executor(elsewhere, workers or core_count()), failures)
    if not missing:
        print(f"nothing to do: {len(graph)} artefacts up to date", flush=True)
    else:
        took = duration(time.monotonic() - start)
        rest = f"{lost} could not be made" if lost else "the rest were up to date"
        print(f"made {len(missing) - lost} of {len(graph)} artefacts in {took}; {rest}", flush=True)
    return {stage.title: store.artefact_folder(stage.identifier) for stage in graph}


def _executor(cluster: Cluster | None, cores: int) -> Executor:
    if cluster is None:
        return LocalWorkers(cores)
    from replicate.engine.cluster.workers import DaskWorkers  # Dask is loaded for those alone who ask for it

    return DaskWorkers(cluster)


def _tasks(missing: list[Stage], facts: dict) -> list[Task]:
    identifiers = {stage.identifier for stage in missing}
    return [
        Task(stage, tuple(sorted(identifiers & {other.identifier for other in stage.inputs})), facts)
        for stage in missing
    ]


def _make(tasks: list[Task], executor: Executor, failures: dict[str, InputError | RunError] | None) -> int:
    """Run tasks to their end and return how many were lost; raises as `run` does, with nothing left running."""
    lost: set[str] = set()
    undone = {task.identifier: task.stage for task in tasks}
    displays: dict[str, StageDisplay] = {}
    try:
        executor.submit(tasks)
        while undone:
            for identifier, message in executor.listen(_TICK_S):
                if identifier in undone:  # a cluster may run a task again whose result was lost
                    try:
                        _show(undone[identifier], message, displays)
                    except (InputError, RunError) as error:
                        if failures is None:
                            raise
                        failures[undone[identifier].title] = error
                        lost |= _without(identifier, tasks, undone)
                if message["event"] == "done":
                    undone.pop(identifier, None)
            for display in displays.values():
                display.tick()
    finally:
        executor.close()
        for display in displays.values():
            display.end("stopped")
    return len(lost)


def _without(identifier: str, tasks: list[Task], undone: dict[str, Stage]) -> set[str]:
    """Take a task and all that need it from those to be done, and return their identifiers."""
    lost = {identifier}
    for task in tasks:  # inputs first
        if not lost.isdisjoint(task.needs):
            lost.add(task.identifier)
    for one in lost:
        undone.pop(one, None)
    return lost


def _show(stage: Stage, message: dict, displays: dict[str, StageDisplay]) -> None:
    """Show what an executor tells of a stage; raise what the stage has raised, or that it died."""
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
