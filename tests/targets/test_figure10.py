"""Figure 10: half of a face is its surface, half its normal errors in colours, on one scale, with numbers below."""

from dataclasses import replace

import numpy as np
import pytest
from bumpy_plate import bumpy_plate, pictures_of, texts_of

from replicate.approximation.metrics import normal_error
from replicate.drawing.heatmap import error_colours
from replicate.report.pose_record import PoseRecord, best_peer, shown_in
from replicate.targets import figure10 as module
from replicate.targets.figure10 import figure10, picture_name, shown_methods


@pytest.fixture
def record() -> PoseRecord:
    """A bumpy plate that two methods predict."""
    return bumpy_plate()


def test_figure_10_halves_each_methods_face_into_surface_and_heat_on_one_scale(record):
    figure, _ = figure10(record, 10.0, across=60)
    truth, coarse, dense = pictures_of(figure)
    exact, limit = (error_colours(np.float32([error]), 10.0)[0] for error in (0, 10))
    assert np.ptp(truth.astype(int), axis=-1).max() < 20, "clay is grey, heat is not"
    for picture in (coarse, dense):
        colourful = np.ptp(picture.astype(int), axis=-1) > 40
        assert not colourful[:, :28].any() and colourful[20:50, 34:].mean() > 0.5
    assert not (coarse == limit).all(-1)[:, :28].any() and not (truth == exact).all(-1).any()
    bar = figure.axes[-1]
    assert bar.get_xlim() == (0, 10) and "degrees" in bar.get_xlabel()


def test_figure_10_prints_the_mean_of_the_mesh_below_each_face(record):
    figure, words = figure10(record, 10.0, across=60)
    expected = []
    for method in ("coarse", "dense"):
        error = normal_error(record.vertices[method], record.vertices["truth"], record.faces)
        expected.append(f"{error.mean():.2f}°")
    assert [text for text in texts_of(figure) if text.endswith("°")] == expected and len(set(expected)) == 2
    assert f"Coarse {expected[0]}" in words.alt and "Refined" not in words.caption
    assert words.caption.startswith("Test pose 7 of teen, the one whose forehead folds most (after Fig. 10)")


def test_a_close_up_has_the_mean_of_what_it_shows(record):
    figure, words = figure10(record, 10.0, "forehead", across=60)
    errors = normal_error(record.vertices["dense"], record.vertices["truth"], record.faces)
    forehead = errors[record.region == record.region_names.index("forehead")].mean()
    assert f"{forehead:.2f}°" in texts_of(figure) and f"{forehead:.2f}°" != f"{errors.mean():.2f}°"
    assert "Below: its mean over the forehead;" in words.caption and f"Dense {forehead:.2f}°" in words.alt
    nameless = replace(record, region_names=(), region=None)
    figure, words = figure10(nameless, 10.0, "forehead", across=60)
    assert f"{errors.mean():.2f}°" in texts_of(figure) and "over the whole mesh;" in words.caption


def test_figure_10_shows_six_faces_in_a_row_and_a_method_from_outside_is_one_of_them(record, monkeypatch):
    names = ("coarse", "refined", "dense", "lbs16", "lbs24", "lbs32", "linear", "mine")
    many = replace(record, vertices={"truth": record.vertices["truth"]} | dict.fromkeys(names, record.neutral))
    assert shown_methods(many) == ["coarse", "refined", "dense", "lbs32", "linear"]
    monkeypatch.setattr(module, "outside_names", lambda: {"mine"})
    assert {"mine", "refined", "linear", "lbs32"} < set(shown_methods(many))
    places = [axes.get_position() for axes in figure10(many, across=40)[0].axes if axes.images]
    assert len(places) == 6 and len({round(place.y1, 3) for place in places}) == 1
    assert all(0 <= place.x0 and place.x1 <= 1 and 0 <= place.y0 and place.y1 <= 1 for place in places)


def test_the_nearest_of_what_is_used_today_takes_the_straight_lines_place(record):
    truth = record.vertices["truth"]
    names = ("refined", "dense", "lbs32", "linear", "regional", "morph", "differential")
    many = replace(record, vertices={"truth": truth} | dict.fromkeys(names, record.neutral))
    nearer = replace(many, vertices=many.vertices | {"morph_best": truth})
    assert best_peer(record) is None and best_peer(nearer) == "morph_best"
    assert shown_methods(many) == ["refined", "dense", "lbs32", "regional", best_peer(many)]
    assert shown_methods(nearer) == ["refined", "dense", "lbs32", "regional", "morph_best"]
    assert shown_in(nearer, ("refined", "regional", "coarse", "lbs32")) == [
        "refined",
        "regional",
        "morph_best",
        "lbs32",
    ]
    caption = figure10(nearer, across=24)[1].caption
    assert "The straight line, which isn't shown, has " in caption
    assert "Of what is used today “Neural morphs, our training” has the nearest normals in this pose." in caption
    assert "used today" not in figure10(record, across=24)[1].caption


def test_captions_say_by_which_rule_a_pose_was_chosen(record):
    records = [record, *(replace(record, choice=rule, ranked_by="refined") for rule in ("median", "worst"))]
    captions = [figure10(one, across=24)[1].caption for one in records]
    assert "the median of the mean normal errors of “Refined”" in captions[1]
    assert "the largest mean normal error of “Refined”" in captions[2]
    assert [picture_name(one) for one in records] == ["figure10_teen", "figure10_teen_median", "figure10_teen_worst"]
    close = figure10(record, camera="forehead", across=24)[1].caption
    assert close.startswith("Close up on the forehead, test pose 7") and len({*captions, close}) == 4
    assert picture_name(record, "forehead") == "figure10_teen_forehead"


def test_a_close_up_of_the_forehead_says_nothing_of_regions_that_it_does_not_show(record):
    rough = record.vertices["truth"] + np.float32([0, 0, 3]) * (record.neutral[:, 1:2] < 0) * record.neutral[:, :1] % 7
    mouth = replace(record, vertices={"truth": record.vertices["truth"], "coarse": np.float32(rough)})
    whole, close = (figure10(mouth, camera=c, across=24)[1].caption for c in ("front", "forehead"))
    assert "farthest off at the mouth" in whole and "farthest off" not in close
