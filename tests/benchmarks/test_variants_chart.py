"""The chart of trainings that differ in one thing, and the figure of the regional method."""

from dataclasses import replace

import numpy as np
import pytest
import rigs

from replicate.benchmarks.bench_regional import region_colours, regional_figure
from replicate.benchmarks.variants import variants_chart
from replicate.drawing.rig_views import UNUSED_COLOUR
from replicate.methods.regional import RegionalConfig
from replicate.report.results import Row

ERRORS = {"as it is": (0.2, 1.0), "no line": (0.4, 4.0), "wider": (0.1, 0.5)}


def rows(character="teen"):
    metrics = (("validation_vertex_error", "mm"), ("validation_normal_error", "deg"))
    return [
        Row("bench", character, "regional", f"{metric}[{change}]", unit, values[k], None, 1, 64, "laptop", "bench")
        for change, values in ERRORS.items()
        for k, (metric, unit) in enumerate(metrics)
    ]


def chart():
    changes = {"regional": ("as it is", "no line", "never trained", "wider")}
    return variants_chart([*rows(), *rows("toon")], "bench", "teen", changes, ("as it is",))


def test_each_change_is_a_bar_from_the_base_to_its_own_error():
    figure, _ = chart()
    for k, axes in enumerate(figure.axes):
        bars = [line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 2]
        assert [tuple(bar) for bar in bars] == [(ERRORS["as it is"][k], ERRORS[c][k]) for c in ("no line", "wider")]
        points = [float(line.get_xdata()[0]) for line in axes.lines if len(line.get_xdata()) == 1]
        assert points == [values[k] for values in ERRORS.values()], "what was not trained has no line"


def test_numbers_stand_in_a_column_beside_the_panel_in_the_format_of_the_tables():
    figure, _ = chart()
    for axes, expected in zip(figure.axes, (["0.20", "0.40", "0.10"], ["1.00", "4.00", "0.50"]), strict=True):
        assert [text.get_text() for text in axes.texts] == expected
        assert all(text.xy[0] == 1 and text.get_position()[0] > 0 for text in axes.texts), "beside all bars"
    figure.draw_without_rendering()
    axes = figure.axes[0]
    ticks = [tick.get_text() for tick in axes.get_xticklabels() if axes.get_xlim()[0] < tick.get_position()[0]]
    assert len(ticks) > 1 and len({len(text.partition(".")[2]) for text in ticks}) == 1, "less than a decade"


def test_what_is_changed_stands_below_its_base_without_its_name():
    base = [replace(row, metric=row.metric.replace("[wider]", "[as it is, but wider]")) for row in rows()]
    changes = {"regional": ("as it is", "no line", "as it is, but wider")}
    axes = variants_chart(base, "bench", "teen", changes, ("as it is",))[0].axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["as it is", "no line", "but wider"]


def test_the_words_name_the_best_and_the_worst():
    words = chart()[1]
    assert "smallest normal error, 0.5 degrees, is of regional, wider" in words.alt
    assert "largest normal error, 4 degrees, is of regional, no line" in words.alt


@pytest.fixture(scope="module")
def rig():
    return rigs.rig("tiny")


def test_rigid_segments_are_gray_and_regions_have_a_colour_each(rig):
    rigid = np.zeros(len(rig.mesh.segment_names), bool)
    rigid[-1] = True
    colours = region_colours(rig, rigid, 5)
    gray = (colours == UNUSED_COLOUR).all(1)
    np.testing.assert_array_equal(gray, rigid[rig.mesh.segment[rig.mesh.faces[:, 0]]])
    assert len(np.unique(colours[~gray], axis=0)) == 5


def test_the_figure_says_what_it_shows(rig):
    rigid = np.zeros(len(rig.mesh.segment_names), bool)
    config = RegionalConfig(regions=3, components=7, hidden=(20, 10))
    figure, words = regional_figure(rig, rigid, config, "tiny")
    texts = {text.get_text() for axes in figure.axes for text in axes.texts}
    assert {"for each of the 3 regions $r$:", "$c_r$: 7\ncoefficients"} <= texts
    assert {"gated layer\n20", "gated layer\n10"} <= texts
    assert "3 regions" in words.caption and "20 and 10" in words.alt
