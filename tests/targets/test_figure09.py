"""Figure 9: the forehead of the methods that there are."""

import pytest
from bumpy_plate import bumpy_plate, texts_of

from replicate.approximation.metrics import normal_error
from replicate.report.pose_record import PoseRecord
from replicate.targets.figure09.forehead_wrinkles import figure09


@pytest.fixture
def record() -> PoseRecord:
    """A bumpy plate that two methods predict."""
    return bumpy_plate()


def test_figure_9_shows_the_methods_that_there_are(record):
    figure, words = figure09(record, across=160, renderer="software")
    error = normal_error(record.vertices["coarse"], record.vertices["truth"], record.faces)[record.region == 0].mean()
    assert [text for text in texts_of(figure) if text] == ["Ground truth", "Coarse", f"forehead: {error:.2f}°"]
    assert f"Ground truth, Coarse {error:.2f}°." in words.alt
