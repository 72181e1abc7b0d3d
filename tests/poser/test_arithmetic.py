"""The page's arithmetic without a browser, in Node.js: its vertices are Python's, for each kind of approximation."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from posed_face import MESH, TOOTH, coarse_model, posed_face, refined_model, regional_model

from replicate.poser.contents import face_contents
from replicate.poser.pack import as_text, packed
from replicate.poser.page import FRONT, joined

PARTS = [FRONT / f"{name}.js" for name in ("packed", "networks", "regional", "maps", "face")]
PROGRAM = """
readPacked(bytesOf({packed})).then((face) => {{
  const pose = faceModel(face), shown = {params}.map((params) => Array.from(pose(Float32Array.from(params))));
  console.log(JSON.stringify(shown));
}});
"""


@pytest.mark.parametrize("model", [regional_model, coarse_model, refined_model])
def test_vertices_are_those_of_python(model, tmp_path):
    node = shutil.which("node") or pytest.skip("needs Node.js")
    face = posed_face(model())
    params = np.random.default_rng(3).uniform(-0.8, 0.8, (5, len(face.rig.default))).astype(np.float32)
    values = {"packed": json.dumps(as_text(packed(*face_contents(face)))), "params": json.dumps(params.tolist())}
    program = tmp_path / "program.js"
    program.write_text(joined(PARTS) + PROGRAM.format(**values), encoding="utf-8")
    given = subprocess.run([node, program], capture_output=True, text=True, timeout=120, check=True).stdout
    vertices, soft = np.reshape(json.loads(given), (len(params), -1, 3)), MESH.segment != TOOTH
    np.testing.assert_allclose(vertices[:, soft], (MESH.neutral + face.model.offsets(params))[:, soft], atol=1e-3)
