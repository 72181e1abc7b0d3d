"""All ways to evaluate the same trained model, with the rigid step: what a table of backends compares."""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float

from replicate.approximation.cnn import MapNetwork
from replicate.approximation.deformation_map import sample
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.rigid import Attachments, attach
from replicate.base.exceptions import InputError
from replicate.engine.provenance import core_count
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import Evaluate, fast_evaluation
from replicate.inference.rigid_step import place_rigid_segments, plan_rigid_step
from replicate.methods.method import Model
from replicate.timing.gpu_evaluation import gpu_evaluation, graph_evaluation
from replicate.timing.jax_evaluation import jax_evaluation
from replicate.timing.single_poses import FAST, GPU, GRAPH, HALF, JAX, ONNX, ONNX_SPINNING, ONNX_THREADS, PLAIN


def other_backends(model: Model, mesh: Mesh, attachments: Attachments) -> dict[str, Evaluate]:
    """Return the ways (1, m) → (1, n, 3) mm to evaluate a model besides `offsets`, by their endings in BACKENDS.

    Those with several threads are among them where the process has several cores.
    """
    plain, written, cores = plain_offsets(model), onnx_bytes(model, mesh, attachments), core_count()

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


# The plain way to evaluate the paper's networks: a torch module a segment, maps in full, which the vertices then read.
#
# It is what a first implementation does, Fig. 3 layer by layer in torch's operations; the suite's faster evaluation of
# the same weights is compared with it.


def plain_offsets(model: Model) -> Callable[[np.ndarray], np.ndarray] | None:
    """Return parameters (b, m) → offsets (b, n, 3) mm by the plain way; None for a model without deformation maps."""
    parts = [model.coarse, model.residual] if isinstance(model, RefinedModel) else [model]
    if not all(isinstance(part, SegmentedModel) and _has_maps(part) for part in parts):
        return None

    def offsets(params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        with torch.no_grad():
            return sum(_evaluate(part, torch.tensor(np.asarray(params, np.float32))) for part in parts).numpy()

    return offsets


def read_full_maps(network: MapNetwork, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
    """Return the offsets that vertices read from maps computed in full (Fig. 3), not yet in mm."""
    return sample(network.maps(params), network.pixels, network.shares)


def _has_maps(model: SegmentedModel) -> bool:
    return all(isinstance(network, MapNetwork) for network in model.networks)


def _evaluate(model: SegmentedModel, params: torch.Tensor) -> torch.Tensor:
    scaled = params / model.scale
    out = torch.zeros(len(params), model.vertex_count, 3)
    for network, segment, length in zip(model.networks, model.segments, model.lengths, strict=True):
        out[:, segment.vertices] = read_full_maps(network, scaled[:, segment.parameters]) * length
    return out


# A trained model evaluated by ONNX Runtime: the file that leaves the suite, its rigid step inside.


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
    from replicate.deployment.onnx_model import PARAMETERS, session

    model = session(written, threads, spins)

    def evaluate(params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        return model.run(None, {PARAMETERS: np.ascontiguousarray(params, np.float32)})[0]

    return evaluate
