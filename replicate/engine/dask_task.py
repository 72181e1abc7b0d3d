"""What a Dask worker does for a stage: it watches over the one process that makes the artefact.

The process has its own memory, threads and heartbeat, as on a single machine; Dask sees a task that returns a few
words. This module is imported by Dask's workers.
"""

import platform
import time
from pathlib import Path
from typing import Any

from distributed import Worker, WorkerPlugin, get_worker

from replicate.engine.shared_cache import not_visible
from replicate.engine.worker_process import WorkerProcess

TOPIC = "replicate"  # of the messages that come in before a task's result: (identifier, message)
_INTERVAL_S = 0.5  # the shortest time between two reports on the same part of a stage

_running: dict[str, WorkerProcess] = {}  # in this Dask worker, by the task's key


class WorkerDied(Exception):
    """The process of a stage died or ran out of memory; Dask may try the stage again elsewhere."""


class KillCancelled(WorkerPlugin):
    """Kills the process of a task that nobody wants any more: Dask itself would wait for its end."""

    name = "replicate-kill-cancelled"
    idempotent = True  # a second run on a scheduler would tear this one down, and kill what the first one runs

    def transition(self, key: object, start: str, finish: str, **kwargs: Any) -> None:
        """Follow a task from one of Dask's states to the next."""
        if finish in ("released", "cancelled", "forgotten") and key in _running:
            _running[key].kill()

    def teardown(self, worker: Worker) -> None:
        """Leave no process behind when the Dask worker ends."""
        for process in list(_running.values()):
            process.kill()


def supervise(orders: dict, inputs: list[dict]) -> dict:
    """Make one artefact in a process of its own and return the last message about it, "done" or "failed".

    orders: as `Task.orders` returns them. inputs: what this function has returned for the stages that it needs.
    Raises WorkerDied if the process was killed, or ran out of memory.
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


def _refuse_cache(orders: dict, what: str) -> dict:
    reason = f"{orders['title']}: the cache {orders['cache']} {what} on {platform.node()}"
    return {"event": "failed", "kind": "RunError", "message": f"{reason}: the machines of a cluster must share it"}
