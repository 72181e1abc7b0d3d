"""Runs a graph of stages: worker processes of one thread each, as many side by side as there are cores."""

import json
import os
import selectors
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from replicate.engine import store
from replicate.engine.code_hash import project_roots, sources_digest
from replicate.engine.display import StageDisplay, duration
from replicate.engine.exceptions import InputError, RunError
from replicate.engine.paths import ROOT
from replicate.engine.provenance import core_count
from replicate.engine.schema import to_json
from replicate.engine.stage import Stage, in_order, input_names


@dataclass
class _Worker:
    stage: Stage
    process: subprocess.Popen
    display: StageDisplay
    threads: int
    outcome: dict | None = None
    unread: bytes = b""


def run(stages: list[Stage], workers: int | None = None, facts: dict | None = None) -> dict[str, Path]:
    """Make what is missing of a graph and return the artefacts' folders by the stages' titles.

    stages: the wanted ones, the more urgent first; what they need is made too. workers: processes side by side, by
    default one a core. facts: provenance for the manifests. Prints what was done, or that there was nothing to do.
    Raises InputError or RunError if a stage does, RunError if one fails or is killed; the others are ended then.
    """
    started = time.monotonic()
    workers = workers or core_count()
    wanted = in_order(stages)
    store.make_cache_folder()
    missing = [stage for stage in wanted if store.load(stage.identifier) is None]
    if not missing:
        print(f"nothing to do: {len(wanted)} artefacts up to date", flush=True)
    else:
        with _ended_by_signals():
            _make(missing, workers, facts or {})
        took = duration(time.monotonic() - started)
        print(f"made {len(missing)} of {len(wanted)} artefacts in {took}; the rest were up to date", flush=True)
    return {stage.title: store.artefact_folder(stage.identifier) for stage in wanted}


def _make(pending: list[Stage], workers: int, facts: dict) -> None:
    running: dict[int, _Worker] = {}  # by slot, which is also the row of its bar
    unmade = {stage.identifier for stage in pending}
    pending = list(pending)
    with selectors.DefaultSelector() as selector:
        try:
            while unmade:
                for stage in _startable(pending, unmade, workers, [worker.threads for worker in running.values()]):
                    slot = next(slot for slot in range(workers) if slot not in running)
                    running[slot] = _start(stage, slot, workers, facts)
                    pending.remove(stage)
                    selector.register(running[slot].process.stdout, selectors.EVENT_READ, slot)
                for ready, _ in selector.select(timeout=0.5):
                    worker = running[ready.data]
                    if _listen(worker):
                        continue
                    selector.unregister(ready.fileobj)
                    del running[ready.data]
                    _finish(worker)
                    unmade.discard(worker.stage.identifier)
                for worker in running.values():
                    worker.display.tick()
        finally:
            for worker in running.values():
                _kill(worker)


def _startable(pending: list[Stage], unmade: set[str], workers: int, busy: list[int]) -> list[Stage]:
    """Return the stages to start now, in their order: inputs made, and threads to spare."""
    chosen, free = [], workers - sum(busy)
    for stage in pending:
        if any(needed.identifier in unmade for needed in stage.inputs):
            continue
        threads = _threads(stage, workers)
        if threads > free:
            break  # an urgent stage that wants more threads is not starved by those behind it
        chosen.append(stage)
        free -= threads
    return chosen


def _threads(stage: Stage, workers: int) -> int:
    return workers if stage.threads == 0 else min(stage.threads, workers)


