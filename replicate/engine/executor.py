"""What the scheduler asks of whatever runs stages: the worker processes of this machine, or a Dask cluster."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from replicate.base.code_hash import project_roots, source_texts, sources_digest
from replicate.base.paths import ROOT
from replicate.base.schema import to_json
from replicate.engine import store
from replicate.engine.stage import Stage, input_names


@dataclass(frozen=True)
class Task:
    """A stage whose artefact is missing.

    needs: the identifiers of those of its inputs that are missing too. facts: provenance for the manifest.
    """

    stage: Stage
    needs: tuple[str, ...]
    facts: dict

    @property
    def identifier(self) -> str:
        """The name of the artefact's folder, which also names the task."""
        return self.stage.identifier

    @property
    def gpu(self) -> bool:
        """Whether the stage runs on a GPU, as the `device` in its configuration says."""
        return getattr(self.stage.config, "device", None) == "cuda"

    def threads(self, most: int) -> int:
        """Return how many threads the stage gets where it can have at most so many."""
        return most if self.stage.threads == 0 else min(self.stage.threads, most)

    def orders(self, threads: int) -> dict:
        """Return the orders of the stage's worker process, ready for JSON."""
        stage = self.stage
        return {
            "identifier": stage.identifier,
            "title": stage.title,
            "name": stage.name,
            "key": stage.key,
            "function": stage.function,
            "sources": sources_digest(stage.function),
            "texts": source_texts(stage.function),
            "config": to_json(stage.config),
            "inputs": {name: other.identifier for name, other in input_names(stage.inputs).items()},
            "files": [str(Path(file).absolute()) for file in stage.files],
            "threads": threads,
            "cache": str(store.cache_folder()),
            "path": [str(root.resolve()) for root in project_roots() if root != ROOT],
            "run": self.facts,
        }


@runtime_checkable
class Executor(Protocol):
    """Runs tasks side by side, each in a worker process of its own, and tells how they fare.

    A message is a dict with an "event": "started", "progress" (label, done, total), "waiting" (another process makes
    the artefact), and at last "done" (made: whether it was made here) or "failed" (kind, message). The kinds are
    "InputError", "RunError", "Exception" and "died", whose message goes on from the words "stage so-and-so".
    """

    def submit(self, tasks: Sequence[Task]) -> None:
        """Take the whole graph, inputs first, else the more urgent first; called once."""

    def listen(self, timeout_s: float) -> list[tuple[str, dict]]:
        """Return the messages that came in by now, each with its task's identifier; wait a while if there is none."""

    def close(self) -> None:
        """Kill what still runs, and return when nothing does."""
