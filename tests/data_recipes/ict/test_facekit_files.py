"""The reader of ICT-FaceKit's files takes what OBJ allows, and names what it can't take."""

import json
import shutil

import numpy as np
import pytest

from data_recipes.catalogue import build_rig
from data_recipes.ict import facekit_files, facekit_segments
from replicate.__main__ import main
from replicate.base.exceptions import InputError


def test_an_obj_keeps_its_vertices_and_cuts_many_corners_into_fans(tmp_path):
    file = tmp_path / "a.obj"
    file.write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv -1 .5 0\n"
        "vt 0 0 0\nvt 1 0 0\nvt 1 1 0\nf 1/1/1 2/2/1 3/3/1 4/1/1\nf 1/2 3/3 -1/-1\nf 1/1 2/1 3/1 4/1 5/1\n"
    )
    vertices, uv, polygons, uv_polygons = facekit_files.read_obj(file)
    assert vertices.shape == (5, 3) and uv.shape == (3, 2)
    assert polygons.tolist() == [[0, 1, 2, 3], [0, 2, 4, -1], [0, 1, 2, -1], [0, 2, 3, -1], [0, 3, 4, -1]]
    assert uv_polygons[:2].tolist() == [[0, 1, 2, 0], [1, 2, 2, -1]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nvt 0 0\nf 1/1 1/1 2/1\n", "line 3: expected a face of 3 to 64 different corners v/vt within 1 "),
        ("v 0 0 0\nvt 0 0\nf 1/1 1/1 2/1\n", "got 'f 1/1 1/1 2/1'"),
        ("v 0 0 0\nvt 0 0\nf 1 1 1\n", "got 'f 1 1 1'"),
        ("v 0 0 0\nvt 0 0\n", "expected faces, got none"),
        ("v 0 0\nvt 0 0\nf 1/1 1/1 1/1\n", "expected lines 'v' with 3 numbers each, got others or none"),
        ("v 0 0 nan\nvt 0 0\nf 1/1 1/1 1/1\n", "expected lines 'v' with finite numbers, got 1 lines"),
        ("", "expected lines 'v' with 3 numbers each, got others or none"),
        ("v 0 0 0\nvt 0 0\nf 1/1 1/1 " + "9" * 30 + "/1\n", "got 'f 1/1 1/1 9"),
        ("v 0 0 0\nvt 0 0\nf 1/1 1/1 " + "9" * 5_000 + "/1\n", "got 'f 1/1 1/1 9"),
        ("v 0 0 0\nvt 0 0\nf" + " 1/1" * 200_000 + "\n", "line 3: expected a face of 3 to 64 different corners"),
    ],
)
def test_a_broken_obj_is_named_with_what_was_found(tmp_path, text, message):
    file = tmp_path / "a.obj"
    file.write_text(text)
    with pytest.raises(InputError, match=r"a\.obj") as error:
        facekit_files.read_obj(file)
    assert message in str(error.value)


def test_quads_are_cut_along_the_shorter_diagonal_or_through_a_corner():
    x = np.array([[0.0, 0, 0], [2, 0, 0], [2.5, 1, 0], [0.5, 1, 0]])
    quad = np.array([[0, 1, 2, 3], [0, 1, 2, -1]])
    assert facekit_segments.triangles(quad, x).tolist() == [[0, 1, 3], [1, 2, 3], [0, 1, 2]]
    through = np.array([True, False, False, False])
    assert facekit_segments.triangles(quad, x, through).tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]


