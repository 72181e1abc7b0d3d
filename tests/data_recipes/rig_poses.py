"""Poses that put every part of a rig to work."""

import numpy as np

from data_recipes.rig import Rig
from replicate.approximation.sampling import augment
from replicate.geometry.mesh import Mesh


def augmented_poses(rig: Rig, count: int, seed: int = 0) -> np.ndarray:
    """Eq. 5 with clips of the rig's own: animation values times U(0.25, 3)."""
    generator = np.random.default_rng(seed)
    poses = np.concatenate([clip.values for clip in rig.clips])
    return poses[generator.integers(0, len(poses), count)] * generator.uniform(0.25, 3, (count, poses.shape[1]))


MOVES = {"brow_inner_up": 1, "smile": 0.8, "jaw_open": 0.7, "squint": 1, "blink": 0.6, "squash": 0.5, "nose_wrinkle": 1}


def strained_pose(rig: Rig) -> np.ndarray:
    """A pose in which every node has something to do, some controls beyond their limits, as a batch of one."""
    p = np.array([next((v for n, v in MOVES.items() if c.name.startswith(n)), 0.0) for c in rig.controls])
    p += [2.5 * c.name.endswith("_x") + 0.8 * c.name.startswith(("lips_together", "sticky")) for c in rig.controls]
    return p[None].astype(np.float32)


def skin_faces(mesh: Mesh) -> np.ndarray:
    names = ("face", "cranium", "neck", "ear_left", "ear_right", "ears")
    skin = [i for i, name in enumerate(mesh.segment_names) if name in names]
    return mesh.faces[np.isin(mesh.segment[mesh.faces], skin).all(axis=1)]


def flipped_share(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The share of faces whose normal is more than 90° from the area-weighted normal of the faces around them."""
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    at_vertex = np.stack([np.bincount(faces.ravel(), np.repeat(normal[:, d], 3), len(vertices)) for d in range(3)], 1)
    return float(((at_vertex[faces].sum(axis=1) - 3 * normal) * normal).sum(axis=1).__lt__(0).mean())


def pose_of(rig, **amounts):
    columns = {control.name: column for column, control in enumerate(rig.controls)}
    values = rig.default.copy()
    for name, amount in amounts.items():
        for one in (name,) if name in columns else (f"{name}_L", f"{name}_R"):
            values[columns[one]] = amount
    return values


def exaggerated_poses(rig, count, seed=0):
    return augment(np.concatenate([clip.values for clip in rig.clips]), count, np.random.default_rng(seed))


def chart_areas(uv, faces):
    """Twice each chart triangle's signed area."""
    a, b, c = (uv[faces[:, k]] for k in range(3))
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
