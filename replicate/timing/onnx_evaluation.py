"""A trained model evaluated by ONNX Runtime: the file that leaves the suite, its rigid step inside."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from replicate.approximation.rigid import Attachments
from replicate.engine.exceptions import InputError
from replicate.geometry.mesh import Mesh


def onnx_evaluation(
    model: object, mesh: Mesh, attachments: Attachments | None
) -> Callable[[np.ndarray], np.ndarray] | None:
    """Return parameters (b, m) → vertices (b, n, 3) mm by ONNX Runtime, on one thread that does not spin.

    attachments: None for no rigid step. Returns None where the runtime is not installed, and for a model that can't be
    written as ONNX.
    """
    try:
        import onnxruntime

        from replicate.deployment.onnx_model import PARAMETERS, onnx_model

        written = onnx_model(model, mesh, attachments).SerializeToString()
    except (ImportError, InputError):
        return None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(written, options, providers=["CPUExecutionProvider"])

    def evaluate(params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        return session.run(None, {PARAMETERS: np.ascontiguousarray(params, np.float32)})[0]

    return evaluate
