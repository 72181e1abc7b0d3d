"""What a fit keeps on disk while it runs, so that a killed one goes on where it stood."""

import hashlib
import json
import os
import time
import zipfile
from pathlib import Path

import numpy as np

from replicate.approximation.skinning.alternation import State
from replicate.approximation.skinning.compression import Compressed

SECONDS = 20.0  # between two checkpoints


class Checkpoints:
    """A folder with the compressed poses and the last state of one fit; with no folder, nothing is kept.

    Files are written beside and renamed into place, and carry the fingerprint of the fit that they belong to: those of
    another fit, and damaged ones, count as absent.
    """

    def __init__(self, folder: Path | None, fingerprint: str) -> None:
        self.folder = folder
        self.fingerprint = fingerprint
        self.written = time.monotonic()

    def data(self) -> Compressed | None:
        """Return the compressed poses, if they were kept."""
        arrays = self._read("compressed.npz")
        return arrays and Compressed(**_scalars(arrays, "radius_mm", "lost"))

    def keep_data(self, data: Compressed) -> None:
        """Keep the compressed poses."""
        self._write("compressed.npz", vars(data))

    def state(self) -> State | None:
        """Return the last state kept."""
        arrays = self._read("state.npz")
        return arrays and State(**_scalars(arrays, "iteration", "energy", "beta"))

    def keep_state(self, state: State, at_once: bool = False) -> None:
        """Keep a state if the last one is old enough, or at once."""
        if at_once or time.monotonic() - self.written >= SECONDS:
            self._write("state.npz", vars(state))
            self.written = time.monotonic()

    def _read(self, name: str) -> dict | None:
        if self.folder is None:
            return None
        try:
            with np.load(self.folder / name, allow_pickle=False) as file:
                arrays = {key: file[key] for key in file.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None
        return arrays if str(arrays.pop("fingerprint", "")) == self.fingerprint else None

    def _write(self, name: str, arrays: dict) -> None:
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        beside = self.folder / f"{name}.{os.getpid()}.part"
        with open(beside, "wb") as file:
            np.savez(file, fingerprint=self.fingerprint, **arrays)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, self.folder / name)


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
