"""How far teeth, gums and tongue come through the skin, instead of staying in the mouth.

The face and the mouth bag are one surface; teeth, gums and tongue are separate pieces that lie in the bag. A vertex of
theirs has come *through* when it lies in front of outer skin, where it can be seen. Then a ray from it back into the
head, against its outward direction, meets skin that faces outwards as well. The outward direction is that in which the
vertex faces lips, cheek or chin at rest, and turns with its piece. The depth is the distance to that skin's plane, in
mm beyond what it is at rest. Through an open mouth the ray meets no skin. Pieces behind the skin, in the bag or in its
wall, are ignored: nobody sees them.

A tongue may loll over a lip, and then lies in front of skin without having come through it. It has come through where
skin separates its front from its root, so that no way along its edges leads back without crossing skin.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from replicate.geometry.alignment import align
from replicate.geometry.mesh import Mesh, edges, face_normals
from replicate.geometry.rays import ray_hits

HEAD_WIDTH_MM = 188.0  # the lengths below are for a head of this width, and scale with it
NEAR_MM = 30.0  # skin farther from the pieces is ignored
REACH_MM = 25.0  # how far back a ray looks for skin
FACING = 0.3  # cosine above which skin faces the ray's way
NEIGHBOURS = 24  # of a vertex, whose directions are averaged
SKIN_NEAR = 64  # nearest triangles of skin, which a vertex may face
LOLLS = "tongue"
KINDS = {"tooth": "teeth", "teeth": "teeth", "gum": "gums", "tongue": "tongue"}  # by the beginning of a segment's name
GUM_MM = 5.0  # from a vertex of a gum to the nearest tooth, in the median; a tongue's are further away


@dataclass(frozen=True)
class Mouth:
    """The pieces in a mesh's mouth, and the skin around them.

    kinds: of the pieces: teeth, gums, tongue
    points: vertices of all pieces
    piece: the piece of each point
    kind: the kind of each point, as an index in `kinds`
    outward: the direction in which each point faces the skin at rest
    skin: triangles of the outer skin near the pieces
    lolling: edges of the tongue, as indices in `points`
    reach_mm: how far back a ray looks for skin
    neutral: the mesh's neutral vertices, mm
    resting: depths of the points in the neutral pose, mm
    """

    kinds: tuple[str, ...]
    points: Int[np.ndarray, " k"]
    piece: Int[np.ndarray, " k"]
    kind: Int[np.ndarray, " k"]
    outward: Float[np.ndarray, "k 3"]
    skin: Int[np.ndarray, "s 3"]
    lolling: Int[np.ndarray, "e 2"]
    reach_mm: float
    neutral: Float[np.ndarray, "n 3"]
    resting: Float[np.ndarray, " k"]


def find_mouth(mesh: Mesh) -> Mouth | None:
    """Return a mesh's mouth, or None where no separate piece is called tooth or teeth, or no skin is near it."""
    n = len(mesh.neutral)
    ends = mesh.faces.ravel(), np.roll(mesh.faces, 1, axis=1).ravel()
    _, piece = connected_components(sparse.coo_matrix((np.ones(len(ends[0])), ends), (n, n)), directed=False)
    outer = np.bincount(piece).argmax()
    x, scale = mesh.neutral.astype(float), float(np.ptp(mesh.neutral[:, 0])) / HEAD_WIDTH_MM
    is_tooth = np.array([KINDS.get(name[:5]) == "teeth" for name in mesh.segment_names])[mesh.segment]
    kinds, kind = [], np.full(n, -1)
    for index in np.unique(piece[piece != outer]):
        members = piece == index
        name = mesh.segment_names[np.bincount(mesh.segment[members]).argmax()]
        label = next((label for start, label in KINDS.items() if name.startswith(start)), None)
        if is_tooth.any() and (name.startswith("mouth") or ("gum" in name and "tongue" in name)):  # both may be in it
            away, _ = cKDTree(x[is_tooth]).query(x[members])
            label = "gums" if np.median(away) < GUM_MM * scale else "tongue"
        if label is None:  # frills, say
            continue
        if label not in kinds:
            kinds.append(label)
        kind[members] = kinds.index(label)
    if "teeth" not in kinds:
        return None
    points = np.flatnonzero(kind >= 0)
    faces = mesh.faces[(piece[mesh.faces] == outer).all(1)]
    near, _ = cKDTree(x[points]).query(x[faces].mean(1))
    bag = np.array([name.startswith("mouth") for name in mesh.segment_names])[mesh.segment]
    skin = faces[(near < NEAR_MM * scale) & ~bag[faces].any(1)]
    if not len(skin):
        return None
    outward, zero = _outward(x, points, skin), np.zeros(len(points))
    lolling = _edges_between(mesh.faces, points, np.array(kinds)[kind[points]] == LOLLS)
    mouth = Mouth(tuple(kinds), points, piece[points], kind[points], outward, skin, lolling, REACH_MM * scale, x, zero)
    return replace(mouth, resting=depths(mouth, mesh.neutral))


