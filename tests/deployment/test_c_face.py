"""Our method in C99: it compiles without a warning, gives Python's vertices, and says which controls there are."""

import dataclasses
import json
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
import torch
from c_compiler import compiled, library, posed_by
from posed_face import posed_face, regional_model
from rigs import rig
from small_face import M

from data_recipes.controls import Control
from replicate.approximation.rigid import Attachments, attach
from replicate.base.paths import ROOT
from replicate.deployment.c_face import CFace, _enumerators, c_files, identifier
from replicate.regional.model import RegionalModel, halve
from replicate.regional.networks import fresh_networks

EXAMPLES = ROOT / "examples"
FACE = posed_face()
MESH = FACE.rig.mesh
POSES = np.random.default_rng(0).uniform(-3, 3, (100, M)).astype(np.float32)  # the limits are −1 and 2
POSES[:2] = 0


def c_face(**changes):
    words = ("small.glb", "A face.", "For research /* and teaching */ alone.")
    return dataclasses.replace(CFace("small", FACE.rig.controls, MESH, FACE.attachments, FACE.model, *words), **changes)


def write(face, folder):
    for name, text in c_files(face, "my_face").items():
        (folder / name).write_text(text, encoding="ascii")
    return folder / "my_face.c"


def furthest_from_python(face, folder):
    found = posed_by(library(write(face, folder), folder).small_pose, POSES, len(MESH.neutral))
    wanted = attach(MESH, face.attachments, MESH.neutral + face.model.offsets(POSES))
    assert np.abs(wanted - MESH.neutral).max() > 1, "nothing moves, and the test says nothing"
    return float(np.linalg.norm(found - wanted, axis=-1).max())


APART = (np.arange(M - 1), np.arange(1, M))  # what each network sees


def drawn_networks(seen, hidden, outputs, gated=True, line=True):
    """Return networks with weights that are drawn at random."""
    networks, rng = fresh_networks(seen, hidden, outputs, gated, line), np.random.default_rng(2)
    for part in networks.networks:
        inputs, width = part.layers[0].in_features, part.output.out_features
        part.start(rng.normal(size=(inputs + 1, width)), torch.Generator().manual_seed(1))
        part.limit(rng.uniform(-0.3, 0.3, (9, inputs)))
    halve(networks)
    return networks


def other_model(seen=APART, **fields):
    """Return the face's model with networks of another kind."""
    network = drawn_networks(seen, (8, 16), [len(basis.steps) for basis in FACE.model.bases], **fields)
    return RegionalModel(network, FACE.model.bases, FACE.model.scale.numpy(), 3.0, len(MESH.neutral))


def without_small_shapes():
    """Return the model of a single region without shapes of 8 bits, so that the other region's vertices stay."""
    basis = FACE.model.bases[0]
    steps = basis.steps[: len(basis.fine)]
    twin = type(basis)(basis.vertices, basis.weights, basis.mean, basis.fine, basis.rough[:0], steps)
    network = drawn_networks([np.arange(M)], (8,), [len(twin.steps)])
    return RegionalModel(network, [twin], np.ones(M), 5.0, len(MESH.neutral))


def attached(segments, carriers):
    """Return attachments of some segments to rows of carriers."""
    zeros = np.zeros(carriers.shape)
    return Attachments(np.array(segments, int), carriers, zeros, zeros[:, 0], zeros[:, :3])


ON_A_LINE = attached([2], np.flatnonzero(MESH.segment == 0)[None, 16:26])  # but for a bend, and as they are posed
NONE = attached([], np.zeros((0, 10), int))


WASM_DRIVER = """
const [file, poses, count] = process.argv.slice(2), rows = JSON.parse(poses);
const pose = await faceOf(await readFile(file), rows[0].length, Number(count));
for (const row of rows) process.stdout.write(new Uint8Array(Float32Array.from(pose(row)).buffer));
"""

