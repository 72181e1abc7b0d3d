"""Rendered panels in a grid with titles and a colour bar; and figures saved as small files, with their words."""

import io
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure


DPI = 100
GAP, TITLE, SIDE, BAR, MARGIN = 6, 26, 26, 74, 8  # pixels
LARGEST_BYTES = 300_000
FULL_COLOUR = 2_000_000  # the bound of pictures in all their colours, such as portraits
FLAT_PIXELS = 40  # a colour with so many pixels that it surrounds was chosen, not made by shading


@dataclass(frozen=True)
class Words:
    """The words of a figure: alt text for those who can't see it, and the caption."""

    alt: str
    caption: str


def panel_grid(
    rows: Sequence[Sequence[np.ndarray]],
    titles: Sequence,
    names: Sequence[str] = (),
    bar: tuple[int, int, Callable] | None = None,
) -> "matplotlib.figure.Figure":
    """Return a matplotlib figure of equally large pictures.

    rows: pictures (h, w, 3) uint8. titles: one for each column, or for each row a list with one for each picture.
    names: one for each row, at its left. bar: (first row, last row, draw), where draw(figure, axes) draws a colour bar
    to the right of those rows.
    """
    from matplotlib.figure import Figure

    # sizes in pixels
    height, width = rows[0][0].shape[:2]
    titled_rows = not isinstance(titles[0], str)
    step, left = height + (TITLE if titled_rows else GAP), MARGIN + (SIDE if names else 0)
    total_width = left + len(rows[0]) * (width + GAP) - GAP + (BAR if bar else MARGIN)
    total_height = TITLE + (len(rows) - 1) * step + height + MARGIN
    figure = Figure((total_width / DPI, total_height / DPI), dpi=DPI, facecolor="white")

    def place(x, y, w, h):  # pixels from the upper left corner
        return figure.add_axes((x / total_width, 1 - (y + h) / total_height, w / total_width, h / total_height))

    def write(x, y, text, **style):
        figure.text(x / total_width, 1 - y / total_height, text, ha="center", va="center", **style)

    # pictures under their titles, row by row, and the colour bar beside them
    for r, pictures in enumerate(rows):
        top = TITLE + r * step
        for c, picture in enumerate(pictures):
            axes = place(left + c * (width + GAP), top, width, height)
            axes.imshow(picture, interpolation="none", aspect="auto")
            axes.set_axis_off()
            if titled_rows or r == 0:
                title = (titles[r] if titled_rows else titles)[c]
                write(left + c * (width + GAP) + width / 2, top - TITLE / 2, title, fontsize=10)
        if names:
            write(MARGIN + SIDE / 2, top + height / 2, names[r], rotation=90, fontsize=9)
    if bar:
        first, last, draw = bar
        top, bottom = TITLE + first * step, TITLE + last * step + height
        inset = (bottom - top) // 10
        draw(figure, place(total_width - BAR + 12, top + inset, 12, bottom - top - 2 * inset))
    return figure


