"""Marks on a mesh: balls at points, rings around places, the edges of its faces."""

import numpy as np
from jaxtyping import Float, Int, UInt8

from replicate.drawing.scene import WHITE, Camera, Surface, axes, project
from replicate.geometry.mesh import face_normals

RED, RADIUS_MM = (214, 39, 40), 1.7  # of a control point


def balls(points: Float[np.ndarray, "c 3"], radius_mm: float) -> Surface:
    """Return small red balls about some points, as one surface."""
    rings, around = np.linspace(0, np.pi, 7), np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ball = np.stack(
        [
            np.sin(rings)[:, None] * np.cos(around),
            np.sin(rings)[:, None] * np.sin(around),
            np.cos(rings)[:, None] + 0 * around,
        ],
        axis=-1,
    ).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(6) * 12, np.arange(12), indexing="ij")
    a, b = (row + column).ravel(), (row + (column + 1) % 12).ravel()
    faces = np.concatenate([np.stack([a, a + 12, b], 1), np.stack([b, a + 12, b + 12], 1)])
    vertices = (points[:, None] + radius_mm * ball).reshape(-1, 3)
    every = (faces[None] + len(ball) * np.arange(len(points))[:, None, None]).reshape(-1, 3)
    return Surface(vertices.astype(np.float32), every.astype(np.int32), RED, lit=False, framed=False)


def balls_in_front(
    points: Float[np.ndarray, "c 3"], vertices: Float[np.ndarray, "n 3"], radius_mm: float = RADIUS_MM
) -> Surface:
    """Return balls moved along the view in front of a face, so that none is hidden.

    Depth plays no part in posing (§5.3.1). vertices: of the face, mm.
    """
    front = float(vertices[:, 2].max()) + radius_mm
    return balls(np.concatenate([points[:, :2], np.full((len(points), 1), front)], axis=1), radius_mm)


# Rings around places of a picture that would be too small to see without them.

REACH = 0.09  # places nearer to one another than this share of the picture's width share a ring
ROOM = 0.035  # between a ring and the places in it, as a share of the width
LINE = 0.012  # the width of a ring's line, and of the white one around it


def ringed(
    picture: UInt8[np.ndarray, "h w 3"],
    places_mm: Float[np.ndarray, "k 3"],
    camera: Camera,
    colour: tuple[int, int, int],
) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture with rings around places of its scene; near ones share a ring, and those outside have none.

    A place that is hidden has a ring too.
    """
    height, width = picture.shape[:2]
    pixels, _ = project(np.asarray(places_mm, float).reshape(-1, 3), camera, width, height)
    pixels = pixels[((pixels > 0) & (pixels < (width, height))).all(1)]
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    picture, line = picture.copy(), max(1.0, LINE * width)
    rings = []
    while len(pixels):
        near = np.linalg.norm(pixels - pixels[0], axis=1) < REACH * width
        middle = pixels[near].mean(0)
        rings.append((middle, np.linalg.norm(pixels[near] - middle, axis=1).max() + ROOM * width))
        pixels = pixels[~near]
    for wide, paint in ((3 * line, WHITE), (line, colour)):  # all of the white first: no ring cuts another one
        for middle, radius in rings:
            away = np.abs(np.hypot(columns - middle[0], rows - middle[1]) - radius)
            picture[away <= wide / 2] = paint
    return picture


# Edges as ribbons over a surface, so that rays and OpenGL draw them; quads where triangles are halves of quads.

INK = (66, 69, 76)
LIFT_MM = 0.35  # towards the eye, so that the surface doesn't hide the ribbons


def quad_edges(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "e 2"]:
    """Return a mesh's edges, each once; without diagonals where its triangles are halves of quads.

    Our rigs list the first halves (a, b, c) of all quads and then the second halves (a, c, d). Any other mesh keeps all
    its edges.
    """
    half = len(faces) // 2
    first, second = faces[:half], faces[half:]
    halves = len(first) == len(second) and (first[:, [0, 2]] == second[:, [0, 1]]).all()
    if halves:
        directed = np.concatenate([first[:, [0, 1]], first[:, [1, 2]], second[:, [1, 2]], second[:, [2, 0]]])
    else:
        directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    return np.unique(np.sort(directed, axis=1), axis=0).astype(np.int32)


def wireframe(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], camera: Camera, width_mm: float = 0.28
) -> Surface:
    """Return a surface's edges as flat ribbons that face the camera, without those on its far side."""
    v = np.asarray(vertices, float)
    to_eye = axes(camera)[1] - v
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    visible = np.zeros(len(v), bool)
    visible[faces[(face_normals(v, faces) * to_eye[faces[:, 0]]).sum(-1) > 0]] = True
    edges = quad_edges(faces)
    a, b = edges[visible[edges].all(1)].T
    aside = np.cross(v[b] - v[a], to_eye[a])
    aside *= 0.5 * width_mm / np.linalg.norm(aside, axis=1, keepdims=True).clip(1e-9)
    corners = np.stack([v[a] - aside, v[a] + aside, v[b] + aside, v[b] - aside], 1) + LIFT_MM * to_eye[a][:, None]
    corner = np.arange(4 * len(a)).reshape(-1, 4)
    ribbons = np.concatenate([corner[:, [0, 1, 2]], corner[:, [0, 2, 3]]])
    return Surface(np.float32(corners.reshape(-1, 3)), np.int32(ribbons), INK, lit=False)
