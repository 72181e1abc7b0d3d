"""Starts worker processes that need not load their libraries: forks of a process that has loaded them (Linux).

A worker takes seconds to import torch, JAX or scikit-learn, which is longer than many a stage takes. The nursery is a
process of one thread that has imported the libraries which earlier stages of the run have needed, and computes nothing.
A worker is a fork of it, with its own memory, process group and standard streams. To fork is safe as long as no
library has started a thread or touched a device, so only workers of one thread come from here, and the nursery counts
its threads before each fork. Everything else, other systems and Dask's workers are started by `worker_process.spawn`.
"""

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
from collections.abc import Iterable, Mapping
from contextlib import suppress
from io import BufferedReader, BufferedWriter
from pathlib import Path
from typing import Any

from replicate.engine import worker

_PR_SET_PDEATHSIG = 1
_LONGEST = 1 << 16  # of a request or an answer, in bytes


class Nursery:
    """A nursery and the line to it; environment: of the workers, all alike."""

    def __init__(self, environment: Mapping[str, str]):
        self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "replicate.engine.worker_nursery", str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                env=dict(environment),
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
            )
        self._codes: dict[int, int] = {}  # of workers that have ended, by their process numbers

    def start(self, libraries: Iterable[str]) -> "Fork | None":
        """Return a new worker, or None where the nursery can't fork (any more); libraries: what to have imported."""
        stdin, into = os.pipe()
        out, stdout = os.pipe()
        try:
            socket.send_fds(self._line, [json.dumps(sorted(libraries)).encode()], [stdin, stdout])
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
    _load(json.loads(request))
    pid = _fork(descriptors) if _threads() == 1 else None
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


def _fork(descriptors: list[int]) -> int:
    """Return the number of a new process that is a worker with these standard streams."""
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
