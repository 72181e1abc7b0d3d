"""The rigid step (§3.4) as ONNX operators: the best rotation of a segment's carriers by Horn's quaternion, in float32.

There is no SVD in ONNX. Horn (1987, "Closed-form solution of absolute orientation using unit quaternions") has the
best rotation as the eigenvector of a symmetric 4×4 matrix for its largest eigenvalue. Squaring that matrix repeatedly
leaves only this eigenvector. Two steps of Newton's method then remove the rounding error: they work on residuals of
Eq. 3 instead of differences of large sums. All of it is a fixed number of products, for all segments at once.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from replicate.approximation.rigid import Attachments
from replicate.deployment.onnx_graph import OnnxGraph
from replicate.geometry.mesh import Mesh

# Unit quaternions (w, x, y, z) by linear maps: what Horn's matrix, rotations and products are in terms of entries.


def axial(covariance: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Return Σ x × y for the matrix Σ xᵀ y of row vectors."""
    s = covariance
    return np.array([s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]])


def horn_matrix(covariance: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4 4"]:
    """Return Horn's symmetric matrix for Σ xᵀ y: its last eigenvector turns x best to y (Eq. 3)."""
    s, matrix = covariance, np.empty((4, 4))
    matrix[0, 0] = np.trace(s)
    matrix[0, 1:] = matrix[1:, 0] = axial(s)
    matrix[1:, 1:] = s + s.T - np.trace(s) * np.eye(3)
    return matrix


def rotation_of(quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    """Return a unit quaternion as the rotation of row vectors, v @ R."""
    w, (x, y, z) = quaternion[0], quaternion[1:]
    v = quaternion[1:]
    across = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * across


def quaternion_product(one: Float[np.ndarray, "4"], other: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
    """Return the quaternion that turns by `other`, then by `one`."""
    a, b = one, other
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *vector])


def _bilinear(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (rotation_of(a + b) - rotation_of(a) - rotation_of(b)) / 2


_UNITS = np.eye(4)
HORN = np.array([horn_matrix(s).ravel() for s in np.eye(9).reshape(9, 3, 3)])  # (9, 16): Σ xᵀ y, row by row → matrix
FROM_PRODUCTS = np.array([_bilinear(a, b).ravel() for a, b in product(_UNITS, _UNITS)])  # (16, 9): q_i q_j → rotation
PRODUCT = np.array([quaternion_product(a, b) for a, b in product(_UNITS, _UNITS)])  # (16, 4): a_i b_j → a b


SQUARINGS = 20  # carriers nearly on a line leave two eigenvalues close: the 2²⁰th power parts them
UNSCALED = 5  # squarings after each other before numbers are scaled again: entries up to 4³² fit into float32
STEPS = 2  # of Newton's method
NEAREST = 16.0  # how much the identity is preferred where carriers leave the rotation open, as in `geometry.alignment`
DAMPING = 1e-5  # of a step, in units of the carriers' spread: rounding must not decide what carriers leave open
LEAST_DETERMINANT = 1e-6
TINY = 1e-30  # so that nothing is divided by zero

CURVATURE = np.array([np.trace(s) * np.eye(3) - (s + s.T) / 2 for s in np.eye(9).reshape(9, 3, 3)]).reshape(9, 9)
AXIAL = np.array([axial(s) for s in np.eye(9).reshape(9, 3, 3)])


@dataclass(frozen=True)
class Placed:
    """What the rigid step places. vertices: a value (b, k, 3), mm. rows: which of them are the mesh's `members`."""

    vertices: str
    rows: Int[np.ndarray, " v"]
    members: Int[np.ndarray, " v"]


def add_rigid_segments(graph: OnnxGraph, mesh: Mesh, attachments: Attachments, carriers: str) -> Placed:
    """Return the vertices of all rigid segments as their carriers place them.

    carriers: a value (b, r·c, 3), mm, the vertices `attachments.vertex` as they are posed.
    """
    count, each = attachments.vertex.shape
    rest = mesh.neutral[attachments.vertex].astype(np.float64)
    centre = rest.mean(1, keepdims=True)
    posed = graph.reshape(carriers, [0, count, each, 3])
    posed_centre = graph.reduce("ReduceMean", posed, 2)  # (b, r, 1, 3)
    rotation = add_rotations(graph, rest - centre, graph.node("Sub", posed, posed_centre))
    members = [np.flatnonzero(mesh.segment == k) for k in attachments.segment]
    most = max(map(len, members))  # segments are filled up to the largest, so that one product places them all
    arms = np.zeros((count, most, 3))
    for row, vertices in enumerate(members):
        arms[row, : len(vertices)] = mesh.neutral[vertices] - centre[row]
    arms = graph.for_each_pose(arms, posed_centre)
    placed = graph.node("Add", graph.node("MatMul", arms, rotation), posed_centre)
    rows = np.concatenate([row * most + np.arange(len(vertices)) for row, vertices in enumerate(members)])
    return Placed(graph.reshape(placed, [0, count * most, 3]), rows, np.concatenate(members))


def add_rotations(graph: OnnxGraph, rest: np.ndarray, posed: str) -> str:
    """Return the rotations (b, r, 3, 3) of row vectors that best turn the carriers of r segments (Eq. 3).

    rest: (r, c, 3) mm about their mean; posed: a value (b, r, c, 3) likewise. Where carriers lie on a line, or in one
    place, many rotations are equally good: it is one near the identity.
    """
    whole_rest = graph.for_each_pose(rest, posed)
    covariance = graph.node("MatMul", _transposed(graph, whole_rest), posed)  # (b, r, 3, 3): Σ xᵀ y
    quaternion = _dominant(graph, covariance)
    for _ in range(STEPS):
        quaternion = _improved(graph, quaternion, covariance, whole_rest, posed)
    return _matrix(graph, quaternion)


def _dominant(graph: OnnxGraph, covariance: str) -> str:
    """Return the unit quaternion (b, r, 1, 4) of the largest eigenvalue of Horn's matrix, roughly."""
    flat = _unit(graph, graph.reshape(covariance, [0, 0, 1, 9]))
    flat = graph.node("MatMul", flat, graph.constant(HORN / 4))
    shift = np.sqrt(3) / 4 * np.eye(4)  # all eigenvalues are between 0 and 1 then
    matrix = graph.node("Add", graph.reshape(flat, [0, 0, 4, 4]), graph.constant(shift))
    for k in range(SQUARINGS):
        matrix = graph.node("MatMul", matrix, matrix)
        if k % UNSCALED == UNSCALED - 1:  # the largest entry of such a matrix is on its diagonal
            matrix = graph.node("Div", matrix, graph.reduce("ReduceMax", matrix, 2, 3))
    weighted = graph.node("Mul", matrix, graph.constant(np.diag([NEAREST, 1, 1, 1])))
    diagonal = graph.reduce("ReduceMax", weighted, 3, keep=False)
    best = graph.node("ArgMax", diagonal, axis=2, keepdims=1)
    row = graph.reshape(graph.cast(graph.node("Equal", best, graph.integers(range(4)))), [0, 0, 1, 4])
    return _unit(graph, graph.node("MatMul", row, matrix))


def _improved(graph: OnnxGraph, quaternion: str, covariance: str, rest: str, posed: str) -> str:
    """Return a quaternion after a step of Newton's method.

    It turns by ω = (tr(M) I − sym(M))⁻¹ Σ x R × (y − x R) with M = Rᵀ Σ xᵀ y.
    """
    matrix = _matrix(graph, quaternion)
    turned = graph.node("MatMul", rest, matrix)
    moment = graph.node("MatMul", _transposed(graph, turned), graph.node("Sub", posed, turned))
    gradient = graph.node("MatMul", graph.reshape(moment, [0, 0, 1, 9]), graph.constant(AXIAL))  # (b, r, 1, 3)
    curvature = graph.reshape(graph.node("MatMul", _transposed(graph, matrix), covariance), [0, 0, 1, 9])
    curvature = graph.node("MatMul", curvature, graph.constant(CURVATURE))
    size = graph.node("Add", graph.reduce("ReduceL2", curvature, 3), graph.constant(TINY))
    gradient = graph.node("Div", gradient, size)
    curvature = graph.reshape(graph.node("Div", curvature, size), [0, 0, 3, 3])
    damped = graph.node("Add", curvature, graph.constant(DAMPING * np.eye(3)))
    turn = graph.node("Clip", _solved(graph, damped, gradient), graph.constant(-1), graph.constant(1))
    half = graph.node("MatMul", turn, graph.constant(np.eye(3, 4, 1) / 2))
    half = graph.node("Add", half, graph.constant([1, 0, 0, 0]))
    return _unit(graph, graph.node("MatMul", _products(graph, half, quaternion), graph.constant(PRODUCT)))


def _solved(graph: OnnxGraph, matrix: str, right: str) -> str:
    """Return right · matrix⁻¹ for symmetric matrices (b, r, 3, 3), by adj A = A² − tr(A) A + ½ (tr(A)² − tr(A²)) I."""
    square = graph.node("MatMul", matrix, matrix)
    trace, trace_of_square = (_trace(graph, value) for value in (matrix, square))
    rest = graph.node("Sub", graph.node("Mul", trace, trace), trace_of_square)
    adjugate = graph.node("Sub", square, graph.node("Mul", trace, matrix))
    adjugate = graph.node("Add", adjugate, graph.node("Mul", rest, graph.constant(np.eye(3) / 2)))
    threefold = graph.sum(graph.node("Mul", matrix, adjugate), 2, 3)
    determinant = graph.node(
        "Max", graph.node("Mul", threefold, graph.constant(1 / 3)), graph.constant(LEAST_DETERMINANT)
    )
    return graph.node("Div", graph.node("MatMul", right, adjugate), determinant)


def _trace(graph: OnnxGraph, matrix: str) -> str:
    diagonal = graph.node("Mul", matrix, graph.constant(np.eye(3)))
    return graph.sum(diagonal, 2, 3)


def _matrix(graph: OnnxGraph, quaternion: str) -> str:
    """Return the rotation (b, r, 3, 3) of row vectors of a unit quaternion (b, r, 1, 4)."""
    flat = graph.node("MatMul", _products(graph, quaternion, quaternion), graph.constant(FROM_PRODUCTS))
    return graph.reshape(flat, [0, 0, 3, 3])


def _products(graph: OnnxGraph, one: str, other: str) -> str:
    """Return all products (b, r, 1, 16) of the entries of two quaternions (b, r, 1, 4)."""
    return graph.reshape(graph.node("MatMul", _transposed(graph, one), other), [0, 0, 1, 16])


def _transposed(graph: OnnxGraph, value: str) -> str:
    return graph.node("Transpose", value, perm=[0, 1, 3, 2])


def _unit(graph: OnnxGraph, value: str) -> str:
    size = graph.reduce("ReduceL2", value, 3)
    return graph.node("Div", value, graph.node("Add", size, graph.constant(TINY)))
