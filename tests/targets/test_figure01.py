"""Figure 1: head and forehead with both errors; its words are not those of Figures 9 and 10."""

from dataclasses import replace

import numpy as np
import pytest
from bumpy_plate import bumpy_plate, pictures_of, texts_of

from replicate.report.pose_record import PoseRecord
from replicate.targets.figure01 import figure01
from replicate.targets.figure09.forehead_wrinkles import figure09
from replicate.targets.figure10 import figure10


@pytest.fixture
def record() -> PoseRecord:
    """A bumpy plate that two methods predict."""
    return bumpy_plate()


def test_figure_1_shows_head_and_forehead_with_both_errors_below(record):
    both = replace(record, vertices=record.vertices | {"refined": record.vertices["truth"] + np.float32([0, 0, 0.5])})
    figure, words = figure01(both, across=260)
    lines = ["Ground truth", "Refined", "0.50 mm, 0.00°", "forehead: 0.00°"]
    assert len(pictures_of(figure)) == 4 and texts_of(figure) == lines
    assert "Refined 0.50 mm, 0.00°" in words.alt and "Fig. 1)" in words.caption


def test_the_words_speak_of_creases_and_of_hair_only_where_there_are_any(record):
    smooth = replace(record, neutral=record.vertices["truth"])
    triangle = (np.zeros((3, 3), np.float32), np.array([[0, 1, 2]]), (0, 0, 0))
    haired = replace(record, props=(("hair_long", *triangle),))
    creased, plain, hidden = (figure01(each, across=24)[1].caption for each in (record, smooth, haired))
    assert "the close-up below shows which creases of the forehead a method keeps" in creased
    assert "the close-up below is of the forehead, which has no creases here" in plain
    assert "the close-up below, without what hides it, shows which creases" in hidden


def test_the_captions_of_the_figures_differ(record):
    drawn = [figure01(record, 24), figure09(record, across=24),
             figure10(record, across=24)]  # fmt: skip
    assert len({words.caption.partition("test pose")[0] for _, words in drawn}) == 3
    assert len({words.alt for _, words in drawn}) == 3