def _edges_between(faces: np.ndarray, points: np.ndarray, inside: np.ndarray) -> Int[np.ndarray, "e 2"]:
    """Return the edges whose ends are both among some of the points, as indices in `points`."""
    index = np.full(faces.max() + 1, -1)
    index[points[inside]] = np.flatnonzero(inside)
    pairs = index[edges(faces)]
    return pairs[(pairs >= 0).all(1)]


def _outward(x: np.ndarray, points: np.ndarray, skin: np.ndarray) -> Float[np.ndarray, "k 3"]:
    """Return the mean normal of the outer skin, turned away from them, that each vertex and its neighbours face."""
    normals, centres = face_normals(x, skin), x[skin].mean(1)
    tree, faced = cKDTree(centres), np.zeros((len(points), 3))
    rest, count = np.arange(len(points)), SKIN_NEAR
    while len(rest):  # where the lining of the lips is all that is near, farther triangles are tried
        distance, near = tree.query(x[points[rest]], min(count, len(skin)))
        towards = centres[near] - x[points[rest]][:, None]
        faces_out = (normals[near] * towards).sum(-1) > 0.5 * distance
        weight = np.where(faces_out, 1 / (1 + distance), 1e-9)
        faced[rest] = (normals[near] * weight[..., None]).sum(1)
        rest, count = rest[~faces_out.any(1)] if count < len(skin) else rest[:0], 2 * count
    faced /= np.linalg.norm(faced, axis=1, keepdims=True)
    _, around = cKDTree(x[points]).query(x[points], min(NEIGHBOURS, len(points)))
    mean = faced[around].mean(1)
    return mean / np.linalg.norm(mean, axis=1, keepdims=True)


def depths(mouth: Mouth, vertices: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " k"]:
    """Return how far each of the mouth's points is through the skin, beyond its resting depth, mm."""
    posed = vertices.astype(float)
    at = posed[mouth.points]
    outward = np.empty_like(mouth.outward)
    for index in np.unique(mouth.piece):
        members = mouth.piece == index
        turn, _ = align(mouth.neutral[mouth.points[members]], at[members])
        outward[members] = mouth.outward[members] @ turn
    share, cosine = ray_hits(at, -mouth.reach_mm * outward, posed[mouth.skin])
    behind = np.isfinite(share) & (cosine < -FACING)
    through = np.where(behind, np.where(behind, share, 0) * mouth.reach_mm * -cosine, 0.0)
    through = np.maximum(through - mouth.resting, 0)
    through[_lolling_over(mouth, posed, through)] = 0
    return through


def _lolling_over(mouth: Mouth, posed: np.ndarray, through: np.ndarray) -> Bool[np.ndarray, " k"]:
    """Return which points are in front of the skin but still joined, past no skin, to a part that is behind it."""
    out = through > 0
    if not len(mouth.lolling) or not out[mouth.lolling].any():
        return np.zeros(len(out), bool)
    start, end = posed[mouth.points[mouth.lolling.T]]
    hits, _ = ray_hits(start, end - start, posed[mouth.skin])
    a, b = mouth.lolling[~np.isfinite(hits)].T
    _, part = connected_components(sparse.coo_matrix((np.ones(len(a)), (a, b)), (len(out), len(out))), directed=False)
    tongue = np.unique(mouth.lolling)
    behind = np.bincount(part[tongue], ~out[tongue])
    return out & (part == behind.argmax()) if behind.max() else np.zeros(len(out), bool)


def deepest(mouth: Mouth, depth_mm: Float[np.ndarray, " k"]) -> dict[str, float]:
    """Return the largest of some depths by kind: teeth, gums, tongue."""
    return {kind: float(depth_mm[mouth.kind == index].max()) for index, kind in enumerate(mouth.kinds)}
