"""The examples: the one page that trains a character runs from anywhere, and beats the neutral pose."""

import ast
import importlib.util
import json
import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from small_facekit import write_facekit

from data_recipes.gltf.gltf_face import read_gltf
from data_recipes.ict.facekit_files import read_model
from data_recipes.recipe.reading import load_recipe
from replicate.base.paths import ROOT

TRAIN_ONE, HEADS = (ROOT / "examples" / name for name in ("train_one.py", "heads.py"))
LONGEST = {"heads.py": 215, "blender_face.py": 390}  # lines: one converts formats, one has a runtime and a panel


def run(folder, *words):
    return subprocess.run([sys.executable, TRAIN_ONE, *words], cwd=folder, capture_output=True, text=True)


def test_training_one_character_prints_its_errors_and_draws_them(tmp_path):
    process = run(tmp_path, "tiny", "--steps", "60", "--out", "picture.png")
    assert process.returncode == 0, process.stderr
    names, row = process.stdout.splitlines()
    assert names.split() == ["CNN", "linear", "neutral"] and row.startswith("tiny ")
    cnn, linear, neutral = (tuple(map(float, pair)) for pair in re.findall(r"([\d.]+) mm +([\d.]+)°", row))
    assert 0 < cnn[0] < neutral[0] and 0 < linear[0] < neutral[0]
    assert re.search("training .* for 60 steps", process.stderr)
    with Image.open(tmp_path / "picture.png") as picture:
        assert picture.width > 2 * picture.height
    assert [file.name for file in tmp_path.iterdir()] == ["picture.png"]


@pytest.mark.parametrize(
    ("words", "message"), [(["nobody"], "there is no character"), (["tiny", "--steps", "0"], "steps")]
)
def test_bad_words_end_it_before_anything_is_built(tmp_path, words, message):
    process = run(tmp_path, *words)
    assert process.returncode == 2 and message in process.stderr and "Traceback" not in process.stderr


@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.py")), ids=lambda file: file.name)
def test_an_example_is_one_short_page_that_parses_and_says_how_it_is_run(example):
    text = example.read_text("utf-8")
    assert f"python {example.name}" in ast.get_docstring(ast.parse(text)).replace("examples/", "")
    assert len(text.splitlines()) <= LONGEST.get(example.name, 110)


# Others' heads as GLBs.

BODY = [("v", x, y, 0.1 * abs(x)) for y in (5.0, 6.0, 7.0, 7.5, 8.0) for x in (-1, 0, 1)]
BONES = {"spine": (None, 5.0), "neck01": ("spine", 6.2), "neck02": ("neck01", 6.6), "neck03": ("neck02", 6.7)}
BONES |= {"head": ("neck03", 7.0), "jaw": ("head", 7.2), "lip": ("jaw", 7.2)}
BONES |= {"eye.L": ("head", 7.8), "eye.R": ("head", 7.8)}


def write_small_makehuman(folder):
    """Write what of MakeHuman's repository is read: a strip of 15 vertices, an eye, and a cube that marks a joint."""
    data = folder / "makehuman" / "data"
    quads = [(3 * r + c + 1, 3 * r + c + 2, 3 * r + c + 5, 3 * r + c + 4) for r in range(4) for c in range(2)]
    helpers = [("v", 0.5, 7.8, 0.2), ("v", 0.6, 7.8, 0.2), ("v", 0.5, 7.9, 0.2), ("v", 9.0, 9.0, 9.0)]
    lines = [*BODY, *helpers, *(("vt", 0.2 + 0.1 * x, 0.1 * y) for _, x, y, _ in [*BODY, *helpers])]
    faces = [("g", "body"), *(("f", *(f"{k}/{k}" for k in quad)) for quad in quads), ("g", "helper-l-eye")]
    faces += [("f", "16/16", "17/17", "18/18"), ("g", "joint-head"), ("f", "19/19", "18/18", "17/17")]
    units, macro = data / "targets" / "expression" / "units" / "caucasian", data / "targets" / "macrodetails"
    for place in (data / "3dobjs", data / "rigs", units, macro):
        place.mkdir(parents=True)
    (data / "3dobjs" / "base.obj").write_text("".join(" ".join(map(str, line)) + "\n" for line in [*lines, *faces]))
    (macro / "caucasian-female-young.target").write_text("# nothing\n14 0 0 0.5\n")
    (units / "mouth-open.target").write_text("# moves a corner\n7 0 -.2 .1\n8 0 -.1 0\n")
    (units / "eye-left-closure.target").write_text("12 .1 0 0\n")
    bones = {name: {"head": name, "parent": parent} for name, (parent, _) in BONES.items()}
    nearest = {name: [min(range(15), key=lambda k: abs(BODY[k][2] - y))] for name, (_, y) in BONES.items()}
    (data / "rigs" / "default.mhskel").write_text(json.dumps({"bones": bones, "joints": nearest}))
    weights = {"spine": [[k, 1.0] for k in range(6)], "head": [[k, 1.0] for k in range(9, 19)]}
    weights |= {"lip": [[k, 0.75] for k in range(6, 9)], "neck01": [[k, 0.25] for k in range(6, 9)]}
    (data / "rigs" / "default_weights.mhw").write_text(json.dumps({"weights": weights}))


