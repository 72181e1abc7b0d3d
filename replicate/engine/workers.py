"""Runs stages on this machine: worker processes of one thread each, as many side by side as there are cores."""

import atexit
import ctypes
import gc
import importlib
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from io import BufferedReader, BufferedWriter
from pathlib import Path
from typing import IO, Any, Protocol, runtime_checkable

from replicate.base.command_line import collect_seldom
from replicate.base.paths import ROOT
from replicate.engine import store, worker
from replicate.engine.executor import Task

# The process that makes one artefact, seen from the process that started it: start, listen, kill.


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
    eigen = "--xla_cpu_multi_thread_eigen="
    # once and no more: JAX's cache knows compiled code by the list of flags
    flags = [flag for flag in os.environ.get("XLA_FLAGS", "").split() if not flag.startswith(eigen)]
    flags.append(f"{eigen}{'true' if threads > 1 else 'false'}")
    return {
        "JAX_PLATFORMS": "cpu",
        **os.environ,
        **thread_limits(threads),
        "NPROC": str(threads),  # the size of XLA's pool
        "XLA_FLAGS": " ".join(flags),
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

    def submit(self, tasks: Sequence[Task]) -> None:
        """Take the whole graph."""
        self._pending = list(tasks)
        self._undone = {task.identifier for task in tasks}

    def listen(self, timeout_s: float) -> list[tuple[str, dict]]:
        """Start what can be started, and return what the workers have said."""
        messages: list[tuple[str, dict]] = []
        for task in self._startable():
            threads = task.threads(self._cores)
            worker = WorkerProcess(task.orders(threads), self._start)
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
        for process, _ in self._running.values():
            process.end()
        self._running.clear()
        self._selector.close()
        if self._nursery is not None:
            self._nursery.close()

    def _start(self, orders: dict) -> Process:
        """Start a worker: where it is safe, as a fork of a process that has its libraries."""
        worker = None
        if sys.platform == "linux" and orders["threads"] == 1:
            if self._nursery is None:
                self._nursery = Nursery(worker_environment(orders))
            worker = self._nursery.start(self._libraries)
        return worker or spawn(orders)

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


# Starts worker processes that need not load their libraries: forks of a process that has loaded them (Linux).

_PR_SET_PDEATHSIG = 1
_LONGEST = 1 << 16  # of a request or an answer, in bytes


class Nursery:
    """A nursery and the line to it; environment: of the workers, all alike.

    Python's own forkserver has a fixed list of what it loads before its first process: 4.9 s of a core for all of
    `worker.LIBRARIES`, however short the run. This loads what the stages of a run have needed so far (torch 1.7 s, JAX
    0.7 s), and starts no fork beside a thread, which the other does.
    """

    def __init__(self, environment: Mapping[str, str]):
        self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "replicate.engine.workers", str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                env=dict(environment),
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
            )
        self._codes: dict[int, int] = {}  # of workers that have ended, by their process numbers

    def start(self, libraries: Iterable[str], environment: Mapping[str, str] | None = None) -> "Fork | None":
        """Return a new worker, or None where the nursery can't fork (any more).

        libraries: what to have imported.
        environment: of this worker, if not the nursery's; what libraries read when they are imported stays as it was.
        """
        request = {"libraries": sorted(libraries), "environment": environment and dict(environment)}
        stdin, into = os.pipe()
        out, stdout = os.pipe()
        try:
            socket.send_fds(self._line, [json.dumps(request).encode()], [stdin, stdout])
            answer = self._hear("pid")
        except OSError:
            answer = {"pid": None}
        finally:
            os.close(stdin)
            os.close(stdout)
        if answer["pid"] is None:
            os.close(into)
            os.close(out)
            return None
        return Fork(self, answer["pid"], os.fdopen(into, "wb"), os.fdopen(out, "rb"))

    def code(self, pid: int, wait: bool) -> int | None:
        """Return a worker's exit code, negative for a signal; None if it runs still."""
        while pid not in self._codes and wait:
            try:
                self._hear("code")
            except OSError:  # the nursery is gone, and its workers with it
                self._codes[pid] = -signal.SIGKILL
        return self._codes.get(pid)

    def close(self) -> None:
        """End the nursery."""
        self._line.close()
        self._process.wait()

    def _hear(self, wanted: str) -> dict[str, Any]:
        """Return the next answer of a kind; codes of workers that end meanwhile are noted."""
        while True:
            data = self._line.recv(_LONGEST)
            if not data:
                raise ConnectionResetError
            answer = json.loads(data)
            if "code" in answer:
                self._codes[answer["ended"]] = answer["code"]
            if wanted in answer:
                return answer