def _start(stage: Stage, slot: int, workers: int, facts: dict) -> _Worker:
    threads = _threads(stage, workers)
    log = store.log_file(stage.identifier)
    log.parent.mkdir(parents=True, exist_ok=True)
    orders = {
        "identifier": stage.identifier,
        "title": stage.title,
        "name": stage.name,
        "key": stage.key,
        "function": stage.function,
        "sources": sources_digest(stage.function),
        "config": to_json(stage.config),
        "inputs": {name: needed.identifier for name, needed in input_names(stage.inputs).items()},
        "threads": threads,
        "log": str(log),
        "run": facts,
    }
    process = subprocess.Popen(
        [sys.executable, "-m", "replicate.engine.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=_environment(threads),
        start_new_session=True,  # Ctrl-C reaches this process alone, which then ends the workers
    )
    process.stdin.write(json.dumps(orders).encode() + b"\n")
    process.stdin.flush()  # and stays open: its end tells the worker that we are gone
    return _Worker(stage, process, StageDisplay(stage.title, slot), threads)


def thread_limits(threads: int) -> dict[str, str]:
    """Return the environment variables that bound every library's thread pool."""
    libraries = ("OMP", "MKL", "OPENBLAS", "NUMEXPR", "NUMBA", "VECLIB_MAXIMUM")
    waiting = {"OMP_WAIT_POLICY": "passive"}  # waiting threads that spin cost 10 to 90 times on a busy machine
    return {f"{library}_NUM_THREADS": str(threads) for library in libraries} | waiting


def _environment(threads: int) -> dict[str, str]:
    """Return a worker's environment: every library's thread pool bounded before it is loaded."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen={'true' if threads > 1 else 'false'}"
    return {
        **os.environ,
        **thread_limits(threads),
        "NPROC": str(threads),  # the size of XLA's pool
        "XLA_FLAGS": flags.strip(),
        "PYTHONPATH": os.pathsep.join(dict.fromkeys([str(ROOT), *(str(root.resolve()) for root in project_roots())])),
        "PYTHONUNBUFFERED": "1",
        "REPLICATE_CACHE": str(store.cache_folder()),
    }


def _listen(worker: _Worker) -> bool:
    """Take in what a worker says; return False when it has ended."""
    heard = os.read(worker.process.stdout.fileno(), 1 << 16)
    *lines, worker.unread = (worker.unread + heard).split(b"\n")
    for line in lines:
        message = json.loads(line)
        event = message.pop("event")
        if event == "progress":
            worker.display.progress(**message)
        elif event == "waiting":
            worker.display.waiting()
        else:
            worker.outcome = message
    return bool(heard)


def _finish(worker: _Worker) -> None:
    """See how an ended worker fared; raise what its stage raised, or that it failed or was killed."""
    code = worker.process.wait()
    outcome = worker.outcome
    if outcome is not None and "message" not in outcome:
        worker.display.end("made" if outcome["made"] else "made by another process")
        _close(worker)
        return
    worker.display.end("ended")
    _close(worker)
    log = store.log_file(worker.stage.identifier)
    if outcome is None:
        raise RunError(f"stage {worker.stage.title} {_manner(code)}; its log is {log}")
    if outcome["kind"] == "InputError":
        raise InputError(outcome["message"])
    if outcome["kind"] == "RunError":
        raise RunError(outcome["message"])
    raise RunError(f"stage {worker.stage.title} failed ({outcome['message']}); its log is {log}")


def _manner(code: int) -> str:
    if code >= 0:
        return f"ended by itself with exit code {code}"
    hints = {signal.SIGKILL: ", for want of memory perhaps", signal.SIGBUS: ", because the disk is full perhaps"}
    return f"was killed by {signal.Signals(-code).name}{hints.get(-code, '')}"


def _kill(worker: _Worker) -> None:
    try:
        os.killpg(worker.process.pid, signal.SIGKILL)  # the group: what a stage has started ends with it
    except ProcessLookupError:
        pass
    worker.process.wait()
    worker.display.end("stopped")
    _close(worker)


def _close(worker: _Worker) -> None:
    store.discard_partial(worker.stage.identifier)
    worker.process.stdout.close()
    try:
        worker.process.stdin.close()
    except BrokenPipeError:
        pass


@contextmanager
def _ended_by_signals():
    """Turn SIGTERM into an exception while stages run, so that they are ended too; Ctrl-C is one already."""

    def stop(number, frame):
        raise SystemExit(128 + number)

    try:
        before = signal.signal(signal.SIGTERM, stop)
    except ValueError:  # not the main thread: signals are somebody else's
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
