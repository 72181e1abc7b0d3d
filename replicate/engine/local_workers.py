"""Runs stages on this machine: worker processes of one thread each, as many side by side as there are cores."""

import os
import selectors
import sys
from collections.abc import Sequence
from tempfile import TemporaryDirectory

from replicate.engine.executor import Task
from replicate.engine.worker_nursery import Nursery
from replicate.engine.worker_process import Process, WorkerProcess, spawn, worker_environment


class LocalWorkers:
    """The executor that needs nothing beside this machine; cores: how many threads may run at once."""

    def __init__(self, cores: int):
        self._cores = cores
        self._pending: list[Task] = []
        self._undone: set[str] = set()
        self._running: dict[str, tuple[WorkerProcess, int]] = {}  # and its threads, by identifier
        self._selector = selectors.DefaultSelector()
        self._nursery: Nursery | None = None
        self._libraries: set[str] = set()  # that stages of this run have needed
        self._kernels: TemporaryDirectory | None = None

    def submit(self, tasks: Sequence[Task]) -> None:
        """Take the whole graph."""
        self._pending = list(tasks)
        self._undone = {task.identifier for task in tasks}

    def listen(self, timeout_s: float) -> list[tuple[str, dict]]:
        """Start what can be started, and return what the workers have said."""
        messages: list[tuple[str, dict]] = []
        for task in self._startable():
            threads = task.threads(self._cores)
            worker = WorkerProcess(task.orders(threads) | self._kernels_of(task), self._start)
            self._running[task.identifier] = worker, threads
            self._selector.register(worker, selectors.EVENT_READ, task.identifier)
            self._pending.remove(task)
            messages.append((task.identifier, {"event": "started"}))
        for ready, _ in self._selector.select(0 if messages else timeout_s):
            descriptor, identifier = ready.fd, ready.data
            for message in self._running[identifier][0].listen():
                messages.append((identifier, message))
                self._libraries.update(message.pop("libraries", ()))
                if message["event"] in ("done", "failed"):
                    self._selector.unregister(descriptor)
                    del self._running[identifier]
                if message["event"] == "done":
                    self._undone.discard(identifier)
        return messages

    def close(self) -> None:
        """Kill what still runs."""
        for worker, _ in self._running.values():
            worker.end()
        self._running.clear()
        self._selector.close()
        if self._nursery is not None:
            self._nursery.close()
        if self._kernels is not None:
            self._kernels.cleanup()

    def _start(self, orders: dict) -> Process:
        """Start a worker: where it is safe, as a fork of a process that has its libraries."""
        worker = None
        if sys.platform == "linux" and orders["threads"] == 1:
            if self._nursery is None:
                self._nursery = Nursery(worker_environment(orders))
            worker = self._nursery.start(self._libraries)
        return worker or spawn(orders)

    def _kernels_of(self, task: Task) -> dict[str, str]:
        """Return the order to keep the code of Numba's kernels in a folder of this run, for stages that run alone.

        Each of them is spared what another has compiled. Others get none: processes that write to such a folder at once
        can mistake the code of one signature for another's.
        """
        if task.stage.threads or "NUMBA_CACHE_DIR" in os.environ:
            return {}
        if self._kernels is None:
            try:
                self._kernels = TemporaryDirectory(prefix="replicate-kernels-", ignore_cleanup_errors=True)
            except OSError:  # no room for temporary files: each stage compiles its own
                return {}
        return {"kernels": self._kernels.name}

    def _startable(self) -> list[Task]:
        """Return the tasks to start now, in their order: inputs done, and threads to spare."""
        selection, free = [], self._cores - sum(threads for _, threads in self._running.values())
        for task in self._pending:
            if not self._undone.isdisjoint(task.needs):
                continue
            threads = task.threads(self._cores)
            if threads > free:
                break  # an urgent stage that wants more threads is not starved by those behind it
            selection.append(task)
            free -= threads
        return selection
