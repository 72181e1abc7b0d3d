"""The page's arithmetic without a browser, in Node.js: its vertices are Python's, for each kind of approximation."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from posed_face import MESH, TOOTH, coarse_model, posed_face, refined_model, regional_model

from replicate.poser.contents import face_contents
from replicate.poser.face_page import posed_vertices
from replicate.poser.pack import FRONT, as_text, joined, packed

PARTS = [FRONT / f"{name}.js" for name in ("packed", "networks", "regional", "maps", "face")]
PROGRAM = """
readPacked(bytesOf({packed})).then((face) => {{
  const pose = faceModel(face), shown = {params}.map((params) => Array.from(pose(Float32Array.from(params))));
  console.log(JSON.stringify(shown));
}});
"""


MODELS = {
    "regional": regional_model,
    "regional, all shapes in 16 bits": lambda: regional_model((7, 7)),  # as of regions of few shapes
    "regional, a region's shapes in 16 bits": lambda: regional_model((7, 2)),
    "regional, all shapes in 8 bits": lambda: regional_model((0, 0)),
    "coarse": coarse_model,
    "coarse, small maps of 4 channels": lambda: coarse_model(16, 4),
    "refined": refined_model,
}


@pytest.mark.parametrize("name", MODELS)
def test_vertices_are_those_of_python(name, tmp_path):
    node = shutil.which("node") or pytest.skip("needs Node.js")
    face = posed_face(MODELS[name]())
    params = np.random.default_rng(3).uniform(-0.8, 0.8, (5, len(face.rig.default))).astype(np.float32)
    values = {"packed": json.dumps(as_text(packed(*face_contents(face)))), "params": json.dumps(params.tolist())}
    program = tmp_path / "program.js"
    program.write_text(joined(PARTS) + PROGRAM.format(**values), encoding="utf-8")
    given = subprocess.run([node, program], capture_output=True, text=True, timeout=120, check=True).stdout
    vertices, soft = np.reshape(json.loads(given), (len(params), -1, 3)), MESH.segment != TOOTH
    np.testing.assert_allclose(vertices[:, soft], (MESH.neutral + face.model.offsets(params))[:, soft], atol=1e-3)


@pytest.mark.parametrize("channels", [4, 16])
def test_a_single_pose_is_pythons_of_networks_without_a_fast_evaluation_too(channels):
    face = posed_face(coarse_model(channels=channels))
    params = np.random.default_rng(4).uniform(-0.8, 0.8, (2, len(face.rig.default))).astype(np.float32)
    assert (face.evaluate is None) == (channels == 4)
    np.testing.assert_allclose(posed_vertices(face, params[:1]), posed_vertices(face, params)[:1], atol=1e-3)


SUMS = """
const count = {count}, n = {n}, rows = Int8Array.from({rows}), factor = Float32Array.from({factor}, Number);
const both = [addRows, addSmallRows].map((add) => {{
  const sums = new Float32Array(n).fill(1);
  add(sums, rows, 1, count, factor, new Int32Array(count), new Int32Array(n));
  return Array.from(sums, String);
}});
console.log(JSON.stringify(both));
"""


def sums_of(rows, factor, tmp_path):
    """Return the sums of rows times factors, from the second factor on, as `addRows` and `addSmallRows` have them."""
    node, program = shutil.which("node") or pytest.skip("needs Node.js"), tmp_path / "program.js"
    numbers = {"rows": rows.ravel().tolist(), "factor": [str(value) for value in factor]}
    values = {"count": len(rows), "n": rows.shape[1], **{name: json.dumps(each) for name, each in numbers.items()}}
    program.write_text(joined(PARTS) + SUMS.format(**values), encoding="utf-8")
    given = subprocess.run([node, program], capture_output=True, text=True, timeout=120, check=True).stdout
    return np.array(json.loads(given), np.float64)


@pytest.mark.parametrize("count", [1, 4, 7, 512, 513])
def test_small_rows_are_summed_as_whole_numbers_without_overflow(count, tmp_path):
    rows = np.full((count, 5), 127, np.int8)
    rows[:, 1::2] = np.random.default_rng(count).integers(-127, 128, (count, 2))
    factor = np.random.default_rng(1).choice([-0.5, 0.5], count + 1) * np.linspace(0.9, 1.0, count + 1)
    factor[1:] = np.abs(factor[1:])  # the first column is as large as it can be
    plain, small = sums_of(rows, factor, tmp_path)
    np.testing.assert_allclose(plain, 1 + factor[1:] @ rows, rtol=1e-5, atol=1e-4)
    step = np.abs(factor[1:]).max() / 32767
    assert np.abs(small - plain).max() <= 0.51 * step * 127 * count + 1e-3


@pytest.mark.parametrize(("value", "expected"), [("NaN", np.nan), ("Infinity", np.inf), ("0", 1.0)])
def test_factors_that_are_no_numbers_show_in_the_sums(value, expected, tmp_path):
    plain, small = sums_of(np.full((4, 3), 2, np.int8), [9, value, 0, 0, 0], tmp_path)
    np.testing.assert_array_equal(plain, [expected] * 3)
    np.testing.assert_array_equal(small, plain)
