"""Sheets that bones move, alone or with folds and noise that they can't follow: for the tests of skinning."""

import numpy as np

from replicate.baselines.skinning.ssdr import Skin
from replicate.geometry.alignment import nearest_rotation


def sheet(side=16):
    """A curved sheet of side² vertices, 100 mm wide."""
    x, y = np.meshgrid(np.linspace(-50, 50, side), np.linspace(-50, 50, side), indexing="ij")
    return np.stack([x.ravel(), y.ravel(), 20 * np.cos(x / 30).ravel()], -1).astype(np.float32)


def known_skin(neutral, bones=4, sharpness=8.0, seed=0):
    """Weights that fall off from a few places on the mesh, so that all bones meet and each has a place of its own."""
    rng = np.random.default_rng(seed)
    centres = [0]
    for _ in range(bones - 1):
        distance = np.linalg.norm(neutral[:, None] - neutral[centres], axis=-1).min(1)
        centres.append(int(np.argmax(distance)))
    distance = np.linalg.norm(neutral[:, None] - neutral[centres], axis=-1) / 100
    weights = np.exp(-sharpness * distance)
    weights = np.maximum(weights / weights.sum(1, keepdims=True) - 0.05, 0)
    weights /= weights.sum(1, keepdims=True)
    index = np.broadcast_to(np.arange(bones), weights.shape).astype(np.int32)
    return Skin(neutral, index.copy(), weights.astype(np.float32), bones), rng


def moved(skin, rng, poses=24, angle=0.25, shift=6.0):
    """Return poses (poses, n, 3) of a skin whose bones turn and shift at random."""
    rotation = nearest_rotation(np.eye(3) + angle * rng.normal(size=(poses, skin.bones, 3, 3)))
    return skin.deform(rotation, shift * rng.normal(size=(poses, skin.bones, 3)))


def noisy_problem():
    """Return a sheet and its poses, with 1 mm of noise."""
    truth, rng = known_skin(sheet(), bones=6)
    return truth.neutral, moved(truth, rng) + rng.normal(size=(24, 256, 3)).astype(np.float32)


def grid_faces(side):
    """Return the faces of a sheet of side² vertices."""
    corner = np.array([i * side + j for i in range(side - 1) for j in range(side - 1)])
    lower = np.stack([corner, corner + side, corner + 1], 1)
    upper = np.stack([corner + 1, corner + side, corner + side + 1], 1)
    return np.concatenate([lower, upper]).astype(np.int32)


def wrinkled_sheet(side=16, poses=30, bones=5):
    """A skinned sheet with folds that no bone can make."""
    truth, rng = known_skin(sheet(side), bones=bones)
    fold = np.sin(truth.neutral[:, 0] / 4)[:, None] * np.array([0, 0, 1.0])
    amount = rng.random((poses, 1, 1)) * 2
    return truth.neutral, (moved(truth, rng, poses) + amount * fold).astype(np.float32), grid_faces(side)


def folded_sheet():
    """Return a sheet that one fold turns, two bones: vertices (96, 3), mm, poses (20, 96, 3), mm, and faces."""
    x, y = np.meshgrid(np.arange(12.0), np.arange(8.0))
    neutral = np.stack([10 * x.ravel(), 10 * y.ravel(), 0 * x.ravel()], 1).astype(np.float32)
    a = (np.arange(7)[:, None] * 12 + np.arange(11)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + 13], 1), np.stack([a, a + 13, a + 12], 1)]).astype(np.int32)
    angles = np.random.default_rng(3).uniform(-1, 1, 20)
    share = np.clip(neutral[:, 0] / 40 - 1, 0, 1)
    poses = np.repeat(neutral[None], 20, 0)
    poses[:, :, 2] += angles[:, None].astype(np.float32) * share * (neutral[:, 0] - 55)
    return neutral, poses.astype(np.float32), faces
