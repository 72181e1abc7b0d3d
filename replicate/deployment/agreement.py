"""Whether a written model gives what Python gives: poses within the limits and beyond, through onnxruntime."""

from collections.abc import Sequence

import numpy as np
import onnx
from jaxtyping import Float, Float32

from data_recipes.rig import Control
from replicate.deployment.onnx_model import PARAMETERS, VERTICES

SHARE = 0.3  # of the controls that a pose moves
BEYOND = (0.25, 3.0)  # what Eq. 5 multiplies parameters with


def drawn_poses(controls: Sequence[Control], count: int, rng: np.random.Generator) -> Float32[np.ndarray, "b m"]:
    """Return poses that move some controls; the second half of them leaves the limits as Eq. 5 does."""
    lower, default, upper = np.array([(c.lower, c.default, c.upper) for c in controls], np.float64).T
    size = (count, len(controls))
    ends = np.where(rng.uniform(size=size) < 0.5, lower, upper)
    offset = (ends - default) * rng.uniform(size=size) * (rng.uniform(size=size) < SHARE)
    offset[count // 2 :] *= rng.uniform(*BEYOND, size=offset[count // 2 :].shape)
    return (default + offset).astype(np.float32)


def posed(model: onnx.ModelProto, params: Float32[np.ndarray, "b m"], threads: int = 1) -> Float32[np.ndarray, "b n 3"]:
    """Return the vertices that onnxruntime gives for a model, mm, on the CPU."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.log_severity_level = threads, 3
    session = onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    return session.run([VERTICES], {PARAMETERS: params})[0]


def largest_distance(one: Float[np.ndarray, "*#b n 3"], other: Float[np.ndarray, "*#b n 3"]) -> float:
    """Return the largest distance between vertices of the same poses, or of poses and a mesh, mm."""
    return float(np.linalg.norm(one - other, axis=-1).max())
