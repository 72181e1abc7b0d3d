"""Figures as files: pixel for pixel, small, with a palette that keeps what matters, the same bytes each time."""

import json

import numpy as np
import pytest
from bumpy_plate import bumpy_plate
from matplotlib.colors import hsv_to_rgb
from PIL import Image
from scipy.ndimage import gaussian_filter

from replicate.drawing.panels import DPI, Words, panel_grid, save_figure
from replicate.report.pose_record import PoseRecord
from replicate.targets.figure10 import figure10


@pytest.fixture
def record() -> PoseRecord:
    """A bumpy plate that two methods predict."""
    return bumpy_plate()


def test_panels_are_drawn_pixel_for_pixel(tmp_path):
    rng = np.random.default_rng(0)
    picture = rng.choice(np.uint8([0, 80, 160, 255]), size=(40, 50, 1)).repeat(3, -1)
    figure = panel_grid([[picture, picture]], ["a", "b"])
    save_figure(figure, tmp_path / "f.png", Words("what it shows: α", "what it means"))
    image = np.array(Image.open(tmp_path / "f.png").convert("RGB"))
    assert image.shape[:2] == tuple(round(x * DPI) for x in figure.get_size_inches()[::-1])
    windows = np.lib.stride_tricks.sliding_window_view(image, picture.shape)
    assert (np.abs(windows.astype(int) - picture) <= 2).all((-1, -2, -3)).sum() == 2


def test_a_saved_figure_is_small_has_a_palette_white_paper_and_its_words(tmp_path, record):
    figure, words = figure10(record, across=200)
    save_figure(figure, tmp_path / "f.png", words)
    image = Image.open(tmp_path / "f.png")
    assert image.mode == "P" and (tmp_path / "f.png").stat().st_size < 300_000
    assert image.convert("RGB").getpixel((0, 0)) == (255, 255, 255)
    assert image.text["Description"] == words.alt
    assert json.loads((tmp_path / "f.json").read_text()) == {"alt": words.alt, "caption": words.caption}


def test_a_figure_that_would_be_too_large_gets_fewer_colours(tmp_path):
    x, y = np.meshgrid(np.linspace(0, 255, 300), np.linspace(0, 255, 300))
    noise = np.random.default_rng(0).normal(size=(2, 300, 300, 1)) * 12
    picture = np.uint8((np.stack([x, y, 255 - x], -1) + noise[0] + noise[1]).clip(0, 255))
    figure = panel_grid([[picture]], ["noise"])
    save_figure(figure, tmp_path / "f.png", Words("noise", "noise"))
    size = (tmp_path / "f.png").stat().st_size
    assert 50_000 < size < 300_000
    save_figure(figure, tmp_path / "f.png", Words("noise", "noise"), size - 1)
    assert 30_000 < (tmp_path / "f.png").stat().st_size < size


def test_a_legends_colours_are_exact_beside_a_picture_of_many_hues(tmp_path):
    generator = np.random.default_rng(0)
    squares = generator.integers(0, 256, (24, 3), np.uint8)
    x, y = np.meshgrid(np.linspace(0, 255, 300), np.linspace(0, 255, 300))
    picture = np.uint8((np.stack([x, y, 255 - x], -1) + generator.normal(size=(300, 300, 1)) * 8).clip(0, 255))
    for k, square in enumerate(squares):
        picture[12 * k : 12 * k + 11, 5:16] = square
    save_figure(panel_grid([[picture]], ["hues"]), tmp_path / "f.png", Words("hues", "hues"))
    image = Image.open(tmp_path / "f.png")
    drawn = np.asarray(image.convert("RGB")).reshape(-1, 3)
    assert image.mode == "P" and all((drawn == square).all(-1).sum() >= 121 for square in squares)


def test_mixtures_of_many_hues_show_no_bands_where_palette_colours_are_mixed(tmp_path):
    hue, light = np.meshgrid(np.linspace(0, 1, 300), np.linspace(0.3, 1, 300))
    smooth = np.uint8(255 * hsv_to_rgb(np.stack([hue, 0 * hue + 0.8, light], -1)))
    figure = panel_grid([[smooth]], ["hues"])
    pictures = {}
    for dither in (False, True):
        save_figure(figure, tmp_path / "f.png", Words("hues", "hues"), dither=dither)
        image = Image.open(tmp_path / "f.png")
        assert image.mode == "P"
        pictures[dither] = np.asarray(image.convert("RGB"), float)
    figure.savefig(tmp_path / "exact.png", dpi=DPI)
    exact = np.asarray(Image.open(tmp_path / "exact.png").convert("RGB"), float)
    banding = {d: np.abs(gaussian_filter(pictures[d] - exact, (3, 3, 0))).mean() for d in pictures}
    assert banding[True] < 0.5 * banding[False]


def test_the_same_figure_gives_the_same_bytes(tmp_path, record):
    for name in ("a.png", "b.png"):
        figure, words = figure10(record, across=60)
        save_figure(figure, tmp_path / name, words)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