def write_head(folder, *words):
    return subprocess.run([sys.executable, HEADS, *words], cwd=folder, capture_output=True, text=True)


def test_makehumans_head_is_cut_from_its_body_with_its_shapes_and_its_joints(tmp_path):
    write_small_makehuman(tmp_path)
    process = write_head(tmp_path, "makehuman", ".", "head.glb")
    assert process.returncode == 0, process.stderr
    face = read_gltf(tmp_path / "head.glb")
    assert set(face.nodes) == {"Head", "EyeLeft"} and list(face.targets) == ["eye-left-closure", "mouth-open"]
    assert face.vertices[:, 1].min() == pytest.approx(0.65), "in metres, cut between the neck's two lower joints"
    assert len(face.faces) == 13, "three rows of four triangles and the eye: no marks of joints"
    assert face.vertices[:, 2].max() == pytest.approx(0.06), "the person's target is in the neutral"
    moved = np.abs(face.targets["mouth-open"]).max(axis=1)
    assert sorted(moved[moved > 0]) == pytest.approx([0.01, 0.02])
    assert face.skin.names == ("neck01", "neck02", "neck03", "head", "jaw", "eye.L", "eye.R")
    jaw = face.skin.weights.toarray()[:, 4]
    assert sorted(jaw[jaw > 0]) == pytest.approx([0.75] * 3), "the lip's bone goes with the jaw's"
    place = np.linalg.inv(face.skin.bind)[4, :3, 3]
    assert place == pytest.approx(np.array(BODY[6][1:]) / 10, abs=1e-6)


def test_icts_head_gets_an_avatars_parts_and_arkits_names(tmp_path, monkeypatch):
    recipe = load_recipe(str(write_facekit(tmp_path / "kit")))
    spec = importlib.util.spec_from_file_location("heads_example", HEADS)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setenv("ICT_FACEKIT", "")
    monkeypatch.setattr(module, "load_recipe", lambda name: recipe)
    module.write_ict(tmp_path / "kit", tmp_path / "ict.glb")
    face = read_gltf(tmp_path / "ict.glb")
    assert set(face.nodes) == {"Head", "Teeth", "EyeLeft", "EyeRight"}
    assert {"browInnerUp", "eyeBlinkLeft", "mouthSmileRight", "jawOpen"} <= set(face.targets)
    assert not any("_" in name for name in face.targets)
    model = read_model(recipe.vertices)
    both = (model.offsets["browInnerUp_L"] + model.offsets["browInnerUp_R"]) / 1000
    assert np.abs(face.targets["browInnerUp"]).max() == pytest.approx(np.abs(both).max(), rel=1e-5)


@pytest.mark.parametrize("model", ["makehuman", "ict"])
def test_a_folder_that_is_another_is_refused_in_a_sentence(tmp_path, model):
    process = write_head(tmp_path, model, ".", "head.glb")
    assert process.returncode == 2 and "Traceback" not in process.stderr
    assert {"makehuman": "base.obj", "ict": "generic_neutral_mesh.obj"}[model] in process.stderr
