"""The posing widget of notebooks: from Python without a browser, and its front end in a real one."""

import base64
import json

import numpy as np
import pytest
from browser import Tab
from posed_face import posed_face

from replicate.base.exceptions import InputError
from replicate.poser.face_page import posed_vertices
from replicate.poser.notebook import Poser
from replicate.poser.rig_errors import DISTANCE, SCALES, at_vertices, rig_errors

FACE = posed_face()
SOME = np.linspace(-0.5, 0.5, len(FACE.rig.controls)).astype(np.float32)
PAGE = """<!doctype html><meta charset="utf-8"><style>{css}</style><div id="cell"></div><script type="module">
const bytes = (text) => new DataView(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const state = {state}, heard = {{}};
state.packed = bytes(state.packed);
state.errors.colours = bytes(state.errors.colours);
window.sent = [];
window.model = {{
  get: (name) => state[name],
  set: (name, value) => {{ state[name] = value; }},
  save_changes: () => {{
    const {{ params, targets, asked, kind }} = state;
    window.sent.push(structuredClone({{ params, targets, asked, kind }}));
  }},
  on: (names, call) => names.split(" ").forEach((name) => {{ (heard[name] ??= []).push(call); }}),
  off: () => {{}},
  tell: (name, value) => {{ state[name] = value; (heard[`change:${{name}}`] ?? []).forEach((call) => call()); }},
}};
const source = new Blob([atob("{script}")], {{ type: "text/javascript" }});
const widget = await import(URL.createObjectURL(source));
widget.default.render({{ model: window.model, el: document.getElementById("cell") }});
window.ready = true;
</script>"""


@pytest.fixture
def poser():
    return Poser(FACE)


def test_the_face_is_at_rest_and_is_compared_with_the_rig_at_once(poser):
    np.testing.assert_array_equal(poser.params, FACE.rig.default)
    errors = rig_errors(FACE, FACE.rig.default)
    np.testing.assert_allclose(poser.judged.distance, errors.distance)
    assert poser.errors["words"] == errors.in_words() and len(poser.errors["colours"]) == 3 * len(errors.distance)


def test_a_drag_moves_the_point_and_the_parameters_and_is_compared_again(poser):
    before, name = poser.targets.copy(), poser.points[1]
    poser.drag(**{name: (4.0, -2.0)})
    np.testing.assert_allclose(poser.targets - before, np.eye(len(before))[1][:, None] * [4, -2, 0], atol=1e-5)
    assert np.abs(poser.params - FACE.rig.default).max() > 1e-3
    predicted = posed_vertices(FACE, poser.params[None])[0]
    truth = FACE.rig(poser.params[None])[0]
    np.testing.assert_allclose(poser.judged.distance, np.linalg.norm(predicted - truth, axis=1), atol=1e-4)
    poser.reset()
    np.testing.assert_array_equal(poser.params, FACE.rig.default)
    np.testing.assert_allclose(poser.targets, before, atol=1e-5)


def test_the_colours_are_those_of_the_chosen_error(poser):
    poser.params = SOME
    normals = poser.errors["colours"]
    poser.kind = DISTANCE
    assert poser.errors["colours"] == SCALES[DISTANCE].colours(poser.judged.distance).tobytes() != normals
    assert "mm" in poser.errors["title"]


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.zeros(2), "shape"),
        (np.full(len(SOME), np.nan), "NaN"),
        (np.full(len(SOME), 9.0), "control 'c0': expected a number from -1 to 2, got 9"),
        ("all", "expected finite numbers"),
    ],
)
def test_bad_parameters_are_refused_and_change_nothing(poser, value, words):
    poser.params = SOME
    with pytest.raises(InputError, match=words):
        poser.params = value
    np.testing.assert_array_equal(poser.params, SOME)


def test_a_bad_drag_is_refused(poser):
    with pytest.raises(InputError, match="elbow"):
        poser.drag(elbow=(1, 1))
    np.testing.assert_array_equal(poser.params, FACE.rig.default)