CHANGES = {
    "ours": {},
    "leaky ReLUs": {"model": other_model(gated=False)},
    "no line": {"model": other_model(line=False)},
    "one network": {"model": other_model(seen=[np.arange(M)])},
    "one region, 16 bits": {"model": without_small_shapes()},
    "a region in 16 bits": {"model": regional_model((7, 2))},
    "8 bits": {"model": regional_model((0, 0))},
    "carriers on a line": {"attachments": ON_A_LINE},
    "nothing rigid": {"attachments": NONE},
}


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_c_gives_pythons_vertices_beyond_the_limits_too(changes, tmp_path):
    assert furthest_from_python(c_face(**changes), tmp_path) < 1e-3


@pytest.mark.parametrize("program", ["c++", "rustc"])
def test_callers_in_other_languages_pose_the_face(program, tmp_path):
    if shutil.which(program) is None:
        pytest.skip(f"needs {program}")
    for name, text in c_files(c_face(name="teen"), "deploy_teen").items():
        (tmp_path / name).write_text(text, encoding="ascii")
    compiled(tmp_path / "deploy_teen.c", tmp_path / "deploy_teen.o", "-c")
    if program == "c++":
        words = ["-Wall", "-Wextra", "-Werror", "-I", tmp_path, EXAMPLES / "pose_face.cpp", tmp_path / "deploy_teen.o"]
    else:
        source, counts = (EXAMPLES / "pose_face.rs").read_text(), (M, len(MESH.neutral))
        for name, count in zip(("CONTROLS", "VERTICES"), counts, strict=True):
            source = re.sub(rf"const {name}: usize = \d+", f"const {name}: usize = {count}", source)
        (tmp_path / "pose_face.rs").write_text(source)
        links = ("-C", f"link-arg={tmp_path / 'deploy_teen.o'}", "-C", "link-arg=-lm")
        words = ["-D", "warnings", tmp_path / "pose_face.rs", *links]
    subprocess.run([program, *words, "-o", tmp_path / "pose_face"], check=True)
    done = subprocess.run([tmp_path / "pose_face", "c0", "1.5"], capture_output=True, text=True, check=True)
    params = np.eye(1, M, dtype=np.float32) * np.float32(1.5)
    wanted = attach(MESH, FACE.attachments, MESH.neutral + FACE.model.offsets(params))[0]
    np.testing.assert_allclose(np.loadtxt(done.stdout.splitlines()), wanted, atol=1e-3)


def test_webassembly_gives_pythons_vertices(tmp_path):
    node = shutil.which("node") or pytest.skip("needs Node.js")
    if find_spec("ziglang") is None:
        pytest.skip("needs a compiler for WebAssembly: pip install ziglang")
    (words,) = re.findall(r"^python -m ziglang (cc .*) -o teen\.wasm", (ROOT / "ENGINES.md").read_text("utf-8"), re.M)
    source, wasm = write(c_face(), tmp_path), tmp_path / "small.wasm"
    words = [str(source) if word.endswith(".c") else word.replace("teen", "small") for word in words.split()]
    subprocess.run([sys.executable, "-m", "ziglang", *words, "-o", wasm], check=True, capture_output=True, timeout=600)
    program = tmp_path / "posed.mjs"
    program.write_text((EXAMPLES / "pose_wasm.mjs").read_text("utf-8").partition("\nfunction refuse")[0] + WASM_DRIVER)
    done = subprocess.run(
        [node, program, wasm, json.dumps(POSES.tolist()), str(len(MESH.neutral))], capture_output=True
    )
    found = np.frombuffer(done.stdout, np.float32).reshape(len(POSES), -1, 3)
    wanted = attach(MESH, FACE.attachments, MESH.neutral + FACE.model.offsets(POSES))
    assert np.linalg.norm(found - wanted, axis=-1).max() < 1e-3


def test_the_example_in_rust_counts_what_the_teen_has():
    head = rig("teen")
    counts = dict(re.findall(r"const (\w+): usize = (\d+)", (EXAMPLES / "pose_face.rs").read_text()))
    assert counts == {"CONTROLS": str(len(head.controls)), "VERTICES": str(len(head.mesh.neutral))}


