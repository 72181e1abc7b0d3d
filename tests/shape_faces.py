"""Small faces of shapes for tests: a sheet as large as a face, split along a seam, with eyes and a body beside it."""

from pathlib import Path

import numpy as np
from gltf_writer import Gltf

from data_recipes.rig import Rig

ARKIT = (
    "browInnerUp", "browDownLeft", "browDownRight", "eyeBlinkLeft", "eyeBlinkRight", "jawOpen", "jawLeft", "jawRight",
    "mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft", "mouthFrownRight", "mouthPucker", "cheekPuff", "tongueOut",
)  # fmt: skip
ROWS, COLUMNS = 12, 9
METRES = 0.001


def half(x0: float, x1: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (mm) and triangles of one half of the sheet."""
    x, y = np.meshgrid(np.linspace(x0, x1, COLUMNS), np.linspace(-90, 90, ROWS))
    i = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    quads = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]], -1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return np.stack([x, y, 20 * np.cos(x / 40)], -1).reshape(-1, 3), faces


def split_sheet() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices (mm), triangles and texture coordinates of a sheet that has the vertices of its seam twice."""
    (left, faces), (right, others) = half(-70, 0), half(0, 70)
    u = np.concatenate([0.45 * (left[:, 0] + 70) / 70, 0.55 + 0.45 * right[:, 0] / 70])
    vertices = np.concatenate([left, right])
    v = 1 - (vertices[:, 1] + 90) / 180
    return vertices, np.concatenate([faces, others + len(left)]), np.stack([u, v], 1)


def shapes_of(vertices: np.ndarray, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return a smooth shape (mm) for each name, in another place for each."""
    rng = np.random.default_rng(0)
    shapes = {}
    for name in names:
        centre, way = rng.uniform(-1, 1, 2) * [50, 70], rng.normal(0, 6, 3)
        reach = ((vertices[:, :2] - centre) ** 2).sum(1)
        shapes[name] = np.exp(-reach / (2 * 25**2))[:, None] * way
    return shapes


def turn_round(g: Gltf, nodes: list[int]) -> list[int]:
    """Make a file a VRM 0.x, whose face looks along −z; return its root above some nodes."""
    g.tree["extensions"] = {"VRM": {}}
    return [g.add("nodes", name="Armature", rotation=[0, 1, 0, 0], children=nodes)]


def write_face(
    file: Path, names: tuple[str, ...] = ARKIT, looks_back: bool = False, **mesh: object
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Write a GLB of the sheet with eyes that stand still and a far body; return its vertices and shapes, mm.

    looks_back: as a VRM 0.x does.
    """
    g = Gltf(scene=0)
    vertices, faces, uv = split_sheet()
    shapes = shapes_of(vertices, names)
    targets = [{"POSITION": g.numbers(METRES * shape)} for shape in shapes.values()]
    head = g.primitive(METRES * vertices, faces, attributes={"TEXCOORD_0": g.numbers(uv)}, targets=targets)
    nodes = [g.show(head, mesh={"extras": {"targetNames": list(names)}, **mesh}, name="Head")]
    ball, quads = half(-8, 8)
    for name, place in (("EyeLeft", (30, 30, 10)), ("Body", (0, -900, 0))):
        nodes.append(g.show(g.primitive(METRES * (ball + place), quads), name=name))
    g.add("scenes", nodes=turn_round(g, nodes) if looks_back else nodes)
    file.write_bytes(g.glb())
    return vertices, shapes


def worst_linear_mm(rig: Rig, poses: np.ndarray, shapes: np.ndarray) -> float:
    """Return how far the rig is from the neutral and the weighted sum of shapes (m, n, 3), at most."""
    return float(np.abs(rig(poses) - rig.mesh.neutral - np.tensordot(poses - rig.default, shapes, 1)).max())
