"""A whole approximation as one ONNX model: rig parameters in, vertices in mm out, maps and rigid step inside."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import onnx
from jaxtyping import Float, Float32

from data_recipes.rig import Control
from replicate.approximation.rigid import Attachments
from replicate.deployment.onnx_graph import OnnxGraph
from replicate.deployment.onnx_offsets import add_offsets, padded, places
from replicate.deployment.onnx_rigid import add_rigid_segments
from replicate.geometry.mesh import Mesh

if TYPE_CHECKING:
    import onnxruntime

PARAMETERS, VERTICES, POSES = "parameters", "vertices", "poses"  # the input, the output, and the free dimension


def onnx_model(
    model: object,
    mesh: Mesh,
    attachments: Attachments | None,
    half: bool = False,
    about: Mapping[str, str] | None = None,
    words: str = "",
) -> onnx.ModelProto:
    """Return an ONNX model: `parameters` (poses, m) float32 → `vertices` (poses, n, 3) float32, mm.

    model: a method's model
    mesh: the neutral mesh, mm, and its segments
    attachments: what places the rigid segments (§3.4); None for a method without that step
    half: whether weights are stored in 16 bits; sums are in float32 all the same
    about: metadata
    words: what the model is, in a sentence

    Raises InputError as `add_offsets` does.
    """
    graph = OnnxGraph(half)
    moved = add_offsets(model, graph, PARAMETERS)
    is_rigid = np.zeros(len(mesh.neutral), bool)
    if attachments is not None:
        is_rigid = np.isin(mesh.segment, attachments.segment)
    still = np.setdiff1d(np.flatnonzero(~is_rigid), moved.vertices)
    order = np.concatenate([moved.vertices, still])
    posed = graph.node("Add", padded(graph, moved.offsets, len(still)), graph.constant(mesh.neutral[order]))
    place = places(order, np.arange(len(mesh.neutral)))
    if is_rigid.any():
        carriers = graph.gather(posed, places(order, attachments.vertex.ravel()), 1)
        placed = add_rigid_segments(graph, mesh, attachments, carriers)
        posed = graph.node("Concat", posed, placed.vertices, axis=1)
        place[placed.members] = len(order) + placed.rows
    vertices = posed if np.array_equal(place, np.arange(len(order))) else graph.gather(posed, place, 1)
    source, target = (PARAMETERS, [POSES, _parameter_count(model)]), (VERTICES, [POSES, len(mesh.neutral), 3])
    return graph.model(source, vertices, target, dict(about or {}), words)


def _parameter_count(model: object) -> int:
    return len(getattr(model, "coarse", model).scale)


# A check, through onnxruntime, that a written model gives what Python gives, within the limits and beyond.

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
    return session(model.SerializeToString(), threads).run([VERTICES], {PARAMETERS: params})[0]


def session(written: bytes, threads: int = 1, spins: bool = True) -> "onnxruntime.InferenceSession":
    """Return what onnxruntime makes of an ONNX file on the CPU. spins: whether threads that wait for work keep busy."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads, options.log_severity_level = threads, 1, 3
    options.add_session_config_entry("session.intra_op.allow_spinning", str(int(spins)))
    return onnxruntime.InferenceSession(written, options, providers=["CPUExecutionProvider"])


def largest_distance(one: Float[np.ndarray, "*#b n 3"], other: Float[np.ndarray, "*#b n 3"]) -> float:
    """Return the largest distance between vertices of the same poses, or of poses and a mesh, mm."""
    return float(np.linalg.norm(one - other, axis=-1).max())
