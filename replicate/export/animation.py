"""A clip as glTF: each part gets morph targets, and one animation drives their weights."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64

from replicate.base.progress import progress
from replicate.export.files import MM_PER_M, Part, glb, unit_normals

FRAMES_PER_SECOND = 24
_FLOAT = 5126  # glTF's number for 32-bit floating point
_COLUMNS = {"SCALAR": 1, "VEC3": 3}


@dataclass(frozen=True)
class Track:
    """How a part moves: weights (t, k), and k morph targets of its vertices (mm) and of its normals, (k, n, 3) each."""

    weights: Float32[np.ndarray, "t k"]
    shapes: Float32[np.ndarray, "k n 3"]
    normals: Float32[np.ndarray, "k n 3"]
    error_mm: float


def animated_glb(
    rest: Sequence[Part],
    frames: Sequence[Float32[np.ndarray, "t _ 3"]],
    about: dict,
    tolerance_mm: float,
    frames_per_second: float = FRAMES_PER_SECOND,
) -> tuple[bytes, list[Track]]:
    """Return a GLB that plays a clip, and each part's track.

    rest: the parts in the neutral pose
    frames: each part's vertices (t, n, 3), mm
    about: words for the scene's extras
    tolerance_mm: how far a vertex of any frame may be off
    frames_per_second: of the clip
    """
    tracks = tracks_of(rest, frames, tolerance_mm)

    def finish(buffers, tree) -> None:
        by_name = {part.name: track for part, track in zip(rest, tracks, strict=True)}
        _Writer(buffers, tree).animate(by_name, frames_per_second)

    return glb(rest, about, finish), tracks


def tracks_of(rest: Sequence[Part], frames: Sequence[Float32[np.ndarray, "t _ 3"]], tolerance_mm: float) -> list[Track]:
    """Return each part's track in a clip; arguments as those of `animated_glb`."""
    tracks = []
    with progress(len(rest), "shapes of parts") as bar:
        for part, positions in zip(rest, frames, strict=True):
            tracks.append(_track(part, positions, tolerance_mm))
            bar.update(1)
    return tracks


def _track(part: Part, positions: np.ndarray, tolerance_mm: float) -> Track:
    """Return a part's track. Normals follow the weights of the positions, by least squares."""
    fit = low_rank(positions - part.vertices, tolerance_mm)
    if not len(fit.shapes):
        return Track(fit.weights, fit.shapes, fit.shapes, fit.error_mm)
    normals = follow(fit.weights, unit_normals(positions, part.faces) - part.normals)
    return Track(fit.weights, fit.shapes, normals, fit.error_mm)


class _Writer:
    """Adds arrays to the buffers and the tree of a file that trimesh is about to join."""

    def __init__(self, buffers, tree: dict):
        self.buffers, self.tree = buffers, tree

    def animate(self, tracks: dict[str, Track], frames_per_second: float) -> None:
        """Give every part that moves its targets, a sampler and a channel; all share the frames' times."""
        length = max(len(track.weights) for track in tracks.values())
        times = self.add(np.arange(length, dtype=np.float32) / np.float32(frames_per_second), "SCALAR")
        samplers, channels = [], []
        for index, mesh in enumerate(self.tree["meshes"]):
            track = tracks[mesh["name"]]
            count = len(track.shapes)
            if not count:
                continue
            metres = track.shapes / np.float32(MM_PER_M)
            for primitive in mesh["primitives"]:
                primitive["targets"] = [
                    {"POSITION": self.add(metres[k], "VEC3"), "NORMAL": self.add(track.normals[k], "VEC3")}
                    for k in range(count)
                ]
            mesh["weights"] = [0.0] * count  # the neutral pose, for programs that play no animation
            mesh["extras"] = mesh.get("extras", {}) | {"targetNames": [f"shape_{k:03d}" for k in range(count)]}
            samplers.append(
                {"input": times, "output": self.add(track.weights.reshape(-1), "SCALAR"), "interpolation": "LINEAR"}
            )
            for node, about in enumerate(self.tree["nodes"]):
                if about.get("mesh") == index:
                    target = {"node": node, "path": "weights"}
                    channels.append({"sampler": len(samplers) - 1, "target": target})
        if channels:
            self.tree["animations"] = [{"name": "clip", "samplers": samplers, "channels": channels}]

    def add(self, array: np.ndarray, kind: str) -> int:
        """Append an array as a buffer with an accessor; return the accessor's index."""
        key = ("clip", len(self.buffers))
        self.buffers[key] = np.ascontiguousarray(array, "<f4").tobytes()  # whole words, so that the next is aligned
        rows = array.reshape(-1, _COLUMNS[kind]).astype(np.float32)
        self.tree["accessors"][key] = {
            "bufferView": len(self.buffers) - 1,
            "byteOffset": 0,
            "componentType": _FLOAT,
            "count": len(rows),
            "type": kind,
            "min": rows.min(0).tolist(),
            "max": rows.max(0).tolist(),
        }
        return len(self.tree["accessors"]) - 1


# A clip as few shapes and their weights: a small basis that keeps every vertex within a stated distance.

PASSES = 2  # fits of one size, each with the vertices weighted by how far off the last one was
STEP = 1 / 16  # sizes closer than this share count as equal: another fit costs more than it saves
LEAST_WEIGHT = 0.03  # of a vertex that is exact, so that it stays exact
LEFT_OUT = 1 / 4  # of the tolerance: how far frames may be from those that fits are sought in
CHUNK_FLOATS = 4_000_000


