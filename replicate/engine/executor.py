"""The contract between the scheduler and what runs stages: worker processes of this machine, or a Dask cluster."""

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

    needs: the identifiers of its inputs that are missing too.
    facts: provenance for the manifest.
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
        """Return how many threads the stage gets if there are `most`."""
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
    """Runs tasks side by side, each in its process, and reports how they get on.

    A message is a dict with an "event": "started", "progress" (label, done, total), "waiting" (another process makes
    the artefact), and at last "done" (made: whether it was made here) or "failed" (kind, message). The kinds are
    "InputError", "RunError", "Exception" and "died"; the message of "died" continues the words "stage so-and-so".
    """

    def submit(self, tasks: Sequence[Task]) -> None:
        """Accept the whole graph, inputs first, otherwise by urgency; called once."""

    def listen(self, timeout_s: float) -> list[tuple[str, dict]]:
        """Return the messages that have come in, each with its task's identifier; wait a while if there are none."""

    def close(self) -> None:
        """Kill what still runs, and return when nothing does."""
