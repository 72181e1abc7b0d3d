"""Faces to pose from a folder of results: what is missing is said with the command that makes it."""

import pytest

from replicate.base.exceptions import InputError
from replicate.methods import trained
from replicate.poser.notebook import open_face, what_is_missing


@pytest.fixture(autouse=True)
def empty_cache(tmp_path, monkeypatch):
    """No artefact, wherever these tests run, and no model that comes with the repository."""
    monkeypatch.setenv("REPLICATE_CACHE", str(tmp_path))
    monkeypatch.setattr(trained, "FOLDER", tmp_path)


def test_a_character_that_results_lack_is_named_with_the_command_that_makes_it():
    command = "make figure11 CHARACTERS=<recipe or folder of nobody>"
    assert what_is_missing("reference", "nobody").endswith(f"`{command}` makes it.")


def test_networks_that_the_cache_lacks_are_named_with_the_command_that_trains_them():
    sentence = what_is_missing("reference", "toon")
    assert "does not hold rig-toon" in sentence and "`make figure11 CHARACTERS=toon PROFILE=laptop` trains" in sentence
    with pytest.raises(InputError, match="does not hold rig-toon"):
        open_face("reference", "toon")


def test_a_profile_without_results_is_refused_in_a_sentence():
    assert "nosuch" in what_is_missing("nosuch", "teen")