def test_the_demo_takes_controls_by_name_and_refuses_others_in_a_sentence(tmp_path):
    demo = compiled(write(c_face(), tmp_path), tmp_path / "demo", "-DSMALL_DEMO")
    done = subprocess.run([demo, "c0=1.5", "c11=-1"], capture_output=True, text=True)
    params = np.zeros((1, M), np.float32)
    params[0, [0, 11]] = 1.5, -1
    wanted = attach(MESH, FACE.attachments, MESH.neutral + FACE.model.offsets(params))[0]
    np.testing.assert_allclose(np.loadtxt(done.stdout.splitlines()), wanted, atol=1e-3)
    refused = subprocess.run([demo, "c1"], capture_output=True, text=True)
    assert refused.returncode == 2 and refused.stderr.startswith("c1: expected control=value")
    for word in ("c1=abc", "c1=", "c1=0.5mm", "c1=nan", "c1=1e39"):
        refused = subprocess.run([demo, word], capture_output=True, text=True)
        assert refused.returncode == 2 and refused.stderr.startswith(
            f"{word}: expected control=value with a finite number"
        )
        assert refused.stderr.count("\n") == 1 and not refused.stdout


def test_the_header_says_counts_units_limits_and_a_name_for_every_control(tmp_path):
    text = c_files(c_face(), "my_face")["my_face.h"]
    for words in (
        "#define SMALL_CONTROLS 12",
        "#define SMALL_VERTICES 341",
        "in millimetres",
        "not clamped",
        "MY_FACE_H",
    ):
        assert words in text
    assert "    SMALL_C0,\n    SMALL_C1,\n" in text and text.count("*/") == text.count("/*")
    assert '{"c0", "mouth", -1.0f, 0.0f, 2.0f}' in c_files(c_face(), "my_face")["my_face.c"]


def test_names_that_c_can_not_tell_apart_or_say_get_numbers(tmp_path):
    names = ["lip up", "lip-up", 'say "a??/"', "controls", *map(str, range(M - 4))]
    controls = tuple(Control(name, -1.0, 0.0, 2.0, "mouth") for name in names)
    face = c_face(controls=controls, name="3rd face")
    text = c_files(face, "my_face")["my_face.h"]
    for name in ("LIP_UP_0", "LIP_UP_1", "SAY__A____", "CONTROLS_3", "_0"):
        assert f"    _3RD_FACE_{name}," in text
    compiled(write(face, tmp_path), tmp_path / "face.o", "-c")
    assert identifier("2x-y") == "_2x_y"


def test_names_that_the_source_uses_itself_get_numbers(tmp_path):
    names = ["once", "demo", *map(str, range(2, M))]
    controls = tuple(Control(name, -1.0, 0.0, 2.0, "mouth") for name in names)
    face = c_face(controls=controls, name="at")  # AT_ONCE is the source's own
    assert "    AT_ONCE_0,\n    AT_DEMO_1,\n" in c_files(face, "my_face")["my_face.h"]
    compiled(write(face, tmp_path), tmp_path / "face.o", "-c")


def test_names_are_different_however_alike_controls_are_called():
    rng = np.random.default_rng(0)
    for _ in range(200):
        names = ["".join(rng.choice([*"aA_ -01"], rng.integers(1, 5))) for _ in range(30)]
        controls = [Control(name, -1.0, 0.0, 2.0, "mouth") for name in names]
        found = _enumerators("A", controls, "A_A_H")
        assert len(set(found)) == len(controls) and all(re.fullmatch(r"A_\w+", name) for name in found)
        assert not set(found) & {"A_CONTROLS", "A_VERTICES", "A_SEGMENTS", "A_DEMO", "A_A_H"}


def test_a_name_with_its_number_is_not_another_controls_name(tmp_path):
    names = ["a b", "a_b_10", "face h", *map(str, range(3, M - 2)), "a_b", "a_b_10_10"]
    controls = tuple(Control(name, -1.0, 0.0, 2.0, "mouth") for name in names)
    face = c_face(controls=controls, name="my")  # its header is guarded by MY_FACE_H
    compiled(write(face, tmp_path), tmp_path / "face.o", "-c")
    lines = c_files(face, "my_face")["my_face.h"].splitlines()
    first, *_, last_but_one, last = (line.strip(" ,") for line in lines[lines.index("enum {") + 1 :][:M])
    assert (first, last_but_one, last) == ("MY_A_B_0", "MY_A_B_10_10_10", "MY_A_B_10_10")