def png(
    figure: "matplotlib.figure.Figure", words: Words, largest_bytes: int = LARGEST_BYTES, dither: bool = False
) -> bytes:
    """Return a figure as PNG with its alt text inside: in full colour where the bound is `FULL_COLOUR`, else a palette.

    It has fewer colours where it would be too large. The same figure gives the same bytes. dither: mix neighbouring
    colours, for figures of more hues than a palette has; not for colours that are read off a bar.
    """
    _spell_names(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return compress(buffer.getvalue(), words.alt, largest_bytes, dither)


def _spell_names(figure: "matplotlib.figure.Figure") -> None:
    """Have texts that are not formulas drawn letter by letter: a name may have $ and \\ in it."""
    from matplotlib.mathtext import MathTextParser
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if text.get_text().count("$") > 1:
            try:
                MathTextParser("path").parse(text.get_text())
            except ValueError:
                text.set_parse_math(False)


def compress(data: bytes, alt: str, largest_bytes: int, dither: bool = False) -> bytes:
    """Return a PNG with the alt text inside, in as many colours as the bound allows; see `png`."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    picture = Image.open(io.BytesIO(data)).convert("RGB")
    about = PngInfo()
    about.add_itxt("Description", alt)
    for colours in (None, 256, 128, 64, 32, 16):
        if colours is None and largest_bytes < FULL_COLOUR:
            continue
        out = io.BytesIO()
        shown = picture if colours is None else _with_palette(picture, colours, dither)
        shown.save(out, format="PNG", optimize=True, pnginfo=about)
        if out.tell() < largest_bytes:
            break
    return out.getvalue()


def _with_palette(picture, colours: int, dither: bool):
    from PIL import Image

    # Hues weigh by the root of their pixels: else a legend's patch or an eye would get its neighbours' mean colour.
    pixels = np.asarray(picture).reshape(-1, 3)
    codes = pixels @ np.int32([1 << 16, 1 << 8, 1])  # faster than rows
    codes, place, counts = np.unique(codes, return_inverse=True, return_counts=True)
    hues = np.stack([codes >> 16, codes >> 8, codes], axis=1).astype(np.uint8)
    place = place.reshape(picture.height, picture.width)
    flat = _flat_hues(place, len(hues))[: colours // 2]
    room = colours - len(flat)
    sample = Image.fromarray(np.repeat(hues, np.ceil(np.sqrt(counts)).astype(int), axis=0)[None])
    palette = sample.quantize(room, method=Image.Quantize.MEDIANCUT, kmeans=2)
    dithering = Image.Dither.FLOYDSTEINBERG if dither else Image.Dither.NONE
    indices = np.array(picture.quantize(palette=palette, dither=dithering))
    entry = np.full(len(hues), -1)  # of the palette, for hues that stay as they are
    entry[flat] = np.arange(room, colours)
    exact = entry[place]
    indices = np.where(exact >= 0, exact, indices).astype(np.uint8)
    table = np.full((colours, 3), 255, np.uint8)
    means = np.array(palette.getpalette(), np.uint8).reshape(-1, 3)[:room]
    table[: len(means)] = means
    table[room:] = hues[flat]
    image = Image.fromarray(indices)
    image.putpalette(table.ravel().tolist())
    return image


def _flat_hues(place: np.ndarray, count: int) -> np.ndarray:
    """Return the hues that fill areas without shading, such as paper and a legend's squares, the largest first.

    They were chosen, not made by light, and have to stay as they are. place: (h, w), each pixel's hue. count: of hues.
    """
    middle = place[1:-1, 1:-1]
    around = (place[:-2, 1:-1], place[2:, 1:-1], place[1:-1, :-2], place[1:-1, 2:])
    inner = np.bincount(middle[np.logical_and.reduce([middle == other for other in around])], minlength=count)
    order = np.argsort(-inner, kind="stable")
    return order[inner[order] >= FLAT_PIXELS]


def save_figure(
    figure: "matplotlib.figure.Figure",
    path: Path,
    words: Words,
    largest_bytes: int = LARGEST_BYTES,
    dither: bool = False,
) -> None:
    """Write a figure to `path` as `png` makes it, and its alt text and caption to a .json file beside it."""
    path.write_bytes(png(figure, words, largest_bytes, dither))
    text = json.dumps({"alt": words.alt, "caption": words.caption}, indent=1, ensure_ascii=False)
    path.with_suffix(".json").write_text(text + "\n", encoding="utf-8")


def has_figure(path: Path) -> bool:
    """Return whether `save_figure` has written a figure and its words, and neither file is damaged."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            picture.verify()  # the checksums of the file's parts
        words = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError):  # SyntaxError is Pillow's for a wrong checksum
        return False
    return isinstance(words, dict) and set(words) == {"alt", "caption"}


# One style for all charts, in letters that stay legible in a paper's column.

WIDTH = 10.0  # inches; a column of the paper shows a third of it
LETTER_PT = 15.5  # the size of letters in a chart so wide: 5 points in a column
MEASURES = (
    ("vertex_error_mean", "mm", "distance error, mm"),
    ("normal_error_mean", "deg", "normal angle error, degrees"),
)


def tidy(axes: "matplotlib.axes.Axes") -> None:
    """Remove the right and upper edges of a chart, and lay a faint grid behind it."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)


def enlarge(axes: "matplotlib.axes.Axes", size_pt: float = LETTER_PT) -> None:
    """Set all text that a chart has so far to one size."""
    axes.tick_params(which="both", labelsize=size_pt)
    legend = axes.get_legend()
    for text in (axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts, *(legend.get_texts() if legend else ())):
        text.set_fontsize(size_pt)


def error_scale(axes: "matplotlib.axes.Axes", which: str = "x") -> None:
    """Make an axis logarithmic, with plain numbers at its ticks.

    which: "x" or "y". Call it after everything is drawn: the shorter an axis, the more ticks a decade.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    low, high = axes.get_xlim() if which == "x" else axes.get_ylim()
    axis = axes.xaxis if which == "x" else axes.yaxis
    decades = abs(math.log10(high / low))
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < 1.6 else (1, 3) if decades < 2.5 else (1,)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
