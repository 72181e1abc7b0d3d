"""Rigs that several files of tests look at, built once."""

import pytest

from data_recipes.catalogue import build_rig


@pytest.fixture(scope="session")
def tiny():
    """The smallest character."""
    return build_rig("tiny")