def _break(name):
    def edit(data):
        if name == "missing":
            (data / "eyeBlink_L.obj").unlink()
        elif name == "version":
            lines = (data / "generic_neutral_mesh.obj").read_text().splitlines(keepends=True)
            (data / "generic_neutral_mesh.obj").write_text("v 0 0 0\n" + "".join(lines))
        elif name == "short":
            lines = (data / "jawLeft.obj").read_text().splitlines(keepends=True)
            (data / "jawLeft.obj").write_text("".join(lines[:100]))
        elif name == "json":
            (data / "vertex_indices.json").write_text("{")
        elif name == "marks":
            table = json.loads((data / "vertex_indices.json").read_text())
            table["idx_to_landmark_verts"].pop()
            (data / "vertex_indices.json").write_text(json.dumps(table))
        elif name == "unit":
            file = data / "generic_neutral_mesh.obj"
            rows = [line.split() for line in file.read_text().splitlines()]
            rows = [[row[0], *(str(100 * float(c)) for c in row[1:])] if row[0] == "v" else row for row in rows]
            file.write_text("\n".join(map(" ".join, rows)))
        elif name == "deep":
            (data / "vertex_indices.json").write_text("[" * 100_000)
        elif name == "huge":
            table = json.loads((data / "vertex_indices.json").read_text())
            table["idx_to_landmark_verts"][3] = 10**30
            (data / "vertex_indices.json").write_text(json.dumps(table))
        elif name == "loop":
            (data / "eyeBlink_L.obj").unlink()
            (data / "eyeBlink_L.obj").symlink_to("eyeBlink_L.obj")
        elif name in ("jawOpen", "jawForward"):
            table = json.loads((data / "vertex_indices.json").read_text())
            table["expressions"].remove(name)
            (data / "vertex_indices.json").write_text(json.dumps(table))

    return edit


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("missing", ("eyeBlink_L.obj: there is no such file", "vertex_indices.json lists it")),
        ("version", ("generic_neutral_mesh.obj: expected the 1597 vertices of ICT-FaceKit", "got 1598")),
        ("short", ("jawLeft.obj: expected the 1597 vertices", "got 99")),
        ("json", ("vertex_indices.json: not a readable table",)),
        ("marks", ("'idx_to_landmark_verts': expected 68 landmarks", "got 67 landmarks")),
        ("unit", ("got 15000 mm", "unit is taken to be the centimetre")),
        ("deep", ("vertex_indices.json: not a readable table",)),
        ("huge", ("'idx_to_landmark_verts': expected 68", "got vertex 1000000000000000000000000000000")),
        ("loop", ("eyeBlink_L.obj: there is no such file",)),
        (
            "jawOpen",
            ("vertex_indices.json: expressions: 'jawOpen' is missing; the jaw is fitted to jawOpen, jawForward",),
        ),
        ("jawForward", ("vertex_indices.json: expressions: 'jawForward' is missing; the jaw is fitted to jawOpen",)),
    ],
)
def test_a_folder_that_is_no_such_model_gets_one_sentence(kit, folder, tmp_path, monkeypatch, fault, words):
    shutil.copytree(folder, tmp_path / "kit")
    _break(fault)(tmp_path / "kit" / "FaceXModel")
    monkeypatch.setenv("ICT_FACEKIT", str(tmp_path / "kit"))
    with pytest.raises(InputError) as error:
        build_rig(kit)
    assert all(word in str(error.value) for word in words), str(error.value)


@pytest.mark.parametrize("location", ["", "/nonexistent"])
def test_without_the_folder_the_command_ends_with_2_and_says_where_to_get_it(location, monkeypatch, capsys, cache):
    monkeypatch.setenv("ICT_FACEKIT", location)
    assert main(["table2", "--profile", "quick", "--characters", "ict"]) == 2
    errors = capsys.readouterr().err
    assert "ICT-FaceKit by USC ICT on GitHub" in errors and "ICT_FACEKIT=" in errors and errors.count("\n") == 1
    assert not cache.exists() or not list(cache.iterdir())


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("rows = 5", "rows = 1", "folds.rows: expected a whole number from 2 to 12, got 1"),
        ("rows = 5", "rose = 5", "unknown key folds.rose: expected forehead"),
        ("[parts]", "[bits]", "unknown key bits: expected name, vertices, parts"),
        ("mouth = [", "muth = [", "unknown key parts.muth: expected face"),
        (
            "vertices = 1597",
            "vertices = 900",
            "parts.face: expected two of the model's vertices, 0 to 899, got [0, 1146]",
        ),
    ],
)
def test_a_bad_recipe_gets_one_sentence(kit, tmp_path, old, new, sentence):
    text = kit.read_text()
    assert old in text
    (tmp_path / "mask.toml").write_text(text.replace(old, new))
    with pytest.raises(InputError) as error:
        build_rig(tmp_path / "mask.toml")
    assert "mask.toml: " in str(error.value) and sentence in str(error.value)
