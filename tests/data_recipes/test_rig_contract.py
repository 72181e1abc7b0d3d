"""The contract that rigs keep is one that the type checker agrees on, and that rigs keep when they run as well."""

import importlib.util
import inspect
import json
import subprocess
import sys

import numpy as np
import pytest
from box import CONTROLS, MESH, foreign

from data_recipes.rig import AlteredRig, Rig, create
from data_recipes.sampled.sampled_rig import SampledRig
from replicate.base.paths import ROOT

RIGS = """
import numpy as np

from data_recipes.controls import Control
from data_recipes.function_rig import ControlledRig
from data_recipes.rig import Clip, Rig
from replicate.geometry.mesh import Mesh


class Clipless(ControlledRig):
    name: str
    mesh: Mesh
    controls: tuple[Control, ...]
    landmarks: np.ndarray
    landmark_names: tuple[str, ...]
    control_points: np.ndarray
    control_point_regions: tuple[str, ...]
    control_point_names: tuple[str, ...]
    face_marks: np.ndarray
    face_mark_regions: tuple[str, ...]

    def __call__(self, params: np.ndarray) -> np.ndarray:
        return params


class Whole(Clipless):
    clips: tuple[Clip, ...] | None


class Timed(Whole):
    def __call__(self, params: np.ndarray, seconds: float) -> np.ndarray:
        return params


class Worded(Whole):
    landmarks: list[str]


whole: Rig = Whole()
clipless: Rig = Clipless()
timed: Rig = Timed()
worded: Rig = Worded()
"""


@pytest.mark.skipif(importlib.util.find_spec("basedpyright") is None, reason="needs basedpyright")
def test_the_checker_refuses_a_rig_that_lacks_a_member_or_has_one_of_another_type(tmp_path):
    (tmp_path / "rigs.py").write_text(RIGS)
    settings = {"include": ["."], "extraPaths": [str(ROOT)], "typeCheckingMode": "basic"}
    settings |= {"reportUndefinedVariable": False, "useLibraryCodeForTypes": False}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    command = [
        sys.executable,
        "-m",
        "basedpyright",
        "--pythonpath",
        sys.executable,
        "--outputjson",
        "-p",
        str(tmp_path),
    ]
    process = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert process.stdout, process.stderr
    found = [one for one in json.loads(process.stdout)["generalDiagnostics"] if one["severity"] == "error"]
    lines = RIGS.splitlines()
    refused = {lines[one["range"]["start"]["line"]].partition(":")[0]: one["message"] for one in found}
    assert set(refused) == {"clipless", "timed", "worded"}, process.stdout
    assert '"clips" is not present' in refused["clipless"]
    assert "seconds" in refused["timed"] and "landmarks" in refused["worded"]


@pytest.fixture
def sampled(tmp_path):
    known = create(tmp_path, 2, 0, len(MESH.neutral), len(CONTROLS))
    known.frame_params[1], known.frame_offsets[1] = 0.5, 2.0
    return SampledRig("known", MESH, CONTROLS, np.array([0, 3]), np.array([1]), ("all",), None, known)


@pytest.mark.parametrize("kind", ["recipe", "function", "sampled", "altered"])
def test_every_kind_of_rig_keeps_the_contract_when_it_runs(kind, request):
    rig = {
        "recipe": lambda: request.getfixturevalue("tiny"),
        "function": foreign,
        "sampled": lambda: request.getfixturevalue("sampled"),
        "altered": lambda: AlteredRig(foreign()),
    }[kind]()
    members = [name for name, value in vars(Rig).items() if isinstance(value, property)]
    assert isinstance(rig, Rig) and len(members) == 16 and all(hasattr(rig, name) for name in members)
    n, m = len(rig.mesh.neutral), len(rig.controls)
    assert all(limits.shape == (m,) and limits.dtype == np.float32 for limits in (rig.lower, rig.default, rig.upper))
    for points in (rig.landmarks, rig.control_points, rig.face_marks):
        assert points.ndim == 1 and points.dtype.kind == "i" and ((points >= 0) & (points < n)).all()
    assert len(rig.control_point_regions) == len(rig.control_points)
    assert len(rig.face_mark_regions) == len(rig.face_marks)
    assert len(rig.landmark_names) in (0, len(rig.landmarks))
    assert len(rig.control_point_names) in (0, len(rig.control_points))
    assert all(clip.values.shape[1:] == (m,) for clip in rig.clips or ())
    assert rig.paint is None or (rig.paint.shape, rig.paint.dtype) == ((n, 3), np.uint8)
    assert list(inspect.signature(rig).parameters) == ["params"]
    one, batch = rig(rig.default), rig(rig.default[None])
    assert (one.shape, batch.shape) == ((n, 3), (1, n, 3)) and one.dtype == batch.dtype == np.float32
    assert all(len(prop) == 4 for prop in rig.pose_props(rig.default))
