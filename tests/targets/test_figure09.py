"""Figure 9: the forehead of the methods that there are."""

from dataclasses import replace

import pytest
from bumpy_plate import bumpy_plate, texts_of

from replicate.approximation.metrics import normal_error
from replicate.report.pose_record import PoseRecord
from replicate.targets.figure09.forehead_wrinkles import CREASED_DEG, figure09, fold_change_deg


@pytest.fixture
def record() -> PoseRecord:
    """A bumpy plate that two methods predict."""
    return bumpy_plate()


def test_figure_9_shows_the_methods_that_there_are(record):
    figure, words = figure09(record, across=160)
    error = normal_error(record.vertices["coarse"], record.vertices["truth"], record.faces)[record.region == 0].mean()
    assert [text for text in texts_of(figure) if text] == ["Ground truth", "Coarse", f"forehead: {error:.2f}°"]
    assert f"Ground truth, Coarse {error:.2f}°." in words.alt


def test_the_words_point_at_creases_only_where_the_pose_folds_the_forehead(record):
    smooth = replace(record, neutral=record.vertices["truth"])
    assert fold_change_deg(smooth) == 0.0 and fold_change_deg(record) > CREASED_DEG
    creased, plain = (figure09(each, across=40)[1].caption for each in (record, smooth))
    assert "Look at the creases" in creased
    assert "creases" not in plain and "has no wrinkles" in plain and "test pose 7 of teen" in plain
