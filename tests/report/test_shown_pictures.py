"""Pictures on a page of many: a large one as JPEG, no wider than the page; a small one as it is; WebP as PNG is."""

import json

import numpy as np
import PIL.Image

from replicate.drawing.panels import SMALL_BYTES, webp
from replicate.report import notebooks


def test_a_large_picture_is_shown_with_fewer_bytes_and_a_small_one_as_it_is(tmp_path, monkeypatch):
    rng, shown = np.random.default_rng(0), []
    monkeypatch.setattr("IPython.display.display", lambda image, words: shown.append(image))
    for name, size in (("small", 100), ("large", 600)):
        PIL.Image.fromarray(rng.integers(0, 12, (size, size, 3), np.uint8)).save(tmp_path / f"{name}.png")
        (tmp_path / f"{name}.json").write_text(json.dumps({"alt": "noise", "caption": "Noise."}))
        notebooks.show_picture(tmp_path / f"{name}.png", width=80)
    small, large = ((tmp_path / f"{name}.png").read_bytes() for name in ("small", "large"))
    assert len(small) < SMALL_BYTES < len(large)
    assert shown[0].data == small and len(shown[1].data) < len(large) and shown[1].data[:2] == b"\xff\xd8"
    assert [image.width for image in shown] == [80, 80]


def test_a_committed_picture_is_found_by_its_name_and_shown_as_it_was_in_a_run(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr("IPython.display.display", lambda image, words: shown.append(image))
    chart = PIL.Image.fromarray(np.kron(np.eye(8, dtype=np.uint8) * 200, np.ones((9, 9), np.uint8))).convert("RGB")
    chart.save(tmp_path / "chart.png")
    (tmp_path / "chart.json").write_text(json.dumps({"alt": "squares", "caption": "Squares."}))
    notebooks.show_picture(tmp_path / "chart")
    (tmp_path / "chart.webp").write_bytes(webp((tmp_path / "chart.png").read_bytes()))
    (tmp_path / "chart.png").unlink()
    notebooks.show_picture(tmp_path / "chart")
    assert shown[0].data == shown[1].data and shown[0].data.startswith(b"\x89PNG"), "a chart loses nothing"
