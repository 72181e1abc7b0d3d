"""What Blender needs to know of a head of ours, as a file: its mesh and charts, and where Rigify's joints go."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from data_recipes.head.neutral_head import Eye, Head
from data_recipes.rigify.head_joints import Joints, fit_joints

HANGING = 0.5  # the share of the mouth's bag that follows the lips, less and less
BETWEEN_JAWS_MM = 24.0  # the height over which the bag goes from the lower teeth to the upper ones
EYE_ROWS, EYE_COLUMNS = 14, 24  # of an eyeball's vertices


def write_head_file(head: Head, metarig: Joints, path: Path) -> None:
    """Write vertices (mm), triangles, places in the charts, labels and joints of a head, with two eyeballs, as .npz.

    A triangle has the label of the segment that most of its corners belong to.
    """
    corners = head.segment[head.faces]
    most = np.where(corners[:, 1] == corners[:, 2], corners[:, 1], corners[:, 0])
    labels = [head.segment_names[i] for i in most]
    vertices, faces, uv, parts = [head.vertices], [head.faces], [head.uv], [np.array(head.part_names)[head.part]]
    for side, eye in head.eyes.items():
        places, triangles, charts = eyeball(eye)
        faces.append(triangles + sum(map(len, vertices)))
        vertices.append(places)
        uv.append(charts)
        parts.append(np.full(len(places), f"eye_{side}"))
        labels += [f"eye_{side}"] * len(triangles)
    joints = fit_joints(head, metarig)
    np.savez(
        path,
        vertices_mm=np.concatenate(vertices),
        faces=np.concatenate(faces),
        uv=np.concatenate(uv),
        parts=np.concatenate(parts),
        labels=np.array(labels),
        bag=mouth_bag(head),
        joint_names=np.array(list(joints)),
        joints_mm=np.array(list(joints.values())),
    )


def mouth_bag(head: Head) -> Float[np.ndarray, "k 4"]:
    """Return how the mouth's bag hangs on the lips and the teeth, a vertex a row.

    Columns: the vertex; the lip's vertex it hangs on; how much it follows that one; how much of the rest goes with the
    upper teeth.
    """
    x, rings, seam = head.vertices, head.grids["mouth_bag"], head.grids["mouth"][0]
    own = np.flatnonzero(np.array(head.part_names)[head.part] == "mouth_bag")
    share, lip = np.zeros(len(x)), np.full(len(x), seam[0])
    for number, ring in enumerate(rings):
        share[ring] = np.interp(number / (len(rings) - 1), [0, HANGING], [1.0, 0.0])
        lip[ring] = seam
    upper = np.clip((x[:, 1] - x[seam, 1].mean()) / BETWEEN_JAWS_MM + 0.5, 0.0, 1.0)
    return np.stack([own, lip[own], share[own], upper[own]], axis=1)


def eyeball(eye: Eye) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "f 3"], Float[np.ndarray, "k 2"]]:
    """Return the vertices (mm), triangles and chart of a ball with its poles in front and behind; behind it is open."""
    turn = np.linspace(0, 2 * np.pi, EYE_COLUMNS, endpoint=False)
    away = np.linspace(0, 0.8 * np.pi, EYE_ROWS)[1:]  # radians from the gaze
    a, t = (grid.ravel() for grid in np.meshgrid(away, turn, indexing="ij"))
    rings = np.stack([np.sin(a) * np.cos(t), np.sin(a) * np.sin(t), np.cos(a)], -1)
    local = np.concatenate([[[0.0, 0, 1]], rings])
    flat = (a / (0.8 * np.pi))[:, None] * np.stack([np.cos(t), np.sin(t)], -1)
    uv = 0.5 + 0.49 * np.concatenate([[[0.0, 0]], flat])
    i, j = np.meshgrid(np.arange(len(away) - 1), np.arange(EYE_COLUMNS), indexing="ij")
    k = (j + 1) % EYE_COLUMNS
    a, b, c, d = (1 + row * EYE_COLUMNS + column for row, column in ((i, j), (i, k), (i + 1, j), (i + 1, k)))
    first = np.arange(EYE_COLUMNS)
    cap = np.stack([np.zeros_like(first), 1 + first, 1 + (first + 1) % EYE_COLUMNS], -1)
    quads = [np.stack(corners, -1).reshape(-1, 3) for corners in ((a, c, d), (a, d, b))]
    faces = np.concatenate([cap, *quads])
    places = eye.centre + eye.radius * local @ eye.frame
    return places, _outwards(places - eye.centre, faces), uv


def _outwards(places: Float[np.ndarray, "k 3"], faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f 3"]:
    """Return triangles in the order in which they face away from the origin."""
    a, b, c = places[faces].transpose(1, 0, 2)
    inwards = np.einsum("fk,fk->f", np.cross(b - a, c - a), a) < 0
    return np.where(inwards[:, None], faces[:, [0, 2, 1]], faces)
