"""Where tests publish."""

import pytest


@pytest.fixture
def place(tmp_path, cache, monkeypatch):
    """Where the profile "quick" is published."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    return tmp_path / "results" / "quick"
