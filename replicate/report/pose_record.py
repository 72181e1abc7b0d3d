"""One test pose as every method predicts it: chosen by a rule, and kept so small that it can be committed.

Figures and notebooks are drawn from this file, so they need neither a cache nor a trained network.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Bool, Float, Int

from replicate.approximation.evaluation import unique_poses
from replicate.engine.exceptions import InputError
from replicate.geometry.mesh import Mesh, face_normals

TRUTH = "truth"


@dataclass(frozen=True)
class PoseRecord:
    """A test pose of one character.

    pose: its index among the test poses. neutral: (n, 3) mm; faces: (f, 3). vertices: "truth" and each method's label →
    (n, 3) float32 mm. props: (name, vertices (k, 3), faces (g, 3), colour), for display only; the colour is (k, 3)
    uint8, one for each vertex, as `rig.pose_props` gives it, or one RGB, which is brought to 0–255.
    """

    character: str
    pose: int
    neutral: np.ndarray
    faces: np.ndarray
    vertices: dict[str, np.ndarray]
    props: tuple[tuple[str, np.ndarray, np.ndarray, np.ndarray | tuple[float, float, float]], ...] = ()

    def __post_init__(self) -> None:
        coloured = tuple(
            (name, vertices, faces, colour if np.ndim(colour) == 2 else colour_in_bytes(colour))
            for name, vertices, faces, colour in self.props
        )
        object.__setattr__(self, "props", coloured)


def colour_in_bytes(colour: Sequence[float]) -> tuple[int, int, int]:
    """Return a colour from 0 to 255; one whose parts are at most 1 is taken to be from 0 to 1."""
    scale = 255 if max(colour) <= 1 else 1
    return tuple(round(scale * float(channel)) for channel in colour)


def inner_edges(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "e 2"]]:
    """Return the edges that exactly two faces share, as (vertex pairs, face pairs); the first face runs a → b."""
    directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(faces)), 3)
    undirected = np.sort(directed, axis=1)
    order = np.lexsort((directed[:, 0] > directed[:, 1], undirected[:, 1], undirected[:, 0]))
    ordered = undirected[order]
    starts = np.flatnonzero(np.r_[True, (ordered[1:] != ordered[:-1]).any(1)])
    pairs = starts[np.diff(np.r_[starts, len(ordered)]) == 2]
    return ordered[pairs], np.stack([owner[order[pairs]], owner[order[pairs + 1]]], 1)


def fold_angles(
    vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"], edges: Int[np.ndarray, "e 2"],
    sides: Int[np.ndarray, "e 2"],
) -> Float[np.ndarray, "*b e"]:  # fmt: skip
    """Return the signed angle between the two faces of each inner edge in degrees; 0 is flat, ridges are positive."""
    normals = face_normals(vertices, faces)
    first, second = normals[..., sides[:, 0], :], normals[..., sides[:, 1], :]
    along = vertices[..., edges[:, 1], :] - vertices[..., edges[:, 0], :]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True).clip(1e-12)
    sine = (np.cross(first, second) * along).sum(-1)
    return np.degrees(np.arctan2(sine, (first * second).sum(-1)))


def most_wrinkled(
    mesh: Mesh, params: Float[np.ndarray, "t m"], offsets: Float[np.ndarray, "t n 3"], shown: Bool[np.ndarray, " f"],
    batch: int = 32,
) -> int:  # fmt: skip
    """Return the test pose that folds the shown faces most: the one that figures show, chosen from the truth alone.

    The measure is the mean, over the inner edges between shown faces and weighted by their neutral length, of how much
    the fold at the edge differs from the neutral one. Turning or moving the face does not change it. Of equal poses the
    first is taken. Raises InputError if no two shown faces share an edge.
    """
    edges, sides = inner_edges(mesh.faces)
    kept = shown[sides].all(-1)
    if not kept.any():
        raise InputError("most_wrinkled: no two of the shown faces share an edge; shown must hold a patch of the mesh.")
    edges, sides = edges[kept], sides[kept]
    # Only the patch is looked at: the test poses of a whole head need not be read into memory.
    used, inverse = np.unique(mesh.faces[sides].reshape(-1), return_inverse=True)
    number, face_pairs = np.full(len(mesh.neutral), -1), np.arange(2 * len(sides)).reshape(-1, 2)
    number[used] = np.arange(len(used))
    patch, edges = inverse.reshape(-1, 3), number[edges]
    neutral = mesh.neutral[used]
    rest = fold_angles(neutral, patch, edges, face_pairs)
    length = np.linalg.norm(neutral[edges[:, 1]] - neutral[edges[:, 0]], axis=-1)
    poses, folding = unique_poses(params), []
    for start in range(0, len(poses), batch):
        posed = neutral + np.stack([np.asarray(offsets[pose])[used] for pose in poses[start : start + batch]])
        change = np.abs(fold_angles(posed.astype(np.float32), patch, edges, face_pairs) - rest)
        folding.append((np.minimum(change, 360 - change) * length).sum(-1) / length.sum())
    return int(poses[np.argmax(np.concatenate(folding))])


def save_pose(path: Path, record: PoseRecord) -> None:
    """Write a record as npz: offsets as int16 with a step of a 65,534th of their range (about a micrometre)."""
    facts = {"character": record.character, "pose": record.pose, "labels": list(record.vertices), "props": []}
    arrays = {"neutral": record.neutral.astype(np.float32), "faces": record.faces.astype(np.int32)}
    offsets = np.stack([vertices - record.neutral for vertices in record.vertices.values()])
    step = float(max(np.abs(offsets).max(), 1e-6)) / 32767
    arrays["offsets"], facts["step_mm"] = np.rint(offsets / step).astype(np.int16), step
    for k, (name, vertices, faces, colour) in enumerate(record.props):
        arrays[f"prop_{k}_vertices"], arrays[f"prop_{k}_faces"] = np.float32(vertices), np.int32(faces)
        painted = np.ndim(colour) == 2
        if painted:
            arrays[f"prop_{k}_colours"] = np.asarray(colour, np.uint8)
        facts["props"].append([name, None if painted else list(colour)])
    arrays["facts"] = np.frombuffer(json.dumps(facts, sort_keys=True).encode(), np.uint8)
    beside = path.with_name(f".{path.name}.{os.getpid()}.npz")
    np.savez_compressed(beside, **arrays)
    os.replace(beside, path)


def load_pose(path: Path) -> PoseRecord:
    """Read what `save_pose` wrote. Raises InputError, naming the file, for anything else."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            facts = json.loads(bytes(stored["facts"]))
            neutral, faces = stored["neutral"], stored["faces"]
            offsets = stored["offsets"].astype(np.float32) * np.float32(facts["step_mm"])
            props = tuple(
                (
                    name,
                    stored[f"prop_{k}_vertices"],
                    stored[f"prop_{k}_faces"],
                    stored[f"prop_{k}_colours"] if colour is None else tuple(colour),
                )
                for k, (name, colour) in enumerate(facts["props"])
            )
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such pose; `make table2` makes it.") from None
    except (ValueError, KeyError, OSError, EOFError, BadZipFile) as error:
        raise InputError(f"{path}: found no pose as `make table2` writes it ({error}).") from None
    vertices = dict(zip(facts["labels"], neutral + offsets, strict=True))
    return PoseRecord(facts["character"], facts["pose"], neutral, faces, vertices, props)