@dataclass(frozen=True)
class LowRank:
    """Offsets (t, n, 3) ≈ weights (t, k) · shapes (k, n, 3), mm; weights within [-1, 1]; largest error in mm."""

    weights: Float32[np.ndarray, "t k"]
    shapes: Float32[np.ndarray, "k n 3"]
    error_mm: float


def low_rank(offsets: Float32[np.ndarray, "t n 3"], tolerance_mm: float) -> LowRank:
    """Return a factorisation in which no vertex of any frame is further off than the tolerance (mm, above 0)."""
    t, n, _ = offsets.shape
    nothing = np.zeros((t, 0), np.float32), np.zeros((0, n, 3), np.float32)
    still = float(_errors(offsets, *nothing).max())
    if still <= tolerance_mm:
        return LowRank(*nothing, still)
    basis, scale = _basis(offsets, LEFT_OUT * tolerance_mm), np.ones(n)
    inside = (basis.T.astype(np.float32) @ offsets.reshape(t, -1)).reshape(-1, n, 3)
    low, most = 0, basis.shape[1]
    high = min(8, most)
    while True:
        best, scale = _fit(offsets, basis, inside, high, scale)
        if best.error_mm <= tolerance_mm or high == most:
            break
        low, high = high, min(2 * high, most)
    while high - low > max(1, STEP * high):
        middle = (low + high) // 2
        trial, scale = _fit(offsets, basis, inside, middle, scale)
        if trial.error_mm <= tolerance_mm:
            best, high = trial, middle
        else:
            low = middle
    return best


def follow(weights: Float32[np.ndarray, "t k"], values: Float32[np.ndarray, "t n 3"]) -> Float32[np.ndarray, "k n 3"]:
    """Return the shapes (k, n, 3) that, with these weights, come closest to other values (normals, say) of the clip."""
    solve = np.linalg.pinv(weights.astype(np.float64)).astype(np.float32)
    return (solve @ values.reshape(len(values), -1)).reshape(weights.shape[1], *values.shape[1:])


def _basis(offsets: np.ndarray, tolerance_mm: float) -> Float64[np.ndarray, "t r"]:
    """Return orthonormal directions in which all frames lie, but for the tolerance: far fewer than there are frames."""
    t, n, _ = offsets.shape
    values, directions = np.linalg.eigh(_gram(offsets, np.ones(n)))
    values, directions = np.maximum(values[::-1], 0.0), directions[:, ::-1]  # largest first
    left = values.sum() - np.cumsum(values)  # squares of what is left out, summed over the frames
    most = min(t, 3 * n)
    r = int(np.searchsorted(-left, -t * tolerance_mm**2)) + 1
    while True:
        r = min(r, most)
        basis = directions[:, :r]
        shapes = basis.T.astype(np.float32) @ offsets.reshape(t, -1)
        if r == most or _errors(offsets, basis.astype(np.float32), shapes.reshape(r, n, 3)).max() <= tolerance_mm:
            return basis
        r *= 2


def _fit(
    offsets: np.ndarray,
    basis: Float64[np.ndarray, "t r"],
    inside: Float32[np.ndarray, "r n 3"],
    k: int,
    scale: Float[np.ndarray, " n"],
) -> tuple[LowRank, Float[np.ndarray, " n"]]:
    """Return the best fit of rank k and the vertices' next weights.

    offsets: (t, n, 3) mm
    basis: that the fit's weights are sought in
    inside: the offsets along it, mm
    k: 1 to r
    scale: the vertices' weights to begin with
    """
    t, n, _ = offsets.shape
    best = None
    for _ in range(PASSES):
        directions = basis @ np.linalg.eigh(_gram(inside, scale))[1][:, : -k - 1 : -1]  # (t, k), largest first
        shapes = np.ascontiguousarray(directions.T.astype(np.float32)) @ offsets.reshape(t, -1)
        size = np.abs(directions).max(0)
        weights = (directions / size).astype(np.float32)
        shapes = (shapes * size[:, None].astype(np.float32)).reshape(k, n, 3)
        errors = _errors(offsets, weights, shapes)
        if best is None or errors.max() < best.error_mm:
            best = LowRank(weights, shapes, float(errors.max()))
        scale = scale * np.sqrt(np.maximum(errors / max(errors.max(), 1e-12), LEAST_WEIGHT**2))
        scale = scale / scale.max()
    return best, scale


def _gram(offsets: np.ndarray, scale: Float[np.ndarray, " n"]) -> Float64[np.ndarray, "t t"]:
    """Return the products of the rows, with weighted vertices; in double precision, since its roots are needed."""
    t, n, _ = offsets.shape
    gram = np.zeros((t, t))
    step = max(1, CHUNK_FLOATS // (3 * t))
    for first in range(0, n, step):
        part = offsets[:, first : first + step] * scale[first : first + step, None]  # float64
        part = part.reshape(t, -1)
        gram += part @ part.T
    return gram


def _errors(offsets: np.ndarray, weights: np.ndarray, shapes: np.ndarray) -> Float64[np.ndarray, " n"]:
    """Return each vertex's largest distance (mm) over the frames, in single precision, as a viewer adds them up."""
    t, n, _ = offsets.shape
    worst = np.zeros(n)
    flat = shapes.reshape(len(shapes), 3 * n)
    step = max(1, CHUNK_FLOATS // (3 * n))
    for first in range(0, t, step):
        part = offsets[first : first + step]
        off = part - (weights[first : first + step] @ flat).reshape(part.shape)
        worst = np.maximum(worst, np.sqrt((off.astype(np.float64) ** 2).sum(-1)).max(0))
    return worst
