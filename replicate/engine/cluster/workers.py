"""Runs stages on a Dask cluster: the whole graph is handed over at once, and Dask decides what runs where."""

import os
import platform
import queue
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from distributed import Future, KilledWorker, Worker, WorkerPlugin, get_worker

from replicate.base.exceptions import RunError
from replicate.engine import store
from replicate.engine.cluster.clusters import connect
from replicate.engine.cluster.config import Cluster
from replicate.engine.executor import Task
from replicate.engine.workers import WorkerProcess

_RETRIES = 2  # of a stage whose process was killed or ran out of memory; perhaps on another machine
_CLOSED_WITHIN_S = 10.0


class DaskWorkers:
    """The executor that gives stages to a Dask cluster, which it starts and ends unless it is running already.

    Raises InputError or RunError if there is no such cluster.
    """

    def __init__(self, settings: Cluster):
        self._messages: queue.SimpleQueue[tuple[str, dict]] = queue.SimpleQueue()
        self._futures: dict[str, Future] = {}
        self._connection = connect(settings)
        self._address = self._connection.client.scheduler.address

    def submit(self, tasks: Sequence[Task]) -> None:
        """Accept the whole graph; raise RunError if a stage needs a GPU and the cluster has none."""
        for task in tasks:
            if task.gpu and not self._connection.gpus:
                raise RunError(f"{task.stage.title} needs a GPU, and no worker offers one: use DEVICE=cpu")
        client = self._connection.client
        client.register_plugin(KillCancelled())
        client.subscribe_topic(TOPIC, lambda event: self._hear(*event[1]))
        for place, task in enumerate(tasks):
            threads = task.threads(self._connection.cores)
            future = client.submit(
                supervise,
                task.orders(threads),
                [self._futures[need] for need in task.needs],
                key=f"{task.identifier}@{store.cache_folder()}",  # two runs make a stage that both need once
                resources={"CPU": threads} | ({"GPU": 1} if task.gpu else {}),
                priority=-place,
                retries=_RETRIES,
            )
            self._futures[task.identifier] = future
            future.add_done_callback(lambda future, identifier=task.identifier: self._end(identifier, future))

    def listen(self, timeout_s: float) -> list[tuple[str, dict]]:
        """Return the messages of the cluster; raise RunError if it is gone."""
        self._connection.watch()
        messages = []
        with suppress(queue.Empty):
            messages.append(self._messages.get(timeout=timeout_s))
            while True:
                messages.append(self._messages.get_nowait())
        return messages

    def close(self) -> None:
        """Kill what still runs: Dask drops the tasks, and each worker kills its processes."""
        connection = self._connection
        with suppress(OSError, TimeoutError):
            connection.client.cancel(list(self._futures.values()))
        connection.client.close(timeout=_CLOSED_WITHIN_S)
        if connection.cluster is not None:
            connection.cluster.close(timeout=_CLOSED_WITHIN_S)

    def _hear(self, identifier: str, message: dict) -> None:
        """Keep a worker's message unless it is about another run's stage; called in a thread of Dask."""
        if identifier in self._futures:
            self._messages.put((identifier, message))

    def _end(self, identifier: str, future: Future) -> None:
        """Turn a finished future into the last message about its stage; called in a thread of Dask."""
        if future.status == "finished":
            message = future.result()
            if message["event"] == "done" and not_visible(store.cache_folder(), [identifier]):
                message = _failure(
                    "RunError",
                    f"{identifier} isn't in the cache {store.cache_folder()} though a worker "
                    "has put it there: the machines of a cluster must share it",
                )
        elif future.status == "error":
            error = future.exception()
            if isinstance(error, KilledWorker):
                message = _failure("died", "was given up, since the Dask workers that ran it died one after another")
            else:
                message = _failure("died", str(error))
        else:
            message = _failure("RunError", f"the Dask scheduler at {self._address} is gone, or has dropped the stages")
        self._messages.put((identifier, message))


def _failure(kind: str, message: str) -> dict:
    return {"event": "failed", "kind": kind, "message": message}


# What a Dask worker does for a stage: it watches the process that makes the artefact.

TOPIC = "replicate"  # of the messages before a task's result: (identifier, message)
_INTERVAL_S = 0.5  # the shortest time between two reports of the same part of a stage

_running: dict[str, WorkerProcess] = {}  # in this Dask worker, by the task's key


class WorkerDied(Exception):
    """The process of a stage died or ran out of memory; Dask may try the stage again elsewhere."""


class KillCancelled(WorkerPlugin):
    """Kills the process of a cancelled task: Dask itself would wait for its end."""

    name = "replicate-kill-cancelled"
    idempotent = True  # or a second run would tear this one down, and kill what the first is running

    def transition(self, key: object, start: str, finish: str, **kwargs: Any) -> None:
        """Follow a task from one of Dask's states to the next."""
        if finish in ("released", "cancelled", "forgotten") and key in _running:
            _running[key].kill()

    def teardown(self, worker: Worker) -> None:
        """Leave no process behind when the Dask worker ends."""
        for process in list(_running.values()):
            process.kill()


def supervise(orders: dict, inputs: list[dict]) -> dict:
    """Make one artefact in a separate process and return the last message about it, "done" or "failed".

    orders: as `Task.orders` returns them.
    inputs: what this function has returned for the stages that this one needs.

    Raises WorkerDied if the process was killed or ran out of memory.
    """
    failures = [outcome for outcome in inputs if outcome["event"] == "failed"]
    if failures:
        return failures[0]
    identifier, dask_worker = orders["identifier"], get_worker()
    cache = Path(orders["cache"])
    if not cache.is_dir():
        return _refuse_cache(orders, "is not there")
    if hidden := not_visible(cache, set(orders["inputs"].values())):
        return _refuse_cache(orders, f"does not hold {hidden[0]}")
    key = dask_worker.get_current_task()
    process = _running[key] = WorkerProcess(orders)
    try:
        dask_worker.log_event(TOPIC, (identifier, {"event": "started"}))
        last_report, label = -float("inf"), ""
        while True:
            for message in process.listen():
                if message["event"] in ("done", "failed"):
                    if message.get("kind") == "died":
                        raise WorkerDied(f"{message['message']}, on {platform.node()}")
                    return message
                soon = message["event"] == "progress" and message["label"] == label
                if soon and time.monotonic() - last_report < _INTERVAL_S:
                    continue
                last_report, label = time.monotonic(), message.get("label", label)
                dask_worker.log_event(TOPIC, (identifier, message))
    finally:
        del _running[key]


def _refuse_cache(orders: dict, fault: str) -> dict:
    where = f"{orders['title']}: the cache {orders['cache']} {fault} on {platform.node()}"
    return _failure("RunError", f"{where}: the machines of a cluster must share it")


# On a network file system other machines see a new artefact only after a while.

VISIBLE_WITHIN_S = 90.0  # NFS reads a folder again after 60 seconds at the latest, by default


def not_visible(cache: Path, identifiers: Iterable[str], timeout_s: float = VISIBLE_WITHIN_S) -> list[str]:
    """Return those artefacts that this machine doesn't see in a cache after waiting for them."""
    deadline = time.monotonic() + timeout_s
    while True:
        with os.scandir(cache) as entries:  # makes NFS read the folder again
            standing = {entry.name for entry in entries}
        hidden = [identifier for identifier in identifiers if identifier not in standing]
        if not hidden or time.monotonic() >= deadline:
            return hidden
        time.sleep(0.5)
