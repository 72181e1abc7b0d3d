"""All ways to evaluate the same trained model, with the rigid step: what a table of backends compares."""

import numpy as np
import torch
from jaxtyping import Float

from replicate.approximation.rigid import Attachments, attach
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import Evaluate, fast_evaluation
from replicate.inference.rigid_step import place_rigid_segments, plan_rigid_step
from replicate.methods.method import Model
from replicate.timing.gpu_evaluation import gpu_evaluation, graph_evaluation
from replicate.timing.jax_evaluation import jax_evaluation
from replicate.timing.machine import core_total
from replicate.timing.onnx_evaluation import onnx_bytes, run_by_onnx
from replicate.timing.plain_evaluation import plain_offsets
from replicate.timing.single_poses import FAST, GPU, GRAPH, HALF, JAX, ONNX, ONNX_SPINNING, ONNX_THREADS, PLAIN


def other_backends(model: Model, mesh: Mesh, attachments: Attachments) -> dict[str, Evaluate]:
    """Return the ways (1, m) → (1, n, 3) mm to evaluate a model besides `offsets`, by their endings in BACKENDS.

    Those with several threads are among them where the process has several cores.
    """
    plain, written, cores = plain_offsets(model), onnx_bytes(model, mesh, attachments), core_total()

    def by_torch(params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        return attach(mesh, attachments, mesh.neutral + plain(params))

    ways = {
        PLAIN: by_torch if plain else None,
        JAX: jax_evaluation(model, mesh, attachments),
        ONNX: run_by_onnx(written) if written else None,
        ONNX_THREADS: run_by_onnx(written, cores) if written and cores > 1 else None,
        ONNX_SPINNING: run_by_onnx(written, cores, spins=True) if written and cores > 1 else None,
        FAST: fast_evaluation(model, mesh, attachments),
        HALF: fast_evaluation(model, mesh, attachments, halves=True),
    }
    return {ending: evaluate for ending, evaluate in ways.items() if evaluate}


def gpu_backends(model: Model, mesh: Mesh, attachments: Attachments) -> dict[str, Evaluate]:
    """Return the ways (1, m) → (1, n, 3) mm to evaluate a model on a GPU, by their endings; {} without one."""
    if not torch.cuda.is_available():
        return {}
    makers = {GPU: gpu_evaluation, GRAPH: graph_evaluation}
    ways = {ending: make(model, mesh, attachments) for ending, make in makers.items()}
    return {ending: evaluate for ending, evaluate in ways.items() if evaluate}


def fast_rigid_step(mesh: Mesh, attachments: Attachments, posed: Float[np.ndarray, "1 n 3"]) -> Evaluate:
    """Return a function that ignores the parameters it gets and takes the fast rigid step (§3.4) of one posed mesh."""
    plan = plan_rigid_step(mesh, attachments)

    def place(params: np.ndarray) -> np.ndarray:
        out = np.array(posed, np.float32)
        place_rigid_segments(plan, out[0])
        return out

    return place


def largest_difference(
    evaluate: Evaluate, poses: Float[np.ndarray, "t m"], expected: Float[np.ndarray, "t n 3"]
) -> float:
    """Return the largest difference of a coordinate between evaluated poses and what is expected of them, mm."""
    pairs = zip(poses, expected, strict=True)
    return max(float(np.abs(evaluate(pose[None])[0] - vertices).max()) for pose, vertices in pairs)
