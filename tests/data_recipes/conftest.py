"""Rigs that several files of tests look at, built once."""

import pytest
import rigs


@pytest.fixture(scope="session")
def tiny():
    """The smallest character."""
    return rigs.rig("tiny")
