"""Figure 9: the forehead of the methods that there are."""

from dataclasses import replace

import numpy as np
import pytest
from bumpy_plate import bumpy_plate, pictures_of, texts_of

from replicate.approximation.metrics import normal_error
from replicate.report.pose_record import PoseRecord
from replicate.targets.figure09.forehead_wrinkles import CREASED_DEG, figure09, fold_change_deg, refined_spot
from replicate.targets.pose_numbers import rows_of


@pytest.fixture
def record() -> PoseRecord:
    """A bumpy plate that two methods predict."""
    return bumpy_plate()


def test_figure_9_shows_the_methods_that_there_are(record):
    figure, words = figure09(record, across=260)
    errors = [
        normal_error(record.vertices[name], record.vertices["truth"], record.faces)[record.region == 0].mean()
        for name in ("coarse", "dense")
    ]
    below = [f"forehead: {error:.2f}°" for error in errors]
    assert [text for text in texts_of(figure) if text] == ["Ground truth", "Coarse", below[0], "Dense", below[1]]
    assert f"Ground truth, Coarse {errors[0]:.2f}°, Dense {errors[1]:.2f}°." in words.alt


def test_the_words_point_at_creases_only_where_the_pose_folds_the_forehead(record):
    smooth = replace(record, neutral=record.vertices["truth"])
    assert fold_change_deg(smooth) == 0.0 and fold_change_deg(record) > CREASED_DEG
    creased, plain = (figure09(each, across=40)[1].caption for each in (record, smooth))
    assert "Look at the creases" in creased
    assert "creases" not in plain and "has no wrinkles" in plain and "test pose 7 of teen" in plain


def test_the_words_say_when_no_region_is_a_forehead(record):
    words = figure09(replace(record, region_names=("eyes", "mouth")), across=40)[1]
    assert "names no control of the brows" in words.caption and "creases" not in words.caption
    assert "mean normal error (Eq. 11) of the whole mesh" in words.caption


def test_a_second_picture_shows_where_refinement_changes_most(record):
    coarse, truth = record.vertices["coarse"], record.vertices["truth"]
    here = np.linalg.norm(truth[:, :2] - np.float32([-30, -40]), axis=1) < 20
    refined = np.where(here[:, None], truth, coarse)
    both = replace(record, vertices=record.vertices | {"refined": refined})
    spot = refined_spot(both)
    middle = np.asarray(spot.camera.focus)
    assert np.linalg.norm(middle[:2] - [-30, -40]) < 15 and spot.place == "at the mouth"
    figure, words = figure09(both, across=60)
    assert len(pictures_of(figure)) == 8 and spot.place in words.caption and refined_spot(record) is None
    # below the strip: the mean over the mesh faces whose centres lie near its middle
    near = np.linalg.norm(truth[record.faces].mean(1) - middle, axis=1) <= spot.radius_mm
    for name in ("coarse", "refined", "dense"):
        mean = np.nanmean(normal_error(both.vertices[name], truth, record.faces)[near])
        assert spot.mean_deg(both, name) == pytest.approx(mean) and f"strip: {mean:.2f}°" in texts_of(figure)
        assert f"° and {mean:.2f}°" in words.alt
    assert spot.mean_deg(both, "refined") < 0.5 * spot.mean_deg(both, "coarse")


def test_the_line_is_shown_unless_a_peer_takes_its_place_and_then_the_caption_has_its_number(record):
    line = record.vertices["coarse"]
    alone = replace(record, vertices=record.vertices | {"linear": line})
    beside = replace(alone, vertices=alone.vertices | {"morph": record.vertices["dense"]})
    error = normal_error(line, record.vertices["truth"], record.faces)[record.region == 0].mean()
    sentence = f"The straight line, which isn't shown, has {error:.2f}°."
    (shown, words), (hidden, other) = (figure09(each, across=40) for each in (alone, beside))
    assert "Linear" in texts_of(shown) and sentence not in words.caption
    assert not any("Linear" in text for text in texts_of(hidden)) and sentence in other.caption
    rows = rows_of("figure09", {"folded": beside}, 30.0, "quick", "r")
    assert [row.value for row in rows if row.method == "linear"] == [pytest.approx(error, rel=1e-4)]
