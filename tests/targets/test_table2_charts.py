"""Table 2's charts: networks, floors, ours and the paper's; letters that can be read, numbers that stand clear."""

from dataclasses import replace

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from sample_rows import CURVE, PAPER_ROWS, table2_rows

from replicate.targets.table2.charts import table2_chart, training_curves

COLUMN_INCHES = 84 / 25.4


def test_training_curves_draw_each_network_and_the_floors():
    curves = {("teen", "coarse"): CURVE, ("teen", "dense"): CURVE, ("other", "refined"): CURVE}
    figure, words = training_curves(curves, table2_rows(), "teen")
    left = figure.axes[0]
    assert [line.get_label() for line in left.lines] == ["Coarse", "Dense", "Floor, coarse maps", "Floor, refined maps"]
    np.testing.assert_allclose(left.lines[0].get_ydata(), [1.25, 1 / 3])
    np.testing.assert_allclose(figure.axes[1].lines[1].get_ydata(), [4.5, 2.0])
    assert "Dense ends at 0.33 mm" in words.alt


def test_the_chart_of_table_2_shows_ours_and_the_papers():
    figure, words = table2_chart(table2_rows(), PAPER_ROWS, "teen")
    points = {(round(line.get_xdata()[0], 2), line.get_ydata()[0]) for line in figure.axes[0].lines}
    assert (0.11, 0) in points and (0.36, 0) in points  # coarse: ours, Hiccup's
    assert len(figure.axes[0].lines) == 9 + 6  # ours, the driven skin among them, and the paper's
    assert "Refined 0.22 mm" in words.alt and "Hiccup" in words.caption
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    alone = table2_chart(table2_rows(("mine",)), PAPER_ROWS, "mine")[0].legends[0].get_texts()
    assert named == ["teen (ours)", "Hiccup (the paper’s)"] and [text.get_text() for text in alone] == ["mine"]
    assert [axes.get_xlabel() for axes in figure.axes] == ["distance error, mm", "normal error, degrees"]


def test_letters_of_table_2s_charts_are_five_points_high_in_a_column_of_the_paper():
    chart = table2_chart(table2_rows(), PAPER_ROWS, "teen")[0]
    curves = training_curves({("teen", "coarse"): CURVE}, table2_rows(), "teen")[0]
    for figure in (chart, curves):
        FigureCanvasAgg(figure).draw()
        shrunk = COLUMN_INCHES / figure.get_size_inches()[0]
        words = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
        assert len(words) > 10 and all(text.get_fontsize() * shrunk >= 5 for text in words)


def test_a_dots_number_stands_clear_of_the_papers_ring_and_of_the_axis():
    figure, _ = table2_chart(table2_rows(), PAPER_ROWS, "teen")
    FigureCanvasAgg(figure).draw()
    renderer = figure.canvas.get_renderer()
    for panel in figure.axes:
        rings = [line for line in panel.lines if line.get_markerfacecolor() == "none"]
        for number in panel.texts:
            box, frame = number.get_window_extent(renderer), panel.get_window_extent(renderer)
            assert frame.x0 < box.x0 and box.x1 < frame.x1 + 10, "no line bounds a panel at its right"
            assert not any(box.contains(*panel.transData.transform(ring.get_xydata()[0])) for ring in rings)


def test_numbers_of_the_largest_dots_stand_on_their_left_and_labels_within_the_figure():
    rows = [replace(row, value=900 * row.value) if row.method == "squares" else row for row in table2_rows()]
    rows += [replace(row, method="squares", value=900 * row.value) for row in table2_rows() if row.method == "linear"]
    figure, _ = table2_chart(rows, PAPER_ROWS, "teen")
    FigureCanvasAgg(figure).draw()
    renderer, width = figure.canvas.get_renderer(), figure.get_size_inches()[0] * figure.dpi
    for panel in figure.axes:
        furthest = max(panel.texts, key=lambda number: number.xy[0])
        assert furthest.get_ha() == "right" and {number.get_ha() for number in panel.texts} == {"left", "right"}
        assert panel.xaxis.label.get_window_extent(renderer).x1 <= width
