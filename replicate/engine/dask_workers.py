"""Runs stages on a Dask cluster: the whole graph is handed over at once, and Dask decides what runs where."""

import queue
from collections.abc import Sequence
from contextlib import suppress

from distributed import Future, KilledWorker

from replicate.engine import store
from replicate.engine.cluster_config import Cluster
from replicate.engine.dask_clusters import connect
from replicate.engine.dask_task import TOPIC, KillCancelled, supervise
from replicate.engine.exceptions import RunError
from replicate.engine.executor import Task
from replicate.engine.shared_cache import not_visible

_RETRIES = 2  # of a stage whose process was killed or ran out of memory; with luck on another machine
_CLOSED_WITHIN_S = 10.0


class DaskWorkers:
    """The executor that hands stages to a Dask cluster, which it starts and ends unless it runs already.

    Raises InputError or RunError where there is no such cluster.
    """

    def __init__(self, settings: Cluster):
        self._messages: queue.SimpleQueue[tuple[str, dict]] = queue.SimpleQueue()
        self._futures: dict[str, Future] = {}
        self._connection = connect(settings)
        self._address = self._connection.client.scheduler.address

    def submit(self, tasks: Sequence[Task]) -> None:
        """Take the whole graph; raises RunError if a stage wants a GPU and the cluster has none."""
        for task in tasks:
            if task.gpu and not self._connection.gpus:
                raise RunError(f"{task.stage.title} wants a GPU, and no worker of the cluster offers one: DEVICE=cpu")
        client = self._connection.client
        client.register_plugin(KillCancelled())
        client.subscribe_topic(TOPIC, lambda event: self._hear(*event[1]))
        for place, task in enumerate(tasks):
            threads = task.threads(self._connection.cores)
            future = client.submit(
                supervise,
                task.orders(threads),
                [self._futures[need] for need in task.needs],
                key=f"{task.identifier}@{store.cache_folder()}",  # two runs at once share the stages that they share
                resources={"CPU": threads} | ({"GPU": 1} if task.gpu else {}),
                priority=-place,
                retries=_RETRIES,
            )
            self._futures[task.identifier] = future
            future.add_done_callback(lambda future, identifier=task.identifier: self._end(identifier, future))

    def listen(self, timeout_s: float) -> list[tuple[str, dict]]:
        """Return what the cluster has said; raises RunError if it is gone."""
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
        """Take a message of a worker, unless it is on another run's stage; called in Dask's thread."""
        if identifier in self._futures:
            self._messages.put((identifier, message))

    def _end(self, identifier: str, future: Future) -> None:
        """Turn a future that is done into the last message on its stage; called in a thread of Dask."""
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
                message = _failure("died", "was given up, since the Dask workers that ran it died one after the other")
            else:
                message = _failure("died", str(error))
        else:
            message = _failure("RunError", f"the Dask scheduler at {self._address} is gone, or has dropped the stages")
        self._messages.put((identifier, message))


def _failure(kind: str, message: str) -> dict:
    return {"event": "failed", "kind": kind, "message": message}
