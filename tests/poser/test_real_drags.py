"""The posing page under a real mouse and a real finger: dragged, saved, loaded and linked poses are Python's."""

import json
from functools import cache

import numpy as np
import pytest
from browser import Tab
from posed_face import posed_face
from posing_page import page_of

from replicate.inverse.configurations import read_drags, targets_of
from replicate.inverse.control_points import control_points
from replicate.poser.contents import halved
from replicate.poser.face_page import posed_vertices
from replicate.poser.saved_pose import read_pose

FACE = posed_face()
POINTS = control_points(FACE.rig, FACE.influence)
DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"
CLICK = "button[name={}]".format
CHOOSE, STATUS = "input[type=file]", "document.querySelector('.status').textContent"
POSE = "mounted.then(({pose}) => ({%s}))"


@cache
def at_rest():
    """Return where the control points are (c, 3), mm: elsewhere than the rig's, for the face is untrained."""
    return posed_vertices(FACE, FACE.rig.default[None])[0, POINTS.vertices]


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tab")
    (folder / "page.html").write_text(page_of(), encoding="utf-8")
    with Tab(folder) as tab:
        tab.call("Network.emulateNetworkConditions", offline=True, latency=0, downloadThroughput=0, uploadThroughput=0)
        tab.open((folder / "page.html").as_uri(), "window.mounted && mounted.then(Boolean)")
        yield tab


@pytest.fixture
def rest(tab):
    """The page with the face at rest, as it shows after a click on the button for that."""
    reset(tab)
    return tab


def reset(tab):
    """Click on the button for the neutral pose, and wait until dots and sliders are there."""
    tab.click(CLICK("reset"))
    params, targets, _ = state(tab)
    np.testing.assert_array_equal(params, FACE.rig.default)
    np.testing.assert_allclose(targets, at_rest(), atol=0.01)
    tab.wait(DRAWN)


def state(tab):
    """Return (params, targets, vertices) of the page; numbers that are none stay such."""
    parts = ("params", "targets", "vertices")
    lists = tab.evaluate(POSE % ", ".join(f"{part}: Array.from(pose.{part}, String)" for part in parts))
    params, targets, vertices = (np.array(lists[part], np.float32) for part in parts)
    return params, targets.reshape(-1, 3), vertices.reshape(-1, 3)


def dragged(tab, i, away, how=Tab.pull):
    """Drag a control point by so many px and return where it is wanted by then, mm."""
    x, y = tab.place(f".point:nth-of-type({i + 1}) .dot")
    to = tab.evaluate(
        f"mounted.then(({{view, svg}}) => {{ const {{x, y}} = svg.getBoundingClientRect();"
        f" return view.unproject({x + away[0]} - x, {y + away[1]} - y, {at_rest()[i, 2]}); }})"
    )
    how(tab, (x, y), (x + away[0], y + away[1]))
    return np.array([*to, at_rest()[i, 2]], np.float32)


@pytest.mark.parametrize("how", [Tab.pull, Tab.swipe], ids=["mouse", "finger"])
def test_a_drag_poses_the_face_as_python_does(rest, how):
    wanted = at_rest().copy()
    wanted[1] = dragged(rest, 1, (24, -15), how)
    params, targets, vertices = state(rest)
    np.testing.assert_allclose(targets, wanted, atol=0.02)
    assert np.abs(targets - at_rest())[1, :2].min() > 1, "it is dragged across and up"
    said = halved(FACE.ik).solve(np.stack([targets, at_rest()]))
    expected = np.clip(FACE.rig.default + said[0] - said[1], FACE.rig.lower, FACE.rig.upper)
    np.testing.assert_allclose(params, expected, atol=3e-4)
    assert np.abs(expected - FACE.rig.default).max() > 0.02
    np.testing.assert_allclose(vertices, posed_vertices(FACE, params[None])[0], atol=0.01)
    rest.evaluate("document.querySelectorAll('details').forEach((group) => (group.open = true))")
    rest.wait(f"Math.abs(document.querySelector('label input').value - {float(params[0])}) < 0.002")


