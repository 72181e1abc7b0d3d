"""A folder of samples to look at: the example that the page "Your own rig" begins with, and its picture."""

import numpy as np
import pytest
from sample_folders import neutral, vertices_at, write

from data_recipes.function_rig import FunctionRig
from replicate.config import SamplesConfig
from replicate.methods.artefacts import rig_of
from replicate.rig_study.tour import SHOWN, known_faces
from replicate.targets import export_samples as drawn_shards


@pytest.fixture
def sheet(cache, tmp_path):
    """A bent sheet that is known by its samples."""
    return rig_of(str(write(tmp_path / "sheet")))


def test_the_example_is_a_folder_that_is_read_back_and_is_written_once(sheet, tmp_path, monkeypatch):
    def function(params):
        return sheet.mesh.neutral + vertices_at(params) - neutral()

    points = (sheet.landmarks, sheet.control_points, sheet.control_point_regions)
    whole = FunctionRig("sheet", sheet.mesh, sheet.controls, *points, None, function)
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    monkeypatch.setattr(drawn_shards, "rig_of", lambda character: whole)
    monkeypatch.setattr(drawn_shards, "SAMPLES", SamplesConfig(count=24, validation=4, uniform_test=8))
    folder = drawn_shards.example_folder()
    rig, shards = rig_of(str(folder)), sorted((folder / "poses").iterdir())
    assert len(rig.known_poses) == 24 + 4 + 8
    np.testing.assert_allclose(rig(rig.known_poses.frame_params[3]), whole(rig.known_poses.frame_params[3]), atol=1e-3)
    before = [shard.stat().st_mtime_ns for shard in shards]
    assert drawn_shards.example_folder() == folder
    assert [shard.stat().st_mtime_ns for shard in shards] == before


def test_the_picture_has_the_segments_in_colours_and_poses_that_differ(sheet):
    figure, words = known_faces(sheet)
    pictures = [image.get_array() for axes in figure.axes for image in axes.get_images()]
    assert len(pictures) == SHOWN + 2, "segments, the neutral face and the poses"
    first, rest, *posed = (np.asarray(picture, int) for picture in pictures)
    assert np.ptp(first, axis=-1).max() > 100 > np.ptp(rest, axis=-1).max(), "colours, then clay"
    assert all(np.abs(picture - rest).mean() > 0.1 for picture in posed)
    assert "2 segments" in words.alt
