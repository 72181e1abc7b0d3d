"""A large picture on a page of many: shown as JPEG, no wider than the page; a small one as it is."""

import json

import numpy as np
import PIL.Image

from replicate.drawing.panels import SMALL_BYTES
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
