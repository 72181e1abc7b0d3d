"""The slider panel without a browser, and what the tour shows of a rig."""

import re

import numpy as np
import pytest
import rigs

from replicate.base.exceptions import InputError
from replicate.drawing.render import opengl_works
from replicate.drawing.scene import Camera, Surface
from replicate.rig_study.control_panel import LiveView, control_panel, still
from replicate.rig_study.fold_growth import NO_REGION, fold_chart, strain, strain_colours
from replicate.rig_study.tour import (
    BROWS_UP,
    EXHIBITS,
    SMILE,
    build_up,
    central,
    derivative_sheet,
    layer_sheet,
    layer_table,
    pose_params,
    scale_for,
)

FOLDED = {**BROWS_UP, **SMILE, "chin_raise": 1.0}
SMALL = {"width": 60, "height": 66}


@pytest.fixture(scope="module")
def tiny():
    return rigs.rig("tiny")


@pytest.fixture
def panel(tiny):
    return control_panel(tiny, 96, 104)


def test_a_slider_changes_the_picture_and_reset_restores_it(panel):
    first = panel.picture.copy()
    panel.sliders["jaw_open"].value = 0.8
    picture = panel.picture.copy()
    assert (picture != first).any(-1).mean() > 0.01
    assert panel.params[list(panel.sliders).index("jaw_open")] == np.float32(0.8)
    panel.reset.click()
    np.testing.assert_array_equal(panel.picture, first)
    assert panel.sliders["jaw_open"].value == 0 and not panel.params.any()


def test_an_expression_sets_the_sliders_and_draws_once(panel, monkeypatch):
    draws = []
    monkeypatch.setattr(
        panel, "_view", type("Counted", (), {"draw": lambda self, *a: draws.append(1) or panel.picture})()
    )
    panel.expression.value = "joy"
    assert len(draws) == 1
    smile = panel.sliders["smile_left"].value
    assert smile > 0.5 and panel.params[list(panel.sliders).index("smile_left")] == pytest.approx(smile)
    with pytest.raises(InputError, match="no expression 'glee'; there are neutral, joy"):
        panel.show("glee")


def test_an_expression_lists_the_region_that_it_moves_most(panel):
    panel.region.value = "brows"
    panel.show("joy")
    assert panel.region.value == "mouth" and panel.sliders["smile_left"] in panel._box.children
    panel.show("neutral")
    assert panel.region.value == "mouth", "at rest none moves more than another"


def test_a_region_lists_its_own_controls(panel):
    for region in panel.region.options:
        panel.region.value = region
        names = [slider.description for slider in panel._box.children]
        assert names == [c.name for c in panel.rig.controls if c.region == region] and names


def test_wrinkles_can_be_switched_off_and_on_again(panel):
    for name, amount in BROWS_UP.items():
        for side in ("left", "right"):
            panel.sliders[name.replace("*", side)].value = amount
    panel.camera.value = "forehead"
    picture = panel.picture.copy()
    panel.wrinkles.value = False
    assert (panel.picture != picture).any()
    panel.wrinkles.value = True
    np.testing.assert_array_equal(panel.picture, picture)


def test_a_still_of_the_panel_shows_its_picture_and_its_sliders(panel):
    panel.show("joy")
    panel.region.value = "mouth"
    figure, words = still(panel)
    np.testing.assert_array_equal(figure.axes[0].images[0].get_array(), panel.picture)
    values = {
        text.get_text(): bar.get_width()
        for text, bar in zip(figure.axes[1].get_yticklabels(), figure.axes[1].patches, strict=True)
    }
    assert values["smile_left"] == pytest.approx(panel.sliders["smile_left"].value)
    assert "joy" in words.alt and "mouth" in words.caption


def test_a_live_view_shows_moved_points_as_a_new_one_does():
    if not opengl_works():
        pytest.skip("no OpenGL here")
    square = np.float32([[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]])
    faces, camera = np.int32([[0, 1, 2], [0, 2, 3]]), Camera((0, 0, 0), 80)
    live = LiveView(64, 64)
    before = live.draw([Surface(square, faces)], camera)
    after = live.draw([Surface(square + np.float32([15, 0, 0]), faces)], camera)
    assert (before != after).any()
    np.testing.assert_array_equal(
        after, LiveView(64, 64).draw([Surface(square + np.float32([15, 0, 0]), faces)], camera)
    )
    two = live.draw([Surface(square, faces), Surface(square - np.float32([25, 0, 0]), faces)], camera)
    assert (two != before).any()
    live.close()


