"""Saved poses: they come back, and a bad one is refused in a sentence that names the file and the control."""

import json

import numpy as np
import pytest
from posed_face import PosedRig
from refusal import refusal

from replicate import __main__ as cli
from replicate.base.exceptions import InputError
from replicate.poser.saved_pose import read_pose, write_pose

RIG, NAMES = PosedRig(), ("chin", "nose")
PARAMS = np.linspace(-1, 2, len(RIG.controls)).astype(np.float32)
TARGETS = np.float32([[1.5, -2.25, 30], [0, 0.0001, -7]])


@pytest.fixture
def saved(tmp_path):
    write_pose(tmp_path / "own.json", RIG, PARAMS, NAMES, TARGETS)
    return tmp_path / "own.json"


def test_a_pose_comes_back(saved):
    params, targets = read_pose(saved, RIG, NAMES)
    np.testing.assert_allclose(params, PARAMS, atol=1e-6)
    np.testing.assert_allclose(targets, TARGETS, atol=1e-4)
    assert read_pose(saved, RIG)[1].shape == (0, 3)


def test_a_pose_may_have_no_control_points(saved):
    table = json.loads(saved.read_text())
    del table["points"]
    saved.write_text(json.dumps(table))
    assert read_pose(saved, RIG, NAMES)[1] is None


def changed(**keys):
    """Return what changes a saved pose's table: its own keys, or with c0=… one of its controls."""
    return lambda table: (
        table
        | {k: v for k, v in keys.items() if k != "c0"}
        | ({"controls": table["controls"] | {"c0": keys["c0"]}} if "c0" in keys else {})
    )


def without_a_control(table):
    return table | {"controls": {name: value for name, value in table["controls"].items() if name != "c3"}}


@pytest.mark.parametrize(
    ("damage", "part"),
    [
        (changed(character="nobody"), "is of the character 'nobody', not of small"),
        (changed(format="a clip"), "is not a saved pose"),
        (changed(version=2), "expected a pose of version 1, got 2"),
        (changed(controls={"nose_length": 1}), "small has no control 'nose_length'"),
        (without_a_control, "control 'c3': expected a value, got none"),
        (changed(c0=2.5), "control 'c0': expected a number from -1 to 2, got 2.5"),
        (changed(c0=float("nan")), "control 'c0': expected a number .*, got nan"),
        (changed(c0="1"), "control 'c0': expected a number .*, got '1'"),
        (changed(c0=True), "control 'c0': expected a number .*, got True"),
        (changed(points={"chin": [0, 0, 0]}), "control point 'nose': expected three lengths .*, got None"),
        (changed(points={"chin": [0, 0, 0], "nose": [0, 1e999, 0]}), r"control point 'nose': .*, got \[0, inf, 0\]"),
        (changed(points={"chin": [0, 0, 0], "nose": [0, 1e39, 0]}), r"'nose': expected three .*, got \[0, 1e\+39, 0\]"),
        (changed(points={"chin": [0, 10**400, 0], "nose": [0, 0, 0]}), "'chin': .* from -10000 to 10000 mm, got"),
        (changed(c0=10**400), "control 'c0': expected a number from -1 to 2, got 10+…"),
        (lambda table: [table], "is not a saved pose"),
    ],
)
def test_a_bad_pose_is_refused(saved, damage, part):
    saved.write_text(json.dumps(damage(json.loads(saved.read_text()))))
    with pytest.raises(InputError, match=part) as error:
        read_pose(saved, RIG, NAMES)
    assert "own.json" in str(error.value)


@pytest.mark.parametrize("text", ["", "no json", "[" * 100_000, '{"format": '])
def test_what_is_no_json_is_refused(saved, text):
    saved.write_text(text)
    with pytest.raises(InputError, match=r"own\.json: this file is not JSON"):
        read_pose(saved, RIG, NAMES)


def test_what_is_no_text_or_no_file_gets_the_sentence_of_that(tmp_path):
    (tmp_path / "picture.json").write_bytes(b"\x89PNG\r\n\xff\xfe")
    for name, part in (
        ("picture.json", "no UTF-8"),
        ("none.json", "there is no such file"),
        (".", "expected a regular file, got a folder"),
    ):
        with pytest.raises(InputError, match=part) as error:
            read_pose(tmp_path / name, RIG, NAMES)
        assert "JSON" not in str(error.value)


def test_export_reads_a_saved_pose_and_answers_a_bad_one_with_exit_code_2(saved, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(PosedRig, "pose_props", lambda self, params: [])
    monkeypatch.setattr("replicate.methods.artefacts.rig_of", lambda character: RIG)
    out = tmp_path / "own.glb"
    arguments = ("export", "--characters", "tiny", "--params", str(saved), "--to", str(out))
    assert cli.main(list(arguments)) == 0 and out.is_file()
    assert "own.glb" in capsys.readouterr().out
    out.unlink()
    saved.write_text(json.dumps(without_a_control(json.loads(saved.read_text()))))
    assert "control 'c3': expected a value, got none" in refusal(capsys, *arguments)
    assert not out.exists()
