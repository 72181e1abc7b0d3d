"""A small folder in ICT-FaceKit's format and the rig that is made of it, built once."""

import pytest
from small_facekit import write_facekit

from data_recipes.catalogue import build_rig


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A folder of the model."""
    place = tmp_path_factory.mktemp("kit")
    write_facekit(place)
    return place


@pytest.fixture
def kit(folder, monkeypatch):
    """The recipe of the folder that ICT_FACEKIT names."""
    monkeypatch.setenv("ICT_FACEKIT", str(folder))
    return folder / "mask.toml"


@pytest.fixture(scope="session")
def mask(folder):
    """The rig."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ICT_FACEKIT", str(folder))
        return build_rig(folder / "mask.toml")
