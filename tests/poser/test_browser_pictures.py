"""Pictures of the posing page in a browser: links that Python makes pose the page, and a strip has a picture a drag."""

import re

import numpy as np
import pytest
from browser import Tab
from posed_face import posed_face
from posing_page import page_of

from replicate.base.exceptions import RunError
from replicate.inverse.control_points import control_points
from replicate.poser import browser_pictures
from replicate.poser.face_page import posed_vertices


@pytest.fixture(scope="module")
def face():
    return posed_face()


@pytest.fixture
def page(tmp_path):
    file = tmp_path / "page.html"
    file.write_text(page_of(), encoding="utf-8")
    return file


@pytest.fixture
def program():
    return browser_pictures.browser() or pytest.skip("needs a browser")


def test_a_link_poses_the_page(face, page, tmp_path, program):
    rest = posed_vertices(face, face.rig.default[None])[0, control_points(face.rig, face.influence).vertices]
    targets = rest + np.float32([3, -2, 0])
    params = face.dragged(face.rig.default, rest, targets)
    assert np.abs(params).max() > 0.05 and (params >= face.rig.lower).all() and (params <= face.rig.upper).all()
    with Tab(tmp_path) as tab:
        tab.open(
            f"{page.as_uri()}#{browser_pictures.pose_link(face, params, targets)}",
            "window.mounted && mounted.then(Boolean)",
        )
        lists = tab.evaluate("mounted.then(({pose}) => [Array.from(pose.params), Array.from(pose.targets)])")
    np.testing.assert_allclose(lists[0], params, atol=1e-4)
    np.testing.assert_allclose(np.reshape(lists[1], (-1, 3)), targets, atol=0.011)


def test_a_strip_shows_the_face_at_rest_and_after_each_drag(face, page, program, monkeypatch):
    assert browser_pictures.strip(face, page, program) is None, "no point is called so"
    seen, real = [], browser_pictures.picture
    monkeypatch.setattr(
        browser_pictures, "DRAGS", (("point_01", "the first point", (6.0, 5.0)), ("nobody", "", (1.0, 1.0)))
    )
    monkeypatch.setattr(browser_pictures, "picture", lambda *call: seen.append(real(*call)) or seen[-1])
    figure, words = browser_pictures.strip(face, page, program)
    assert [text.get_text() for text in figure.texts] == ["at rest", "the first point dragged up"]
    assert "pose the small in" in words.alt and "the first point dragged up" in words.alt
    assert [picture.shape for picture in seen] == [(*browser_pictures.SIZE[::-1], 3)] * 2
    assert (seen[0] != seen[1]).any(axis=2).sum() > 500, "the dot, the face and the sliders have moved"


def test_a_browser_that_makes_no_picture_ends_in_a_sentence(page):
    with pytest.raises(RunError, match=re.escape("false made no picture of page.html")):
        browser_pictures.picture(page, "", "false")
