"""A large picture on a page of many: shown in fewer colours, in its size."""

import io
import json

import numpy as np
import PIL.Image

from replicate.report import notebooks


def test_a_picture_above_the_bound_is_shown_smaller_and_one_below_as_it_is(tmp_path, monkeypatch):
    rng, shown = np.random.default_rng(0), []
    picture = PIL.Image.fromarray(rng.integers(0, 255, (40, 60, 3), np.uint8))
    picture.save(tmp_path / "a.png")
    (tmp_path / "a.json").write_text(json.dumps({"alt": "noise", "caption": "Noise."}))
    monkeypatch.setattr("IPython.display.display", lambda image, words: shown.append(image.data))
    own = (tmp_path / "a.png").read_bytes()
    for bound in (None, len(own), len(own) - 1):
        notebooks.show_picture(tmp_path / "a.png", bound)
    assert shown[0] == shown[1] == own and len(shown[2]) < len(own)
    small = PIL.Image.open(io.BytesIO(shown[2]))
    assert small.size == picture.size and len(small.getcolors()) < len(picture.getcolors(1 << 24))
