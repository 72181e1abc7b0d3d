"""Small stages that stand in for the real ones, so that the machinery can be tested in seconds."""

import json
import os
import resource
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from replicate.base.exceptions import InputError
from replicate.base.schema import Checked, number
from replicate.base.signals import FROM_MAKE
from replicate.engine.stage import Stage


@dataclass(frozen=True)
class ToyConfig(Checked):
    """What a toy stage does."""

    seed: int = 0
    steps: int = number(3, 0)
    pause_s: float = number(0.0, 0.0)
    fault: str = ""


@dataclass(frozen=True)
class ToyDevice(Checked):
    """What a toy stage runs on."""

    device: str = "cpu"


def numbers(context) -> None:
    """Write random numbers, a step at a time, with a checkpoint after every step."""
    if "TOY_BUILDS" in os.environ:
        with open(os.environ["TOY_BUILDS"], "a") as stream:
            stream.write(f"{context.name} {context.config.seed}\n")
    checkpoint = context.scratch / "steps.json"
    values = json.loads(checkpoint.read_text()) if checkpoint.exists() else []
    with context.progress(context.config.steps, "counting", len(values)) as bar:
        for step in range(len(values), context.config.steps):
            time.sleep(context.config.pause_s)
            values.append(float(context.rng(f"step {step}").normal()))
            beside = checkpoint.with_suffix(".new")
            beside.write_text(json.dumps(values))
            os.replace(beside, checkpoint)
            bar.update()
    (context.out / "numbers.json").write_text(json.dumps(values))
    context.note(count=len(values))


def total(context) -> None:
    """Add up what the inputs hold."""
    folders = sorted(set(context.inputs.values()))
    time.sleep(context.config.pause_s)
    sums = [sum(json.loads((folder / "numbers.json").read_text())) for folder in folders]
    (context.out / "numbers.json").write_text(json.dumps(sums))
    (context.out / "folder").mkdir()
    (context.out / "folder" / "nested.txt").write_text("nested")


def faulty(context) -> None:
    """Fail in the way that the configuration names."""
    (context.out / "half.txt").write_text("half")
    if "TOY_FAULTS" in os.environ:
        with open(os.environ["TOY_FAULTS"], "a") as stream:
            stream.write(f"{context.config.fault}\n")
    if context.config.fault == "input":
        raise InputError("head.toml: teeth: expected an even number, got 3")
    if context.config.fault == "full":
        with open("/dev/full", "wb") as stream:
            stream.write(b"x" * 100_000)
    if context.config.fault == "kill":
        os.kill(os.getpid(), 9)
    if context.config.fault == "memory":
        resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
        raise MemoryError(sum(map(len, [bytes(1 << 24) for _ in range(100)])))  # which is too much on Linux
    if context.config.fault == "abort":
        os.abort()
    if context.config.fault == "exit":
        os._exit(1)
    if context.config.fault.startswith("exit "):
        sys.exit(int(context.config.fault.removeprefix("exit ")))
    if context.config.fault == "hang":
        (context.scratch / "process").write_text(str(os.getpid()))
        time.sleep(60)
    raise RuntimeError("the fault that was asked for")


def environment(context) -> None:
    """Write down what a worker sees of its environment."""
    (context.out / "environment.json").write_text(json.dumps(dict(os.environ)))


def toy_graph(pause_s: float = 0.0, steps: int = 3, seed: int = 0) -> list[Stage]:
    """Return a diamond: one stage, three side by side that read it, one that reads those."""
    here = f"{__name__}:"
    first = Stage("first", here + "numbers", ToyConfig(seed, steps, pause_s))
    middle = tuple(
        Stage("middle", here + "numbers", ToyConfig(seed + k, steps, pause_s), (first,), label=f"{k}") for k in range(3)
    )
    return [Stage("last", here + "total", ToyConfig(seed, steps, pause_s), middle)]


def faulty_graph(fault: str) -> list[Stage]:
    """Return a stage that fails, beside one that would take a minute."""
    slow = Stage("slow", f"{__name__}:numbers", ToyConfig(steps=600, pause_s=0.1))
    return [slow, Stage("faulty", f"{__name__}:faulty", ToyConfig(fault=fault))]


def run_toys(pause_s: str, steps: str, workers: str, cluster: str | None = None) -> None:
    """Run the diamond from a command line, and print what the last stage wrote."""
    from replicate.engine.scheduler import run

    folders = run(toy_graph(float(pause_s), int(steps)), int(workers), cluster=cluster)
    print(Path(folders["last"], "numbers.json").read_text())


def main() -> None:
    """Do as the command line says: `run_toys`' arguments."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and hands that on
    words = sys.argv[1:]
    run_toys(*words[: words.index(FROM_MAKE) if FROM_MAKE in words else None])


if __name__ == "__main__":
    import toy_stages  # under its own name, as the workers import it

    toy_stages.main()
