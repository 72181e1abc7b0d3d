"""A clip as glTF: each part gets morph targets, and one animation drives their weights."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from replicate.engine.progress import progress
from replicate.export.files import MM_PER_M, glb
from replicate.export.low_rank import follow, low_rank
from replicate.export.parts import Part, unit_normals

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

    rest: the parts in the neutral pose; frames: each part's vertices (t, n, 3) in mm. No vertex of a frame is further
    from where it belongs than the tolerance.
    """
    tracks = []
    with progress(len(rest), "morph targets") as bar:
        for part, positions in zip(rest, frames, strict=True):
            tracks.append(_track(part, positions, tolerance_mm))
            bar.update(1)

    def finish(buffers, tree) -> None:
        own = {part.name: track for part, track in zip(rest, tracks, strict=True)}
        _Writer(buffers, tree).animate(own, frames_per_second)

    return glb(rest, about, finish), tracks


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
        """Append an array as a buffer and an accessor of its own; return the accessor's index."""
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
