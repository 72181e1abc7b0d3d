"""The process that makes one artefact, seen from the process that started it: start, listen, kill."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Protocol, runtime_checkable

from replicate.engine import store
from replicate.engine.paths import ROOT


@runtime_checkable
class Process(Protocol):
    """What is needed of a worker's process: the part of `subprocess.Popen` that is used here."""

    pid: int
    stdin: IO[bytes]
    stdout: IO[bytes]

    @property
    def returncode(self) -> int | None:
        """The exit code once it is known."""

    def wait(self) -> int:
        """Return the exit code when the process has ended."""


def spawn(orders: dict) -> Process:
    """Start a worker as a new Python."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "replicate.engine.worker"],  # -P: the folder it stands in holds no modules
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=worker_environment(orders),
        start_new_session=True,  # Ctrl-C reaches the scheduler alone, which then ends the workers
    )


class WorkerProcess:
    """A running `replicate.engine.worker`; it ends when this object's process does.

    orders: as `Task.orders` returns them. start: starts the process.
    """

    def __init__(self, orders: dict, start: Callable[[dict], Process] = spawn):
        self.identifier = orders["identifier"]
        self._cache = Path(orders["cache"])
        self._unread = b""
        self._outcome: dict | None = None
        self._process = start(orders)
        with suppress(BrokenPipeError):  # it has died already: `listen` tells
            self._process.stdin.write(json.dumps(orders).encode() + b"\n")
            self._process.stdin.flush()  # and stays open: its end tells the worker that we are gone

    def fileno(self) -> int:
        """Return the file descriptor that is readable when `listen` won't block."""
        return self._process.stdout.fileno()

    def listen(self) -> list[dict]:
        """Return what the worker has said since the last call, waiting for something.

        The last message of all is "done" or "failed"; the process has ended by then.
        """
        data = os.read(self.fileno(), 1 << 16)
        *lines, self._unread = (self._unread + data).split(b"\n")
        messages = []
        for message in map(json.loads, lines):
            if message["event"] in ("done", "failed"):
                self._outcome = message
            else:
                messages.append(message)
        if not data:
            code = self._process.wait()
            self._close()
            messages.append(self._outcome or {"event": "failed", "kind": "died", "message": _manner(code)})
        return messages

    def kill(self) -> None:
        """Send the end to the process and to what its stage has started; `listen` sees them go."""
        if self._process.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def end(self) -> None:
        """Kill the process and return when it is gone; for the thread that listens."""
        self.kill()
        self._process.wait()
        self._close()

    def _close(self) -> None:
        store.discard_partial(self.identifier, self._process.pid, self._cache)
        self._process.stdout.close()
        with suppress(BrokenPipeError):
            self._process.stdin.close()


def thread_limits(threads: int) -> dict[str, str]:
    """Return the environment variables that bound every library's thread pool."""
    libraries = ("OMP", "MKL", "OPENBLAS", "NUMEXPR", "NUMBA", "VECLIB_MAXIMUM")
    waiting = {"OMP_WAIT_POLICY": "passive"}  # waiting threads that spin cost 10 to 90 times on a busy machine
    return {f"{library}_NUM_THREADS": str(threads) for library in libraries} | waiting


def worker_environment(orders: dict) -> dict[str, str]:
    """Return a worker's environment: every library's thread pool bounded before it is loaded, and JAX on the CPU.

    A rig that JAX evaluates on a GPU has other last digits, and each process takes most of its memory. Whoever wants
    that sets JAX_PLATFORMS.
    """
    threads = orders["threads"]
    kernels = {"NUMBA_CACHE_DIR": orders["kernels"]} if orders.get("kernels") else {}  # see `jit_cache`
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen={'true' if threads > 1 else 'false'}"
    return {
        "JAX_PLATFORMS": "cpu",
        **kernels,
        **os.environ,
        **thread_limits(threads),
        "NPROC": str(threads),  # the size of XLA's pool
        "XLA_FLAGS": flags.strip(),
        "PYTHONPATH": str(ROOT),
        "PYTHONUNBUFFERED": "1",
        "REPLICATE_CACHE": orders["cache"],
    }


def _manner(code: int) -> str:
    """Return how a process ended that has not said why: most often it found no memory, even to say so."""
    if code >= 0:
        return f"ended by itself with exit code {code}{', perhaps because memory ran out' if code else ''}"
    hints = {
        signal.SIGKILL: ", probably because memory ran out",
        signal.SIGABRT: ", perhaps because memory ran out",  # std::bad_alloc ends so
        signal.SIGBUS: ", probably because the disk is full",
    }
    return f"was killed by {signal.Signals(-code).name}{hints.get(-code, '')}"
