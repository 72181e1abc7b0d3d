"""A fresh process poses a face once and says what that took."""

import subprocess
import sys

import numpy as np
import pytest
from small_face import pose_offsets
from untrained_models import MESH, MODELS

from replicate.approximation import rigid
from replicate.base.exceptions import RunError
from replicate.base.paths import ROOT
from replicate.benchmarks import first_pose as fresh
from replicate.methods import artefacts, method_registry
from replicate.methods.method import Method
from replicate.timing import single_poses
from replicate.timing.backends import onnx_bytes


def test_a_fresh_process_that_has_the_file_alone_poses_a_face(tmp_path):
    file = tmp_path / "dense.onnx"
    file.write_bytes(onnx_bytes(MODELS["dense"](), MESH, None))
    found = fresh.first_pose(fresh.ONNX, [0.5] * 12, {"file": str(file)}, tmp_path / "kernels")
    assert 0 < found["seconds"] < 60
    assert found["peak_mb"] is None or 10 < found["peak_mb"] < 2_000


def test_a_fresh_process_imports_nothing_of_the_suite_but_what_it_is_asked_for():
    program = (
        "import sys, replicate.benchmarks.first_pose\n"
        "print(*(name in sys.modules for name in ('numpy', 'replicate.config')))"
    )
    process = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["False", "False"]


def test_a_process_that_finds_no_file_is_an_error_that_says_so(tmp_path):
    with pytest.raises(RunError, match=r"a fresh process can't pose .*none\.onnx: .*doesn't exist"):
        fresh.first_pose(fresh.ONNX, [0.5] * 12, {"file": str(tmp_path / "none.onnx")}, tmp_path)


@pytest.mark.parametrize("rigid_step", [True, False])
def test_only_a_method_with_the_rigid_step_takes_it(rigid_step, monkeypatch):
    poses = np.random.default_rng(0).uniform(-1, 1, (9, 12)).astype(np.float32)
    attachments = rigid.find_attachments(MESH, MESH.neutral + pose_offsets(MESH, poses), 0.3, 4)
    model, placed = MODELS["driven"](), []
    method = Method("driven", "Driven", lambda plan: (), model=lambda inputs: model, rigid_step=rigid_step)
    monkeypatch.setattr(method_registry, "method_named", lambda name: method)
    monkeypatch.setattr(artefacts, "load_mesh", lambda inputs: MESH)
    monkeypatch.setattr(artefacts, "load_attachments", lambda inputs: attachments)
    monkeypatch.setattr(rigid, "attach", lambda mesh, attachments, posed: placed.append(len(attachments.segment)))
    fresh._pose_once({"way": fresh.TORCH, "pose": [0.5] * 12, "method": "driven", "inputs": {}})
    assert len(attachments.segment) == 1 and placed == [1 if rigid_step else 0]


def test_names_of_ways_are_those_of_results():
    assert fresh.TORCH == "" and fresh.ONNX == single_poses.ONNX
