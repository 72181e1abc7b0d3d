"""The page itself, in a browser: its arithmetic is Python's, drags and files do what they say, nothing is fetched."""

import html
import io
import json
import re
import subprocess

import numpy as np
import pytest
from browser import Tab, command
from PIL import Image
from posed_face import coarse_model, refined_model
from posing_page import page_of

FRAMES_MS = 3_000  # of the browser's own time


def browsed(folder, text, *options, ending=""):
    """Return the page as a browser has it after a while; a browser without a network."""
    file = folder / "page.html"
    file.write_text(text, encoding="utf-8")
    ends = [f"--virtual-time-budget={FRAMES_MS}", "--dump-dom", f"{file.as_uri()}{ending}"]
    call = [*command(folder / "profile", *options), *ends]
    return subprocess.run(call, capture_output=True, text=True, timeout=300).stdout


def report_of(dom):
    (text,) = re.findall(r'<pre id="selftest">(.*?)</pre>', dom, re.DOTALL)
    report = json.loads(html.unescape(text))
    assert "error" not in report, report["error"]
    return report


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return report_of(browsed(tmp_path_factory.mktemp("browser"), page_of(), ending="#selftest"))


def test_vertices_and_parameters_are_those_of_python(report):
    assert report["poses"] == 4
    assert report["vertices_mm"] < 0.01 and report["parameters"] < 1e-4


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (coarse_model(), "the coarse CNN of the paper"),
        (coarse_model(16, 6), "the coarse CNN of the paper"),
        (refined_model(), "the refined CNN of the paper"),
    ],
    ids=["coarse", "other sizes", "refined"],
)
def test_a_page_may_have_the_cnn_in_the_place_of_our_method(tmp_path, model, words):
    text = page_of(model=model)
    assert f"an approximation of the rig, {words}, turns" in " ".join(text.split())
    report = report_of(browsed(tmp_path, text, ending="#selftest"))
    assert report["poses"] == 4 and report["vertices_mm"] < 0.01 and report["parameters"] < 1e-4


def test_a_wrong_answer_would_be_noticed(tmp_path):
    def damage(arrays):
        arrays["check.vertices"][2, -1, 1] += 1  # of the tooth
        arrays["check.solved"][1, 3] += 0.3

    wrong = report_of(browsed(tmp_path, page_of(damage), ending="#selftest"))
    assert wrong["vertices_mm"] == pytest.approx(1, abs=0.01) and wrong["parameters"] == pytest.approx(0.1, abs=1e-3)


def test_a_drag_moves_its_dot_and_no_parameter_of_another_region(report):
    assert [drag["region"] for drag in report["drags"]] == ["face", "neck"]
    for drag in report["drags"]:
        np.testing.assert_allclose(drag["target_mm"], [2, -3, 0], atol=1e-3)
        np.testing.assert_allclose(drag["dot_px"], 0, atol=0.1)
        assert drag["moved"] and set(drag["moved"]) <= set(drag["allowed"])
        assert np.abs(drag["reached_mm"]).max() > 1e-3


def test_a_slider_moves_its_control_alone_and_the_points_go_with_the_face(report):
    slider = report["slider"]
    assert slider["moved"] == ["c0"] and slider["apart_mm"] == 0
    assert slider["value"] == pytest.approx(slider["wanted"], abs=0.003)  # a thousandth of its range


def test_a_pose_comes_back_from_its_file_and_from_its_link(report):
    assert report["file"] < 1e-3 and report["link"] < 0.01


def test_files_that_are_no_poses_of_this_face_are_refused_in_a_sentence_and_change_nothing(report):
    words = {
        "letters": "is not JSON",
        "list": "is not a saved pose",
        "stranger": "of the character nobody, and the face here is small",
        "control": 'no control "nose_length"',
        "value": 'control "c0": expected a number from -1 to 2, got 99',
        "none": 'control "c0": expected a value, got none',
        "point": 'control point "point_01": expected three lengths from -10000 to 10000 mm, got undefined',
        "far": 'control point "point_01": expected three lengths from -10000 to 10000 mm, got [0,1e+39,0]',
        "link": "is not a pose of small",
    }
    for name, phrase in words.items():
        assert report["refused"][name] and phrase in report["refused"][name], name


def test_a_browser_that_lacks_something_is_told_what(tmp_path):
    old = page_of().replace("<script>", "<script>delete window.DecompressionStream;</script>\n<script>", 1)
    assert "this browser has no DecompressionStream" in browsed(tmp_path, old)
    assert "this browser shows no WebGL 2" in browsed(tmp_path, page_of(), "--disable-3d-apis")


def test_a_page_is_one_file_that_asks_for_nothing():
    text = page_of()
    addresses = set(
        re.findall(r"\w+://[^\"'\s)]*", re.sub(r'<script id="packed".*?</script>', "", text, flags=re.DOTALL))
    )
    assert addresses == {"http://www.w3.org/2000/svg"}, "that is the name of a kind of element"
    assert not re.findall(r"<link|<img|<iframe|\bsrc=|\bimport\b|XMLHttpRequest|WebSocket|fetch\(|@import|url\(", text)
    assert "default-src 'none'" in text and "a test &amp; nothing else" in text


def test_the_same_face_makes_the_same_page():
    assert page_of() == page_of()


def test_vertices_lit_without_a_graphics_card_look_like_pixels_lit_by_one(tmp_path):
    """The tests' browser has no card: a page that takes it for one must still show the face, and the same one."""
    plain = page_of()
    as_if = plain.replace("return !/SwiftShader", "return true || !/SwiftShader")
    assert as_if != plain
    pictures = []
    for name, text in {"vertices": plain, "pixels": as_if}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "page.html").write_text(text, encoding="utf-8")
        with Tab(tmp_path / name) as tab:
            tab.open((tmp_path / name / "page.html").as_uri(), "window.mounted && mounted.then(Boolean)")
            assert tab.evaluate("mounted.then(({view}) => view.card)") is (name == "pixels")
            tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
            with Image.open(io.BytesIO(tab.picture())) as image:
                pictures.append(np.asarray(image.convert("RGB"), np.float64))
    apart = np.abs(pictures[0] - pictures[1]).mean(axis=2)
    assert 0 < apart.mean() < 2 and (apart > 40).mean() < 0.01, "of 255"
    assert (pictures[0].std(axis=2) > 20).mean() > 0.02, "there is a face in it"
