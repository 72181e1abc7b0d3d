"""What is in a mouth stays in it: how far teeth, gums and tongue come through the skin, or into the flesh.

The face and the mouth bag are one surface, the wall; teeth, gums and tongue are pieces of their own that lie in the
bag, on the wall's outer side. Two lengths in mm say where a vertex of theirs has gone, each beyond what it has at rest:

- *through*: it lies in front of outer skin, where it can be seen. A ray from it back into the head, against the
  direction in which it faces lips, cheek or chin at rest (which turns with its piece), meets skin that faces that
  direction; the depth is the distance to that skin's plane. Through an open mouth the ray meets none.
- *buried*: it lies behind the wall, in the flesh, by the distance to the nearest wall. In a thin lip it is at most half
  of the lip's thickness.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from replicate.evaluation.triangle_kernel import ray_hits, signed_distances
from replicate.mesh import Mesh, face_normals
from replicate.rigid import align

HEAD_WIDTH_MM = 188.0  # the lengths below are for a head of this width, and scale with it
WALL_MM = 30.0  # triangles this near to the pieces are wall
REACH_MM = 25.0  # how far back a ray looks for skin
FACING = 0.3  # cosine above which skin faces the ray's way
NEIGHBOURS = 24  # of a vertex, over which its direction is the mean
KINDS = {"tooth": "teeth", "teeth": "teeth", "gum": "gums", "tongue": "tongue"}  # by a segment's beginning


@dataclass(frozen=True)
class Mouth:
    """What of a mesh is in the mouth, and the wall around it.

    points (k,): vertices of all pieces; piece (k,): which one each belongs to; kind (k,): its index in `kinds`; outward
    (k, 3): the direction in which it faces the skin at rest. wall (w, 3): triangles; skin (w,): those not of the bag.
    resting: through and buried (k,) of the neutral pose, in mm.
    """

    kinds: tuple[str, ...]
    points: Int[np.ndarray, " k"]
    piece: Int[np.ndarray, " k"]
    kind: Int[np.ndarray, " k"]
    outward: Float[np.ndarray, "k 3"]
    wall: Int[np.ndarray, "w 3"]
    skin: Bool[np.ndarray, " w"]
    reach_mm: float
    neutral: Float[np.ndarray, "n 3"]
    resting: tuple[np.ndarray, np.ndarray]


def find_mouth(mesh: Mesh) -> Mouth | None:
    """Return a mesh's mouth, or None where no piece of its own is called tooth or teeth, or no skin is near it."""
    n = len(mesh.neutral)
    ends = mesh.faces.ravel(), np.roll(mesh.faces, 1, axis=1).ravel()
    _, piece = connected_components(sparse.coo_matrix((np.ones(len(ends[0])), ends), (n, n)), directed=False)
    outer = np.bincount(piece).argmax()
    kinds, kind = [], np.full(n, -1)
    for index in np.unique(piece[piece != outer]):
        members = piece == index
        name = mesh.segment_names[np.bincount(mesh.segment[members]).argmax()]
        label = next((label for start, label in KINDS.items() if name.startswith(start)), "gums_and_tongue")
        if label not in kinds:
            kinds.append(label)
        kind[members] = kinds.index(label)
    if "teeth" not in kinds:
        return None
    points = np.flatnonzero(kind >= 0)
    scale = float(np.ptp(mesh.neutral[:, 0])) / HEAD_WIDTH_MM
    x = mesh.neutral.astype(float)
    faces = mesh.faces[(piece[mesh.faces] == outer).all(1)]
    near, _ = cKDTree(x[points]).query(x[faces].mean(1))
    wall = faces[near < WALL_MM * scale]
    bag = np.array([name.startswith("mouth") for name in mesh.segment_names])[mesh.segment]
    skin = ~bag[wall].any(1)
    if not skin.any():
        return None
    outward = _outward(x, points, wall[skin])
    resting = np.zeros(len(points)), np.zeros(len(points))
    mouth = Mouth(tuple(kinds), points, piece[points], kind[points], outward, wall, skin, REACH_MM * scale, x, resting)
    at_rest = depths(mouth, mesh.neutral)
    for held, found in zip(resting, at_rest, strict=True):
        held[:] = found
    return mouth


def _outward(x: np.ndarray, points: np.ndarray, skin: np.ndarray) -> Float[np.ndarray, "k 3"]:
    """Return the mean normal of the outer skin that each vertex and its neighbours face: skin turned away from them."""
    normals, centres = face_normals(x, skin), x[skin].mean(1)
    distance, near = cKDTree(centres).query(x[points], min(64, len(skin)))
    towards = centres[near] - x[points][:, None]
    faces_out = (normals[near] * towards).sum(-1) > 0.5 * distance
    weight = np.where(faces_out, 1 / (1 + distance), 1e-9)
    own = (normals[near] * weight[..., None]).sum(1)
    own /= np.linalg.norm(own, axis=1, keepdims=True)
    _, around = cKDTree(x[points]).query(x[points], min(NEIGHBOURS, len(points)))
    mean = own[around].mean(1)
    return mean / np.linalg.norm(mean, axis=1, keepdims=True)


def depths(mouth: Mouth, vertices: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return how far each of the mouth's points is through the skin, and buried in the flesh, beyond its rest; mm."""
    posed = vertices.astype(float)
    at, corners = posed[mouth.points], posed[mouth.wall]
    outward = np.empty_like(mouth.outward)
    for index in np.unique(mouth.piece):
        members = mouth.piece == index
        turn, _ = align(mouth.neutral[mouth.points[members]], at[members])
        outward[members] = mouth.outward[members] @ turn
    share, cosine = ray_hits(at, -mouth.reach_mm * outward, corners, mouth.skin)
    behind = np.isfinite(share) & (cosine < -FACING)
    through = np.where(behind, np.where(behind, share, 0) * mouth.reach_mm * -cosine, 0.0)
    buried = np.maximum(-signed_distances(at, corners), 0)
    return np.maximum(through - mouth.resting[0], 0), np.maximum(buried - mouth.resting[1], 0)


def deepest(mouth: Mouth, depth_mm: Float[np.ndarray, " k"]) -> dict[str, float]:
    """Return the largest of some depths by kind: teeth, gums, tongue."""
    return {kind: float(depth_mm[mouth.kind == index].max()) for index, kind in enumerate(mouth.kinds)}
