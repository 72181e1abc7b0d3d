"""Sheets of faces: pictures pixel for pixel, rows that fill the width, letters that stay legible in print."""

from itertools import pairwise

import numpy as np

from replicate.drawing.face_sheet import WIDTH, Cell, cell_width, face_sheet
from replicate.drawing.panels import DPI, Words, save_figure

COLUMN_INCHES = 84 / 25.4


def cells(count: int, width: int, lines: tuple[str, ...] = ()) -> list[Cell]:
    return [Cell(f"title {k}", (np.full((50, width, 3), 40 + 10 * k, np.uint8),), lines) for k in range(count)]


def test_columns_fill_the_width():
    figure = face_sheet(cells(7, cell_width(5), ("1°",)), 5)
    boxes = [axes.get_position() for axes in figure.axes]
    assert len(boxes) == 7 and 0.98 < max(box.x1 for box in boxes) <= 1 and 0 <= min(box.x0 for box in boxes) < 0.02
    assert all(one.x1 < other.x0 for one, other in pairwise(boxes[:5]))


def test_a_row_that_is_not_full_comes_last():
    figure = face_sheet(cells(7, cell_width(5)), 5)
    tops = [round(axes.get_position().y1, 3) for axes in figure.axes]
    assert [tops.count(top) for top in dict.fromkeys(tops)] == [5, 2]
    assert [text.get_text() for text in figure.texts] == [f"title {k}" for k in range(7)]


def test_pictures_below_fill_the_width_under_all_cells():
    below = np.zeros((80, WIDTH, 3), np.uint8)
    figure = face_sheet(cells(3, cell_width(3), ("1 mm",)), 3, below=(below, below))
    *above, first, second = (axes.get_position() for axes in figure.axes)
    lowest = min(text.get_position()[1] for text in figure.texts)
    assert first.width == second.width == 1 and second.y0 > 0
    assert max(box.y0 for box in above) > lowest > first.y1 > first.y0 > second.y1


def test_pictures_are_drawn_pixel_for_pixel(tmp_path):
    from PIL import Image

    rng = np.random.default_rng(0)
    pictures = tuple(rng.choice(np.uint8([0, 80, 160, 255]), size=(tall, 90, 1)).repeat(3, -1) for tall in (8, 5))
    figure = face_sheet([Cell("a", pictures, ("1 mm",)), Cell("b", pictures, ("2 mm",))], 2)
    save_figure(figure, tmp_path / "f.png", Words("alt", "caption"))
    image = np.array(Image.open(tmp_path / "f.png").convert("RGB"))
    assert image.shape[1] == WIDTH
    for picture in pictures:
        windows = np.lib.stride_tricks.sliding_window_view(image[:, :210], picture.shape)
        assert (np.abs(windows.astype(int) - picture) <= 2).all((-1, -2, -3)).sum() == 2


def test_letters_are_five_points_high_in_a_column_of_the_paper():
    figure = face_sheet(cells(5, cell_width(5), ("1°", "2°")), 5)
    shrunk = COLUMN_INCHES / (WIDTH / DPI)
    assert figure.texts and all(text.get_fontsize() * shrunk >= 5 for text in figure.texts)


def test_no_title_is_wider_than_its_picture_and_a_colon_ends_a_line():
    figure = face_sheet([Cell("LBS: 16 bones †", (np.zeros((50, 224, 3), np.uint8),))], 5)
    assert [text.get_text() for text in figure.texts] == ["LBS:", "16 bones\N{NO-BREAK SPACE}†"]
    renderer = figure.canvas.get_renderer() if hasattr(figure.canvas, "get_renderer") else _agg(figure)
    assert all(text.get_window_extent(renderer).width <= 224 for text in figure.texts)


def test_a_mark_stands_in_the_line_of_the_word_before_it():
    for title, width in (("Regional (ours) ★", 266), ("LBS: 16 bones †", 224)):
        figure = face_sheet([Cell(title, (np.zeros((50, width, 3), np.uint8),))], 5)
        *_, last = (text.get_text() for text in figure.texts)
        assert last.endswith(title[-1]) and len(last) > 5


def _agg(figure):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    return FigureCanvasAgg(figure).get_renderer()