def test_a_pose_comes_back_from_a_file(poser, tmp_path):
    poser.drag(**{poser.points[0]: (3.0, 1.0)})
    params, targets = poser.params.copy(), poser.targets.copy()
    poser.save(tmp_path / "mine.json")
    poser.reset()
    poser.load(tmp_path / "mine.json")
    np.testing.assert_allclose(poser.params, params, atol=1e-6)
    np.testing.assert_allclose(poser.targets, targets, atol=1e-4)


def test_what_the_browser_sends_is_taken_and_answered(poser):
    poser.set_state({"params": SOME.tolist(), "targets": (poser.targets + 1).tolist(), "asked": 7})
    np.testing.assert_allclose(poser.params, SOME)
    assert poser.errors["asked"] == 7 and poser.errors["words"] == rig_errors(FACE, SOME).in_words()


def test_a_vertex_has_the_mean_of_its_faces_and_none_without():
    values, faces = np.array([1.0, 3.0, np.nan]), np.array([[0, 1, 2], [1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(at_vertices(values, faces, 6), [1, 2, 2, 3, np.nan, np.nan])


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    folder, own = tmp_path_factory.mktemp("widget"), Poser(FACE)
    encoded = lambda data: base64.b64encode(data).decode()  # noqa: E731
    errors = own.errors | {"colours": encoded(own.errors["colours"])}
    state = {"packed": encoded(own.packed), "errors": errors, "kind": own.kind, "asked": 0}
    state |= {"params": own.params.tolist(), "targets": own.targets.tolist()}
    script = encoded(own._esm.encode("ascii", "xmlcharrefreplace"))
    page = PAGE.format(css=own._css, state=json.dumps(state), script=script)
    (folder / "widget.html").write_text(page, encoding="utf-8")
    with Tab(folder) as tab:
        tab.open(
            (folder / "widget.html").as_uri(), "window.ready && document.querySelectorAll('.point .dot').length > 0"
        )
        yield tab


def test_the_front_end_sends_a_drag_and_shows_the_kernels_answer(tab):
    assert len(tab.evaluate("Array.from(document.querySelectorAll('.point .dot'), () => 1)")) == 6
    x, y = tab.place(".point:nth-of-type(2) .dot")
    tab.pull((x, y), (x + 24, y - 15))
    last = tab.wait("window.sent.at(-1)")
    params = np.float32(last["params"])
    own = Poser(FACE)
    own.set_state(last)
    assert last["asked"] >= 1 and np.abs(params - FACE.rig.default).max() > 1e-3
    moved = np.abs(
        np.float32(last["targets"]) - posed_vertices(FACE, FACE.rig.default[None])[0, FACE.rig.control_points]
    )
    assert moved[1].max() > 0.3 and np.delete(moved, 1, axis=0).max() < 0.1
    tab.wait("document.querySelector('.errors.waiting') !== null")
    words = own.errors["words"]
    colours = base64.b64encode(own.errors["colours"]).decode()
    answer = json.dumps({**own.errors, "colours": None, "asked": 0})
    tab.evaluate(
        f"(() => {{ const answer = {answer}; answer.asked = model.get('asked');"
        f" answer.colours = new DataView(Uint8Array.from(atob('{colours}'), (c) => c.charCodeAt(0)).buffer);"
        " model.tell('errors', answer); return true; })()"
    )
    assert tab.wait(f"document.querySelector('.errors .words').textContent.includes({json.dumps(words[:18])})")


def test_the_face_follows_the_kernel(tab):
    wanted = json.dumps(np.round(SOME, 4).tolist())
    tab.evaluate("document.querySelectorAll('details').forEach((group) => (group.open = true))")
    told = f"model.set('params', {wanted}), model.tell('targets', model.get('targets'))"  # heard when no answer is due
    tab.wait(f"({told}, Math.abs(document.querySelector('label input').value - {float(SOME[0])}) < 0.01)")


def test_a_single_pose_is_the_models_own():
    params = np.clip(FACE.rig.default + 0.2, FACE.rig.lower, FACE.rig.upper)[None].astype(np.float32)
    both = posed_vertices(FACE, np.concatenate([params, params]))
    np.testing.assert_allclose(posed_vertices(FACE, params)[0], both[1], atol=1e-3)
    assert np.abs(both[0] - FACE.rig.mesh.neutral).max() > 0.01
