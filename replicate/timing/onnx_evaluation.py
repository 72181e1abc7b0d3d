"""A trained model evaluated by ONNX Runtime: the file that leaves the suite, its rigid step inside."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from replicate.approximation.rigid import Attachments
from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh

Evaluate = Callable[[np.ndarray], np.ndarray]


def onnx_evaluation(model: object, mesh: Mesh, attachments: Attachments | None) -> Evaluate | None:
    """Return parameters (b, m) → vertices (b, n, 3) mm by ONNX Runtime, on one thread.

    None where the runtime is not installed, and for a model that can't be written as ONNX. attachments: None for no
    rigid step.
    """
    written = onnx_bytes(model, mesh, attachments)
    return run_by_onnx(written) if written else None


def onnx_bytes(model: object, mesh: Mesh, attachments: Attachments | None) -> bytes | None:
    """Return a model as an ONNX file; None where `onnx_evaluation` returns None."""
    try:
        import onnxruntime  # noqa: F401 — without it nothing could run the file

        from replicate.deployment.onnx_model import onnx_model

        return onnx_model(model, mesh, attachments).SerializeToString()
    except (ImportError, InputError):
        return None


def run_by_onnx(written: bytes, threads: int = 1, spins: bool = False) -> Evaluate:
    """Return parameters (b, m) → vertices (b, n, 3) mm of an ONNX file.

    threads: how many share the work of an operator. spins: whether a thread that waits for the next operator keeps its
    core busy, so that it starts at once.
    """
    import onnxruntime

    from replicate.deployment.onnx_model import PARAMETERS

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.add_session_config_entry("session.intra_op.allow_spinning", str(int(spins)))
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(written, options, providers=["CPUExecutionProvider"])

    def evaluate(params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        return session.run(None, {PARAMETERS: np.ascontiguousarray(params, np.float32)})[0]

    return evaluate
