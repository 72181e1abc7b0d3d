"""What a fresh process needs until it has posed a face once: seconds from its first import, and its peak of memory.

`python -m replicate.benchmarks.first_pose` is that process. It is asked in a line of JSON and answers in one.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from replicate.base.exceptions import RunError

START = time.perf_counter()  # in the fresh process: before anything large is imported
STATUS = Path("/proc/self/status")  # where Linux says what a process's memory was at most
TORCH, ONNX = "", "_onnx"  # of the ways that `single_poses` names, which imports too much


def first_pose(way: str, pose: list[float], model: dict, kernels: Path) -> dict[str, float]:
    """Return what a fresh process takes to pose a face once: "seconds", and "peak_mb" where the system tells.

    way: "" for torch, or an ending of `single_poses`: FAST or ONNX. pose: raw rig parameters. model: for ONNX {"file":
    an ONNX file}; else {"method": a method's name, "inputs": the folders of its model, the mesh and the rigid segments,
    by name}. kernels: the folder of compiled code. Raises RunError, with the last line that the process has written,
    where it fails.
    """
    request = json.dumps({"way": way, "pose": pose, **model})
    command = [sys.executable, "-m", "replicate.benchmarks.first_pose"]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(kernels)}
    done = subprocess.run(command, input=request, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        *_, last = done.stderr.splitlines() or [f"it ends with code {done.returncode}"]
        raise RunError(f"a fresh process can't pose {model.get('method') or model['file']}: {last}")
    return json.loads(done.stdout.splitlines()[-1])


def peak_mb() -> float | None:
    """Return the peak of this process's resident memory in MB of 10⁶ bytes; None where the system doesn't tell."""
    if not STATUS.is_file():
        return None
    peaks = [line.split()[1] for line in STATUS.read_text().splitlines() if line.startswith("VmHWM")]
    return int(peaks[0]) * 1024 / 1e6 if peaks else None


def _pose_once(request: dict) -> dict[str, float | None]:
    import numpy as np

    pose = np.array([request["pose"]], np.float32)
    (_by_onnx if request["way"] == ONNX else _by_suite)(request, pose)
    return {"seconds": time.perf_counter() - START, "peak_mb": peak_mb()}


def _by_onnx(request: dict, pose: object) -> None:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(request["file"], options, providers=["CPUExecutionProvider"])
    session.run(None, {session.get_inputs()[0].name: pose})


def _by_suite(request: dict, pose: object) -> None:
    from replicate.approximation.rigid import attach
    from replicate.methods import artefacts
    from replicate.methods.attachment import placing_attachments
    from replicate.methods.method_registry import method_named

    inputs = {name: Path(folder) for name, folder in request["inputs"].items()}
    method, mesh = method_named(request["method"]), artefacts.load_mesh(inputs)
    model, placing = method.model(inputs), placing_attachments(method, artefacts.load_attachments(inputs))
    if request["way"] == TORCH:
        attach(mesh, placing, mesh.neutral + model.offsets(pose))
        return
    from replicate.inference.fast_evaluation import fast_evaluation

    fast_evaluation(model, mesh, placing)(pose)


if __name__ == "__main__":
    print(json.dumps(_pose_once(json.load(sys.stdin))))
