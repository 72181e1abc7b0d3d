"""Rendered panels in a grid with titles and a colour bar; and figures saved as files, with their words."""

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
SMALL_BYTES, PAGE, QUALITY = 120_000, 1000, 90  # a page shows a larger PNG as JPEG, at most so wide, of this quality
WEBP, WEBP_QUALITY = ".webp", 95  # the ending of committed pictures, and their quality where they lose anything


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


def as_picture(figure: "matplotlib.figure.Figure") -> np.ndarray:
    """Return a figure as (height, width, 3) uint8, as it looks at its own resolution."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def png(figure: "matplotlib.figure.Figure", words: Words) -> bytes:
    """Return a figure as PNG with its alt text inside; the same figure gives the same bytes."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    _spell_names(figure)
    drawn, out, about = io.BytesIO(), io.BytesIO(), PngInfo()
    figure.savefig(drawn, format="png", dpi=DPI, pil_kwargs={"compress_level": 0})
    about.add_itxt("Description", words.alt)
    Image.open(drawn).convert("RGB").save(out, format="PNG", pnginfo=about)
    return out.getvalue()


def webp(data: bytes) -> bytes:
    """Return a PNG as WebP: without any loss where that is smaller, as it is for charts, else so that none is seen."""
    from PIL import Image

    picture, forms = Image.open(io.BytesIO(data)).convert("RGB"), []
    for settings in ({"lossless": True}, {"quality": WEBP_QUALITY}):
        out = io.BytesIO()
        picture.save(out, format="WEBP", **settings)
        forms.append(out.getvalue())
    return min(forms, key=len)


def for_page(data: bytes) -> bytes:
    """Return a PNG or WebP for a page of many: as JPEG no wider than the page, or, as charts are, as PNG if small."""
    from PIL import Image

    if data.startswith(b"RIFF"):  # as WebP does
        out = io.BytesIO()
        Image.open(io.BytesIO(data)).save(out, format="PNG")
        data = out.getvalue()
    if len(data) <= SMALL_BYTES:
        return data
    out = io.BytesIO()
    picture = Image.open(io.BytesIO(data)).convert("RGB")
    picture.thumbnail((PAGE, picture.height), Image.Resampling.LANCZOS)
    picture.save(out, format="JPEG", quality=QUALITY, subsampling=0, optimize=True)
    return min(data, out.getvalue(), key=len)


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


def save_figure(figure: "matplotlib.figure.Figure", path: Path, words: Words) -> None:
    """Write a figure to `path`, as WebP or PNG by its ending, and its alt text and caption to a JSON file beside it."""
    data = png(figure, words)
    path.write_bytes(webp(data) if path.suffix == WEBP else data)
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
