"""What a fresh process needs until it has posed a face once: seconds from its first import, and its peak of memory.

`python -m replicate.benchmarks.first_pose` is that process. It is asked in a line of JSON and answers in one.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

START = time.perf_counter()  # in the fresh process: before anything large is imported
STATUS = Path("/proc/self/status")  # where Linux says what a process's memory was at most
TORCH, FAST_WAY, ONNX_WAY = "", "_fast", "_onnx"  # as `single_poses` has them, which imports too much


def first_pose(way: str, pose: list[float], model: dict, kernels: Path) -> dict[str, float]:
    """Return what a fresh process takes to pose a face once: "seconds", and "peak_mb" where the system tells.

    way: TORCH, FAST or ONNX. pose: raw rig parameters. model: for ONNX {"file": an ONNX file}; else {"method": a
    method's name, "inputs": the folders that its model, the mesh and the rigid segments are read from, by name}.
    kernels: the folder that compiled code is looked for and kept in.
    Raises RunError, with the last line that the process has written, where it fails.
    """
    from replicate.base.exceptions import RunError

    asked = json.dumps({"way": way, "pose": pose, **model})
    command = [sys.executable, "-m", "replicate.benchmarks.first_pose"]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(kernels)}
    done = subprocess.run(command, input=asked, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        *_, last = done.stderr.splitlines() or [f"it ends with code {done.returncode}"]
        raise RunError(f"a fresh process can't pose {model.get('method') or model['file']}: {last}")
    return json.loads(done.stdout.splitlines()[-1])


def peak_mb() -> float | None:
    """Return how much memory this process has had resident at most, in MB of 10⁶ bytes; None where nothing tells."""
    if not STATUS.is_file():
        return None
    peaks = [line.split()[1] for line in STATUS.read_text().splitlines() if line.startswith("VmHWM")]
    return int(peaks[0]) * 1024 / 1e6 if peaks else None


def _pose_once(asked: dict) -> dict[str, float | None]:
    import numpy as np

    pose = np.array([asked["pose"]], np.float32)
    (_by_onnx if asked["way"] == ONNX_WAY else _by_suite)(asked, pose)
    return {"seconds": time.perf_counter() - START, "peak_mb": peak_mb()}


def _by_onnx(asked: dict, pose: object) -> None:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(asked["file"], options, providers=["CPUExecutionProvider"])
    session.run(None, {session.get_inputs()[0].name: pose})


def _by_suite(asked: dict, pose: object) -> None:
    from replicate.approximation.rigid import attach
    from replicate.benchmarks.common import placing_attachments
    from replicate.methods import artefacts
    from replicate.methods.method_registry import method_named

    inputs = {name: Path(folder) for name, folder in asked["inputs"].items()}
    method, mesh = method_named(asked["method"]), artefacts.load_mesh(inputs)
    model, placing = method.model(inputs), placing_attachments(method, artefacts.load_attachments(inputs))
    if asked["way"] == TORCH:
        attach(mesh, placing, mesh.neutral + model.offsets(pose))
        return
    from replicate.inference.fast_evaluation import fast_evaluation

    fast_evaluation(model, mesh, placing)(pose)


if __name__ == "__main__":
    print(json.dumps(_pose_once(json.load(sys.stdin))))
