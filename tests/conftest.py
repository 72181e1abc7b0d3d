"""Shapes and types of annotated functions are checked while tests run; every test has a cache of its own."""

import os

for library in ("OMP", "MKL", "OPENBLAS", "NUMEXPR", "NUMBA"):  # before any of them is loaded
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import pytest
from jaxtyping import install_import_hook

import replicate.config  # noqa: F401, loaded before the hook: it checks its values itself, with sentences that are tested

_hook = install_import_hook(["replicate", "data_recipes"], "typechecker.check")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The folder of an empty cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("REPLICATE_CACHE", str(folder))
    return folder
