"""A whole approximation as one ONNX model: rig parameters in, vertices in mm out, maps and rigid step inside."""

from collections.abc import Mapping

import numpy as np
import onnx

from replicate.approximation.rigid import Attachments
from replicate.deployment.onnx_graph import OnnxGraph
from replicate.deployment.onnx_offsets import add_offsets, padded, places
from replicate.deployment.onnx_rigid import add_rigid_segments
from replicate.geometry.mesh import Mesh

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

    model: a method's. attachments: what places the rigid segments (§3.4); None for a method without that step. half:
    whether weights are stored in 16 bits; sums are of float32 all the same. about: metadata. words: what it is, in a
    sentence. Raises InputError as `add_offsets` does.
    """
    graph = OnnxGraph(half)
    moved = add_offsets(model, graph, PARAMETERS)
    is_rigid = np.zeros(len(mesh.neutral), bool)
    if attachments is not None:
        is_rigid = np.isin(mesh.segment, attachments.segment)
    still = np.setdiff1d(np.flatnonzero(~is_rigid), moved.vertices)
    order = np.concatenate([moved.vertices, still])
    posed = graph.node("Add", padded(graph, moved.offsets, len(still)), graph.number(mesh.neutral[order]))
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
