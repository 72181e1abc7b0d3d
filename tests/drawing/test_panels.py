"""Figures as files: pixel for pixel, in all their colours, the same bytes each time; smaller on a page of many."""

import io
import json

import numpy as np
import pytest
from bumpy_plate import bumpy_plate
from matplotlib.colors import hsv_to_rgb
from PIL import Image
from scipy.ndimage import gaussian_filter

from replicate.drawing.panels import DPI, PAGE, Words, for_page, panel_grid, png, save_figure
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


def test_a_saved_figure_has_all_its_colours_white_paper_and_its_words(tmp_path, record):
    figure, words = figure10(record, across=200)
    save_figure(figure, tmp_path / "f.png", words)
    image = Image.open(tmp_path / "f.png")
    assert image.mode == "RGB" and image.getpixel((0, 0)) == (255, 255, 255)
    assert image.text["Description"] == words.alt
    assert json.loads((tmp_path / "f.json").read_text()) == {"alt": words.alt, "caption": words.caption}


def test_a_smooth_picture_shows_no_bands(tmp_path):
    hue, light = np.meshgrid(np.linspace(0, 1, 300), np.linspace(0.3, 1, 300))
    smooth = np.uint8(255 * hsv_to_rgb(np.stack([hue, 0 * hue + 0.8, light], -1)))
    figure = panel_grid([[smooth]], ["hues"])
    drawn = np.asarray(Image.open(io.BytesIO(png(figure, Words("hues", "hues")))))
    windows = np.lib.stride_tricks.sliding_window_view(drawn, smooth.shape)
    assert (windows == smooth).all((-1, -2, -3)).any()


def test_a_page_shows_a_large_picture_as_a_jpeg_that_looks_the_same_and_a_chart_as_it_is():
    generator = np.random.default_rng(0)
    smooth = gaussian_filter(generator.uniform(0, 255, (600, 1400, 3)), (6, 6, 0)) * 8 - 900
    noisy = Image.fromarray(np.uint8((smooth + generator.normal(size=smooth.shape) * 3).clip(0, 255)))
    data = io.BytesIO()
    noisy.save(data, format="PNG")
    shown = for_page(data.getvalue())
    page = Image.open(io.BytesIO(shown))
    assert page.format == "JPEG" and page.width == PAGE and len(shown) < 0.3 * len(data.getvalue())
    apart = np.asarray(page, float) - np.asarray(noisy.resize(page.size, Image.Resampling.LANCZOS), float)
    assert np.abs(apart).mean() < 3
    chart = png(panel_grid([[np.full((40, 50, 3), 80, np.uint8)]], ["a"]), Words("a", "a"))
    assert for_page(chart) is chart


def test_a_committed_picture_of_a_face_looks_as_before_in_a_third_of_the_bytes(tmp_path):
    generator = np.random.default_rng(0)
    skin = gaussian_filter(generator.uniform(0, 255, (600, 800, 3)), (9, 9, 0)) * 6 - 640
    skin = np.uint8((skin + gaussian_filter(generator.normal(size=skin.shape), (1, 1, 0)) * 9).clip(0, 255))
    figure = panel_grid([[skin]], ["skin"])
    for ending in ("png", "webp"):
        save_figure(figure, tmp_path / f"skin.{ending}", Words("skin", "skin"))
    drawn, committed = (Image.open(tmp_path / f"skin.{ending}") for ending in ("png", "webp"))
    apart = np.abs(np.asarray(drawn, float) - np.asarray(committed, float))
    assert committed.format == "WEBP" and apart.mean() < 2 and np.percentile(apart, 99) < 8
    assert (tmp_path / "skin.webp").stat().st_size < (tmp_path / "skin.png").stat().st_size / 3


def test_the_same_figure_gives_the_same_bytes(tmp_path, record):
    for name in ("a.png", "b.png"):
        figure, words = figure10(record, across=60)
        save_figure(figure, tmp_path / name, words)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
