"""Runs one stage in a separate process: `python -m replicate.engine.worker`, started by an executor.

It reads its orders, one line of JSON, from standard input and answers in lines of JSON on standard output; what the
stage prints goes to the log. It never outlives the process that started it: the end of standard input ends it.
"""

import ctypes
import json
import os
import platform
import signal
import sys
import threading
import time
import traceback
from pathlib import Path

from replicate.base import progress
from replicate.base.code_hash import are_unchanged, sources_digest
from replicate.base.command_line import collect_seldom, exit_in_words, is_out_of_memory, prepare_streams
from replicate.base.exceptions import InputError, RunError
from replicate.base.paths import ROOT
from replicate.base.schema import from_json
from replicate.engine import store
from replicate.engine.provenance import gpu, peak_memory_mb, surroundings
from replicate.engine.stage import StageContext, stage_function

LIBRARIES = (  # slow to import; none of them starts a second thread then
    "numpy", "scipy.sparse.linalg", "scipy.interpolate", "scipy.spatial", "jax", "numba", "torch", "sklearn.cluster",
    "sklearn.decomposition", "pandas", "matplotlib.figure",
)  # fmt: skip
_PR_SET_PDEATHSIG = 1
_RESERVE_BYTES = 8 << 20  # memory to free for the report of a stage that has run out of it


def main() -> None:
    """Make one artefact as ordered, and report how it went."""
    # never outlive the process that gives the orders
    if sys.platform == "linux":  # at once, even while a compiled kernel runs; elsewhere the watchdog has to do
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    line = sys.stdin.readline()
    if not line:  # the process that started this one was gone before the lines above
        return
    orders = json.loads(line)
    sys.path += [
        folder for folder in orders["path"] if folder not in sys.path
    ]  # at the end, so that they hide no library
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # standard output is for answers: what the stage prints goes to the log
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    log_file = store.log_file(orders["identifier"])
    log_file.parent.mkdir(parents=True, exist_ok=True)
    log = os.open(log_file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    os.dup2(log, 1)
    os.dup2(log, 2)
    collect_seldom()
    prepare_streams()
    speaking = threading.Lock()
    reserve = bytearray(_RESERVE_BYTES)

    def answer(event: str, **facts) -> None:
        with speaking:
            answers.write(json.dumps({"event": event, **facts}) + "\n")

    progress.report_to(lambda label, steps, total: answer("progress", label=label, done=steps, total=total))
    try:
        calls = []
        store.make(
            orders["identifier"],
            lambda out, scratch: calls.append(1) or _build(orders, out, scratch),
            lambda: answer("waiting"),
        )
        answer("done", made=bool(calls), libraries=[name for name in LIBRARIES if name in sys.modules])
    except (InputError, RunError) as error:
        answer("failed", kind=type(error).__name__, message=str(error))
    except SystemExit as end:
        answer("failed", kind="Exception", message=exit_in_words(end))
    except Exception as error:
        del reserve
        words = f"{type(error).__name__}: {error}".splitlines()[0].removesuffix(": ")
        if is_out_of_memory(error):
            answer("failed", kind="died", message=f"ran out of memory ({words})")
        else:
            answer("failed", kind="Exception", message=words)
        traceback.print_exc()
        sys.stderr.flush()


def _build(orders: dict, out: Path, scratch: Path) -> dict:
    """Run the stage's function and return the facts for the artefact's manifest."""
    start = time.monotonic()
    inputs = {name: store.load(identifier) for name, identifier in orders["inputs"].items()}
    for name, folder in inputs.items():
        if folder is None:
            raise RunError(f"{orders['title']}: input {name} is damaged or gone; run the same command to make it again")
    resumed = any(scratch.iterdir())
    config = from_json(orders["config"])
    files = tuple(map(Path, orders["files"]))
    context = StageContext(orders["name"], config, inputs, out, scratch, orders["threads"], files)
    function = stage_function(orders["function"])
    _check_sources(orders)
    function(context)
    return {
        "stage": orders["title"],
        "key": orders["key"],
        "function": orders["function"],
        "sources": orders["sources"],
        "config": orders["config"],
        "inputs": orders["inputs"],
        "notes": context.notes,
        "wall_s": round(time.monotonic() - start, 3),
        "resumed": resumed,
        "threads": orders["threads"],
        "peak_memory_mb": round(peak_memory_mb()),
        "gpu": gpu(),
        "surroundings": surroundings(),
        "run": orders["run"],
    }


def _check_sources(orders: dict) -> None:
    """Raise RunError if this machine's sources are no longer those that the artefact's key was made from."""
    if are_unchanged(orders["texts"]):  # as almost always; parsing them would take half a second
        return
    if sources_digest(orders["function"]) != orders["sources"]:
        raise RunError(
            f"{orders['title']}: the sources in {ROOT} on {platform.node()} are not those that the run was started "
            "with; bring them to one state and run the same command again"
        )


def _end_with_parent() -> None:
    os.read(0, 1)  # blocks until the parent is gone
    os._exit(1)


if __name__ == "__main__":
    main()