class Fork:
    """A worker that a nursery has started, with what is needed of subprocess.Popen."""

    def __init__(self, nursery: Nursery, pid: int, stdin: BufferedWriter, stdout: BufferedReader):
        self.pid, self.stdin, self.stdout = pid, stdin, stdout
        self._nursery = nursery

    @property
    def returncode(self) -> int | None:
        """The exit code once it is known."""
        return self._nursery.code(self.pid, wait=False)

    def wait(self) -> int:
        """Return the exit code when the process has ended."""
        return self._nursery.code(self.pid, wait=True)


def main() -> None:
    """Fork a worker for each request that comes in, and answer with its number; tell each one's end."""
    _die_with_parent()
    collect_seldom()
    warnings.filterwarnings("ignore", "os.fork")  # JAX says so whether or not it has threads
    line = socket.socket(fileno=int(sys.argv[1]))
    ended, wake = os.pipe()
    for end in (ended, wake):
        os.set_blocking(end, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    selector = selectors.DefaultSelector()
    selector.register(line, selectors.EVENT_READ)
    selector.register(ended, selectors.EVENT_READ)
    with suppress(ConnectionError):  # whoever asks is gone
        while True:
            ready = [key.fd for key, _ in selector.select()]
            if ended in ready:
                with suppress(BlockingIOError):
                    os.read(ended, 1 << 12)
                _tell_ends(line)
            if line.fileno() in ready and not _serve(line):
                return


def _serve(line: socket.socket) -> bool:
    """Answer one request; return whether there was one, and not the end of the line."""
    request, descriptors, _, _ = socket.recv_fds(line, _LONGEST, 2)
    if not request:
        return False
    wishes = json.loads(request)
    _load(wishes["libraries"])
    pid = _fork(descriptors, wishes["environment"]) if _threads() == 1 else None
    for descriptor in descriptors:
        os.close(descriptor)
    line.send(json.dumps({"pid": pid}).encode())
    return True


def _load(libraries: Iterable[str]) -> None:
    for name in libraries:
        if name not in sys.modules:
            with suppress(Exception):  # the stage that needs it will say so
                importlib.import_module(name)
    gc.freeze()


def _threads() -> int:
    return len(list(Path("/proc/self/task").iterdir()))


def _fork(descriptors: list[int], environment: dict[str, str] | None) -> int:
    """Return the number of a new process that is a worker with these standard streams and this environment."""
    nursery = os.getpid()
    pid = os.fork()
    if pid:
        with suppress(OSError):  # it is in its group, by itself or by this, before anybody may want to kill the group
            os.setpgid(pid, pid)
        return pid
    code = 1
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        os.setpgid(0, 0)
        _die_with_parent()
        if os.getppid() != nursery:
            os._exit(1)
        for number, descriptor in enumerate(descriptors):
            os.dup2(descriptor, number)
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        if environment is not None:
            os.environ.clear()
            os.environ.update(environment)
        worker.main()
        atexit._run_exitfuncs()
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _tell_ends(line: socket.socket) -> None:
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if not pid:
            return
        line.send(json.dumps({"ended": pid, "code": os.waitstatus_to_exitcode(status)}).encode())


def _die_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


if __name__ == "__main__":
    main()