def test_every_node_has_an_exhibit_and_the_sheet_says_how_far_it_moves(tiny):
    nodes = [node.name for node in tiny.nodes if node.name != "riders"]  # only creatures have frills
    assert [exhibit.node for exhibit in EXHIBITS] == nodes
    exhibits = [exhibit for exhibit in EXHIBITS if exhibit.node in ("jaw", "wrinkles")]
    figure, words = layer_sheet(tiny, exhibits, **SMALL)
    params = pose_params(tiny, exhibits[0].amounts)[None]
    far = np.linalg.norm(tiny.run_nodes(params) - tiny.run_nodes(params, skip=("jaw",)), axis=-1).max()
    assert f"4 jaw {far:.1f} mm" in words.caption
    pictures = [axes.images[0].get_array() for axes in figure.axes if axes.images]
    assert (pictures[0] != pictures[1]).any() and (pictures[3] != pictures[4]).any()


def test_the_table_of_layers_measures_each_one(tiny):
    poses = np.stack([tiny.default, pose_params(tiny, SMILE)])
    table = layer_table(tiny, poses, [exhibit for exhibit in EXHIBITS if exhibit.node in ("pose_curves", "head_shape")])
    curves, head = table.body
    moved = np.linalg.norm(tiny.run_nodes(poses) - tiny.run_nodes(poses, skip=("pose_curves",)), axis=2)
    assert curves[-1] == f"{moved.max():.1f}" and moved.max() > 1
    assert head[2:] == ("0 %", "0.00", "0.0")


def test_a_face_is_built_up_node_by_node(tiny):
    figure, _ = build_up(tiny, {"smile_*": 0.5}, **SMALL)
    assert [text.get_text() for text in figure.texts if text.get_text()][:2] == ["neutral", "+ pose_curves"]
    pictures = [axes.images[0].get_array() for axes in figure.axes if axes.images]
    assert len(pictures) == 7 * -(-len(tiny.nodes) // 7) and (pictures[0] != pictures[1]).any()


def test_scales_hold_what_they_show():
    assert scale_for(np.zeros(10)) == 0.5 and scale_for(np.full(10, 7.0)) == 8 and scale_for(np.full(10, 1e3)) == 80


def test_strain_is_painted_where_regions_are_and_rest_is_white(tiny):
    rest, raised = strain(tiny, tiny.default), strain(tiny, pose_params(tiny, BROWS_UP))
    in_region = ~np.isnan(rest)
    assert 0.02 < in_region.mean() < 0.9 and np.abs(rest[in_region]).max() < 1e-3
    assert np.nanmax(raised) > 0.03
    colours = strain_colours(raised, 0.2).astype(int)
    assert (colours[~in_region] == NO_REGION).all()
    red = colours[:, 0] - colours[:, 2]
    assert red[np.nanargmax(raised)] > 20


def test_a_fold_chart_starts_at_rest_and_grows(tiny):
    region = next(iter(tiny.wrinkle_states(tiny.default)))
    figure, words = fold_chart(tiny, FOLDED, region)
    assert region in words.caption and len(figure.axes) == 4


def test_the_caption_of_a_fold_chart_tells_the_heights_of_its_section(tiny):
    folds = tiny.wrinkle_states(pose_params(tiny, FOLDED))
    region = max(folds, key=lambda name: np.ptp(folds[name].height_mm))
    figure, words = fold_chart(tiny, FOLDED, region)
    section, whole = figure.axes[2].get_lines()[-1].get_ydata(), folds[region].height_mm
    assert np.ptp(section) < 0.9 * np.ptp(whole), "elsewhere in the region folds are higher"
    assert f"from {section.min():.2f} to {section.max():.2f} mm in the end" in words.caption


def test_a_derivative_is_that_of_finite_differences_and_of_a_known_control(tiny):
    _, words = derivative_sheet(tiny, "jaw_open", {"neutral": tiny.default}, **SMALL)
    column = [control.name for control in tiny.controls].index("jaw_open")
    far = np.linalg.norm(central(tiny, tiny.default, column), axis=1).max()
    distance = float(re.search(r"per unit: neutral ([0-9.]+);? ?", words.caption).group(1).rstrip("."))
    assert distance == pytest.approx(far, abs=0.1) and far > 20
    with pytest.raises(InputError, match="no control 'jaw'; there are"):
        derivative_sheet(tiny, "jaw", {"neutral": tiny.default}, **SMALL)


def test_poses_are_named_amounts_on_both_sides(tiny):
    params = pose_params(tiny, {"smile_*": 0.4, "no_such_control": 1.0})
    names = [control.name for control in tiny.controls]
    assert params[names.index("smile_left")] == params[names.index("smile_right")] == np.float32(0.4)
    assert np.count_nonzero(params) == 2
    with pytest.raises(InputError, match="none of the controls no_such_control"):
        pose_params(tiny, {"no_such_control": 1.0})
