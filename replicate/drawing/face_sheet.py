"""Faces in rows, each with its title above and lines of text below, in letters that stay legible in a paper's column.

A column of the paper is 84 mm wide, and a sheet as many pixels as fill it at 300 dots an inch: letters of `LETTER` are
5 points high in print.
"""

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from replicate.drawing.panels import DPI

if TYPE_CHECKING:
    import matplotlib.figure

WIDTH = 1400  # pixels
LETTER = 0.0215  # the size of letters as a share of the width
GAP, MARGIN = 8, 6  # pixels
LINE = 1.22  # the distance of two lines of text, in sizes of letters
WIDE = 0.58  # a letter's mean width, in its size
BAR_HEIGHT = 0.018  # of the colour bar, as a share of the width


@dataclass(frozen=True)
class Cell:
    """One place of a sheet: a title, pictures (h, w, 3) uint8 one above the other, and lines below them."""

    title: str
    pictures: tuple[np.ndarray, ...]
    lines: tuple[str, ...] = ()


def cell_width(columns: int, width: int = WIDTH) -> int:
    """Return how wide pictures are, in pixels, where so many columns fill a sheet."""
    return int((width - 2 * MARGIN - (columns - 1) * GAP) / columns)


def face_sheet(
    cells: Sequence[Cell],
    columns: int,
    bar: Callable | None = None,
    width: int = WIDTH,
    first_bold: bool = False,
    below: Sequence[np.ndarray] = (),
) -> "matplotlib.figure.Figure":
    """Return a matplotlib figure of cells, row by row, drawn pixel for pixel.

    cells: with pictures of the same sizes, as wide as `cell_width` says.
    columns: cells in a row.
    bar: (figure, axes) → None, draws a horizontal colour bar below the last row.
    width: of the figure, pixels.
    first_bold: write the first line of each cell in bold.
    below: pictures that fill the width, one below the other, under all else.
    """
    from matplotlib.figure import Figure

    # sizes in pixels, from the titles' lines to the whole height
    letter = LETTER * width
    across = cells[0].pictures[0].shape[1]
    titles = [_in_lines(cell.title, int(across / (WIDE * letter))) for cell in cells]
    rows = [range(start, min(start + columns, len(cells))) for start in range(0, len(cells), columns)]
    above = [letter * (LINE * max(len(titles[k]) for k in row) + 0.35) for row in rows]
    tall = sum(picture.shape[0] for picture in cells[0].pictures) + GAP * (len(cells[0].pictures) - 1)
    under = letter * (LINE * max(len(cell.lines) for cell in cells) + 0.4)
    bar_room = BAR_HEIGHT * width + 3.4 * letter if bar else 0
    height = round(sum(above) + len(rows) * (tall + under) + bar_room + MARGIN)
    height += sum(picture.shape[0] + GAP for picture in below)
    figure = Figure((width / DPI, height / DPI), dpi=DPI, facecolor="white")
    size, weights = letter * 72 / DPI, ("bold" if first_bold else "normal", "normal")

    def write(x: float, y: float, text: str, weight: str = "normal") -> None:  # pixels from the upper left corner
        figure.text(x / width, 1 - y / height, text, ha="center", va="center", fontsize=size, weight=weight)

    # row by row, each cell from its title down
    top = 0.0
    for row, room in zip(rows, above, strict=True):
        first_line = top + room + tall + letter * (LINE / 2 + 0.2)
        for column, k in enumerate(row):
            left = MARGIN + column * (across + GAP)
            for j, words in enumerate(titles[k]):
                y = top + room - letter * (0.25 + LINE * (len(titles[k]) - j - 0.5))
                write(left + across / 2, y, words)
            y = round(top + room)
            for picture in cells[k].pictures:
                _place(figure, picture, left, y)
                y += picture.shape[0] + GAP
            for j, text in enumerate(cells[k].lines):
                y = first_line + j * LINE * letter
                write(left + across / 2, y, text, weights[j > 0])
        top += room + tall + under
    # the colour bar, and the pictures that fill the width
    if bar:
        axes = figure.add_axes(
            (0.2, 1 - (top + 0.5 * letter + BAR_HEIGHT * width) / height, 0.6, BAR_HEIGHT * width / height)
        )
        bar(figure, axes)
        axes.tick_params(labelsize=size)
        axes.xaxis.label.set_size(size)
    y = round(top + bar_room)
    for picture in below:
        _place(figure, picture, (width - picture.shape[1]) / 2, y)
        y += picture.shape[0] + GAP
    return figure


def _in_lines(title: str, most: int) -> list[str]:
    """Return a title in lines of at most so many letters; one that is too long breaks at its colon first."""
    title = _with_its_mark(title)
    head, colon, rest = title.partition(": ")
    parts = [head + ":", rest] if colon and len(title) > most else [title]
    return [line for part in parts for line in textwrap.wrap(part, max(6, most))]


def _with_its_mark(title: str) -> str:
    """Return a title in which a mark at the end stays on the line of the word before it."""
    words, space, mark = title.rpartition(" ")
    return f"{words}\N{NO-BREAK SPACE}{mark}" if space and len(mark) == 1 and not mark.isalnum() else title


def _place(figure, picture: np.ndarray, left: float, top: float) -> None:
    width, height = (round(inches * DPI) for inches in figure.get_size_inches())
    tall, across = picture.shape[:2]
    left = round(left)
    axes = figure.add_axes((left / width, 1 - (top + tall) / height, across / width, tall / height))
    axes.imshow(picture, interpolation="none", aspect="auto")
    axes.set_axis_off()