def test_a_drag_of_the_background_turns_the_head_and_poses_nothing(rest):
    rest.pull((60, 300), (140, 320))
    assert rest.evaluate("mounted.then(({view}) => view.view.yaw)") == pytest.approx(80 * 0.008, abs=0.01)
    np.testing.assert_array_equal(state(rest)[0], FACE.rig.default)
    rest.click(CLICK("front"))
    assert rest.evaluate("mounted.then(({view}) => view.view.yaw)") == 0


def test_a_pose_is_saved_and_loaded_again_and_python_reads_it(rest):
    dragged(rest, 0, (-20, 12))
    params, targets, _ = state(rest)
    rest.click(CLICK("save"))
    file = rest.downloaded("small_pose.json")
    read, wanted = read_pose(file, FACE.rig, POINTS.names)
    np.testing.assert_allclose(read, params, atol=1e-6)
    np.testing.assert_allclose(wanted, targets, atol=1e-4)
    reset(rest)
    rest.choose_file(CHOOSE, file)
    rest.wait(f"{STATUS} === 'small_pose.json is loaded.'")
    np.testing.assert_allclose(state(rest)[0], params, atol=1e-6)
    np.testing.assert_allclose(state(rest)[1], targets, atol=1e-4)


def test_the_pages_address_gives_the_pose_back(rest):
    dragged(rest, 4, (15, 20))
    params, targets, _ = state(rest)
    address = rest.wait("mounted.then(({link}) => location.hash === `#${link()}` && location.href)")
    rest.open("about:blank", "location.href === 'about:blank'")
    rest.open(address, "window.mounted && mounted.then(Boolean)")
    np.testing.assert_allclose(state(rest)[0], params, atol=2e-4)
    np.testing.assert_allclose(state(rest)[1], targets, atol=0.01)


def test_a_bad_file_is_told_in_the_page_and_changes_nothing(rest, tmp_path):
    dragged(rest, 2, (10, 10))
    before = state(rest)
    table = {"format": "facial pose", "version": 1, "character": "small"}
    values = {control.name: 0 for control in FACE.rig.controls}
    bad = {
        "letters": ("no json", "this file is not JSON"),
        "nan": (json.dumps(table | {"controls": values | {"c0": float("nan")}}), "this file is not JSON"),
        "stranger": (json.dumps(table | {"character": "toon", "controls": values}), "of the character toon"),
        "few": (json.dumps(table | {"controls": {"c0": 1}}), 'control "c1": expected a value, got none'),
        "beyond": (
            json.dumps(table | {"controls": values | {"c2": 7}}),
            'control "c2": expected a number from -1 to 2, got 7',
        ),
    }
    for name, (text, part) in bad.items():
        (tmp_path / f"{name}.json").write_text(text)
        rest.choose_file(CHOOSE, tmp_path / f"{name}.json")
        rest.wait(f"{STATUS}.includes({json.dumps(part)})")
        assert rest.evaluate("document.querySelector('.status').classList.contains('wrong')")
        for old, new in zip(before, state(rest), strict=True):
            np.testing.assert_array_equal(old, new)


def test_kept_drags_are_a_file_that_table_4_reads(rest):
    rest.click(CLICK("keep"))
    assert "Every control point is at rest" in rest.evaluate(STATUS)
    first = dragged(rest, 3, (18, 9))
    rest.click(CLICK("keep"))
    reset(rest)
    second = [dragged(rest, 5, (-9, 14)), dragged(rest, 0, (12, -6))]
    rest.click(CLICK("keep"))
    rest.click(CLICK("drags"))
    configurations = read_drags(rest.downloaded("small_drags.csv"), POINTS.names)
    assert [[drag.point for drag in drags] for drags in configurations] == [["point_04"], ["point_01", "point_06"]]
    wanted = np.stack([at_rest(), at_rest()])
    wanted[0, 3], wanted[1, 5], wanted[1, 0] = first, *second
    np.testing.assert_allclose(targets_of(at_rest(), POINTS.names, configurations), wanted, atol=0.03)


def test_the_page_asked_for_nothing_but_itself_and_nothing_went_wrong(tab):
    assert tab.requests and {address.partition(":")[0] for address in tab.requests} <= {"file", "blob", "about"}
    assert {address.partition("#")[0].rpartition("/")[2] for address in tab.requests if address[:4] == "file"} == {
        "page.html"
    }
    assert not tab.errors
