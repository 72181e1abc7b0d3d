"""The unfinished arrays of a set of samples: a killed set goes on after its last chunk whose checksum agrees.

Poses are in parts, by name; every part is filled from its first pose on, in chunks. After each chunk a small file
states what is done, with a checksum of that chunk's rows in all arrays: one over all rows, gigabytes, would take longer
than the chunk did. When the work is taken up again, all chunks are compared with their checksums.
"""

import hashlib
import json
import shutil
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from replicate.engine.sealed_files import read_sealed, write_sealed

STATE = "state.sealed"


class Scratch:
    """Arrays in a folder, memory-mapped, of which the first rows are done.

    folder: stays between calls. key: what the contents depend on; a folder of another key is begun anew. chunk: poses
    between two checkpoints. parts: by name, the number of poses and the arrays, name → (dtype, shape of one row). The
    rows of an earlier call are checked here: those from the first damaged chunk of a part on count as missing, and
    standard error names it.
    """

    def __init__(
        self, folder: Path, key: str, chunk: int, parts: Mapping[str, tuple[int, Mapping[str, tuple]]]
    ) -> None:
        self.folder, self.key, self.chunk = Path(folder), key, chunk
        self.poses = {part: count for part, (count, _) in parts.items()}
        self._names = {part: tuple(rows) for part, (_, rows) in parts.items()}
        self._sums: dict[str, list[str]] = {part: [] for part in parts}
        self.folder.mkdir(parents=True, exist_ok=True)
        shapes = {
            name: (np.dtype(dtype), (count, *row))
            for count, rows in parts.values()
            for name, (dtype, row) in rows.items()
        }
        self.arrays = self._reopen(shapes)
        if self.arrays is None:
            self._remove(shapes)
            make = np.lib.format.open_memmap
            self.arrays = {name: make(self._file(name), "w+", *shape) for name, shape in shapes.items()}

    def finished_poses(self, part: str) -> int:
        """Return how many of a part's poses have all their rows."""
        return min(len(self._sums[part]) * self.chunk, self.poses[part])

    def checkpoint(self, part: str) -> None:
        """State that the next chunk of a part is done; all of its rows are filled."""
        for name in self._names[part]:
            self.arrays[name].flush()
        self._sums[part].append(self._sum(part, len(self._sums[part])))
        state = {"key": self.key, "headers": self._headers(), "sums": self._sums}
        write_sealed(self.folder / STATE, lambda stream: stream.write(json.dumps(state).encode()))

    def move(self, names: list[str], target: Path) -> None:
        """Move finished arrays into another folder; they are never in two places, where a write would change both.

        A run that ends after this evaluates all samples again, to the same bytes.
        """
        del self.arrays
        (self.folder / STATE).unlink()
        for name in names:
            shutil.move(self._file(name), target / f"{name}.npy")

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.npy"

    def _reopen(self, shapes: dict) -> dict[str, np.memmap] | None:
        """Take over what is sound of an earlier call with this key; return its arrays, or None to begin anew."""
        state = read_sealed(self.folder / STATE, json.load)
        if state is None or state["key"] != self.key:
            return None
        with suppress(OSError, ValueError):
            arrays = {name: np.load(self._file(name), mmap_mode="r+", allow_pickle=False) for name in shapes}
            if all((arrays[name].dtype, arrays[name].shape) == shapes[name] for name in shapes):
                self.arrays = arrays
                if self._headers() == state["headers"]:
                    for part, sums in state["sums"].items():
                        self._sums[part] = self._sound(part, sums)
                    return arrays
        self._report("an array is gone or its header is damaged", "all samples are")
        return None

    def _sound(self, part: str, sums: list[str]) -> list[str]:
        """Return the checksums up to the first chunk of a part that differs from its own."""
        for chunk, checksum in enumerate(sums):
            if self._sum(part, chunk) != checksum:
                first = chunk * self.chunk
                self._report(f"{part} poses from {first} on differ from their checksum", "they are")
                return sums[:chunk]
        return sums

    def _sum(self, part: str, chunk: int) -> str:
        rows = slice(chunk * self.chunk, (chunk + 1) * self.chunk)
        digest = hashlib.sha256()
        for name in self._names[part]:
            digest.update(np.ascontiguousarray(self.arrays[name][rows]))
        return digest.hexdigest()

    def _headers(self) -> str:
        """Return a checksum of what stands in the files before the numbers."""
        digest = hashlib.sha256()
        for name, array in self.arrays.items():
            with open(self._file(name), "rb") as stream:
                digest.update(stream.read(array.offset))
        return digest.hexdigest()

    def _remove(self, names: Mapping) -> None:
        for file in (self.folder / STATE, *map(self._file, names)):
            file.unlink(missing_ok=True)

    def _report(self, damage: str, what: str) -> None:
        print(f"{self.folder}: damaged ({damage}); {what} evaluated again", file=sys.stderr, flush=True)
