"""Texture coordinates that are off: how well the charts of two meshes have to be aligned (§6).

In the paper they "are manually aligned to those of the original mesh". A hand is off by something, so charts are moved
here on purpose. What leaves a chart is put on its border, where maps end.
"""

from dataclasses import replace

import numpy as np

from replicate.geometry.mesh import Mesh


def shifted(mesh: Mesh, shift: float, rng: np.random.Generator) -> Mesh:
    """Return the mesh with each segment's texture coordinates shifted in a random direction.

    shift: by how much, in widths of a chart; a pixel of a map of `size` pixels is 1 / (size − 1).
    """
    angles = rng.uniform(0, 2 * np.pi, len(mesh.segment_names))
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return _with_uv(mesh, mesh.uv + shift * directions[mesh.segment])


def turned(mesh: Mesh, angle_deg: float, rng: np.random.Generator) -> Mesh:
    """Return the mesh with each segment's texture coordinates turned about the middle of its chart, either way round.

    The middle is that of the coordinates' extent.
    """
    signs = rng.choice([-1.0, 1.0], len(mesh.segment_names))
    uv = mesh.uv.astype(np.float64)
    for k, sign in enumerate(signs):
        own = mesh.segment == k
        middle = (uv[own].min(0) + uv[own].max(0)) / 2
        angle = np.radians(sign * angle_deg)
        rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        uv[own] = (uv[own] - middle) @ rotation + middle
    return _with_uv(mesh, uv)


def _with_uv(mesh: Mesh, uv: np.ndarray) -> Mesh:
    return replace(mesh, uv=np.clip(uv, 0, 1).astype(np.float32))
