"""Methods that somebody brings along: files in a folder of their own, forgotten again after the test."""

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from replicate.base import code_hash
from replicate.methods.method_registry import VARIABLE

SOURCE = """
import numpy as np

from replicate.methods import artefacts
from replicate.methods.method import Method


def stages(plan):
    return (plan.stage("mine", fit, plan.settings(None), artefacts.rig_stage(plan), artefacts.samples_stage(plan)),)


def fit(context):
    np.save(context.out / "mean.npy", artefacts.load_samples(context.inputs).offsets(np.arange(2)).mean(0))


def load(inputs, settings):
    vertices = artefacts.load_mesh(inputs).neutral + np.load(inputs["mine"] / "mean.npy")
    return lambda params: np.broadcast_to(vertices, (len(params), *vertices.shape))


METHOD = Method("mine", "Mean pose", stages, load, note="The mean pose.", mark="#", colour="#123456")
"""

WITH_MODEL = """
import numpy as np

from replicate.methods import artefacts
from replicate.methods.method import Method


class Mean:
    def __init__(self, offsets):
        self.mean = offsets

    def offsets(self, params):
        return np.broadcast_to(self.mean, (len(params), *self.mean.shape))

    def multiplications(self):
        return 7


def stages(plan):
    return (plan.stage("mine", fit, plan.settings(None), artefacts.rig_stage(plan), artefacts.samples_stage(plan)),)


def fit(context):
    np.save(context.out / "mean.npy", artefacts.load_samples(context.inputs).offsets(np.arange(2)).mean(0))


def read(inputs):
    return Mean(np.load(inputs["mine"] / "mean.npy"))


METHOD = Method("mine", "Mean pose", stages, model=read, note="The mean pose's.", mark="#", colour="#123456")
"""


def fresh(function: Callable) -> Callable:
    """Return a cached function that forgets what it found of files brought along."""
    return lambda *arguments: (function.__wrapped__ if "brought_" in str(arguments) else function)(*arguments)


@pytest.fixture
def bring(tmp_path, monkeypatch) -> Iterator[Callable[..., Path]]:
    """Return a function that writes a file of methods and returns it; (old, new) pairs change its `SOURCE`."""
    monkeypatch.setenv(VARIABLE, "")
    monkeypatch.setattr(sys, "path", list(sys.path))
    names: set[str] = set()

    # Of what changes within a test nothing is remembered, and afterwards nothing of a neighbour such as numpy.py.
    caches = ("_module_file", "_outline", "_closure", "_digest", "_reached", "_written")
    remembering = [getattr(code_hash, name) for name in caches]
    for name, function in zip(caches, remembering, strict=True):
        monkeypatch.setattr(code_hash, name, fresh(function))

    def forget() -> None:
        for name in names:
            sys.modules.pop(name, None)
        importlib.invalidate_caches()

    def write(*changes: tuple[str, str], name: str = "brought_mine", text: str = SOURCE) -> Path:
        for old, new in changes:
            assert text.count(old) == 1, f"{old!r} occurs {text.count(old)} times"
            text = text.replace(old, new)
        file = tmp_path / "brought" / f"{name}.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
        names.add(name)
        forget()
        return file

    yield write
    forget()
    for function in remembering:
        function.cache_clear()
