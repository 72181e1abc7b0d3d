"""Ways to spoil one file of a folder of samples: each returns a function that does it to a folder."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

Fault = Callable[[Path], None]


def change_text(name: str, old: str, new: str) -> Fault:
    def fault(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text, (name, old)
        (folder / name).write_text(text.replace(old, new, 1))

    return fault


def write_bytes(name: str, data: bytes) -> Fault:
    return lambda folder: (folder / name).write_bytes(data) and None


def change_arrays(change: Callable[[dict], None], name: str = "001.npz") -> Fault:
    def fault(folder: Path) -> None:
        file = folder / "poses" / name
        with np.load(file) as stored:
            arrays = dict(stored)
        change(arrays)
        np.savez(file, **arrays)

    return fault


def set_array(name: str, value: Callable[[np.ndarray], np.ndarray]) -> Fault:
    return change_arrays(lambda arrays: arrays.__setitem__(name, value(arrays[name])))


def put_at(array: np.ndarray, place: tuple, value: float) -> np.ndarray:
    array = array.copy()
    array[place] = value
    return array


def put_instead(name: str, make: Callable[[Path], None]) -> Fault:
    def fault(folder: Path) -> None:
        file = folder / name
        shutil.rmtree(file) if file.is_dir() else file.unlink()
        make(file)

    return fault


def cut(name: str, share: float) -> Fault:
    def fault(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(len(data) * share)])

    return fault


def two_shards(**arrays: np.ndarray) -> Fault:
    def fault(folder: Path) -> None:
        for name, array in arrays.items():
            np.save(folder / "poses" / f"pair.{name}.npy", array)

    return fault
