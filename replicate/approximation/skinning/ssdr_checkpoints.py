"""Checkpoints of an SSDR fit on disk, so that a killed fit goes on where it stood."""

import hashlib
import json
import time
from pathlib import Path
from typing import BinaryIO

import numpy as np

from replicate.approximation.skinning.alternation import State
from replicate.approximation.skinning.compression import CompressedPoses
from replicate.engine.sealed_files import read_sealed, write_sealed

SECONDS = 20.0  # between two checkpoints


class Checkpoints:
    """A folder with the compressed poses and the last state of one fit; with no folder, nothing is stored.

    Files appear whole, carry a checksum and the fingerprint of the fit that they belong to: those of another fit, and
    damaged ones, count as absent.
    """

    def __init__(self, folder: Path | None, fingerprint: str) -> None:
        self.folder = folder
        self.fingerprint = fingerprint
        self.last_write = time.monotonic()

    def data(self) -> CompressedPoses | None:
        """Return the compressed poses, if they are stored."""
        arrays = self._read("compressed.sealed")
        return arrays and CompressedPoses(**_scalars(arrays, "radius_mm", "lost"))

    def keep_data(self, data: CompressedPoses) -> None:
        """Store the compressed poses."""
        self._write("compressed.sealed", vars(data))

    def state(self) -> State | None:
        """Return the last stored state."""
        arrays = self._read("state.sealed")
        return arrays and State(**_scalars(arrays, "iteration", "energy", "beta"))

    def keep_state(self, state: State, at_once: bool = False) -> None:
        """Store a state if the last one is old enough, or at once."""
        if at_once or time.monotonic() - self.last_write >= SECONDS:
            self._write("state.sealed", vars(state))
            self.last_write = time.monotonic()

    def _read(self, name: str) -> dict | None:
        arrays = None if self.folder is None else read_sealed(self.folder / name, _arrays)
        return arrays if arrays and str(arrays.pop("fingerprint", "")) == self.fingerprint else None

    def _write(self, name: str, arrays: dict) -> None:
        if self.folder is not None:
            contents = {"fingerprint": self.fingerprint, **arrays}
            write_sealed(self.folder / name, lambda stream: np.savez(stream, **contents))


def _arrays(stream: BinaryIO) -> dict[str, np.ndarray]:
    with np.load(stream, allow_pickle=False) as file:
        return {key: file[key] for key in file.files}


def _scalars(arrays: dict, *names: str) -> dict:
    return arrays | {name: arrays[name].item() for name in names}


def fingerprint(*parts: np.ndarray | float) -> str:
    """Return a hash of all that a fit's intermediate results depend on: arrays, with their types, and numbers."""
    digest = hashlib.blake2b()
    for part in parts:
        array = np.ascontiguousarray(part)
        digest.update(json.dumps([str(array.dtype), array.shape]).encode())
        digest.update(array)
    return digest.hexdigest()
