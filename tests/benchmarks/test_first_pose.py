"""A fresh process poses a face once and says what that took."""

import pytest
from untrained_models import MESH, MODELS

from replicate.benchmarks import first_pose
from replicate.engine.exceptions import RunError
from replicate.timing import timed_names
from replicate.timing.onnx_evaluation import onnx_bytes


def test_a_fresh_process_that_has_the_file_alone_poses_a_face(tmp_path):
    file = tmp_path / "dense.onnx"
    file.write_bytes(onnx_bytes(MODELS["dense"](), MESH, None))
    found = first_pose.first_pose(first_pose.ONNX, [0.5] * 12, {"file": str(file)})
    assert 0 < found["seconds"] < 60
    assert found["peak_mb"] is None or 10 < found["peak_mb"] < 2_000


def test_a_process_that_finds_no_file_is_an_error_that_says_so(tmp_path):
    with pytest.raises(RunError, match=r"a fresh process can't pose .*none\.onnx: .*doesn't exist"):
        first_pose.first_pose(first_pose.ONNX, [0.5] * 12, {"file": str(tmp_path / "none.onnx")})


def test_names_of_ways_are_those_of_results():
    assert (first_pose.FAST, first_pose.ONNX) == (timed_names.FAST, timed_names.ONNX)
