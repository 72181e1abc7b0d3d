"""Where this face folds, by its 68 landmarks: forehead, glabella, crow's feet and nasolabial folds.

Strain makes the folds as on our own faces (`deformers.wrinkles`). No control sets their gains, the recipe does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from data_recipes.deformers.sculpting import smoothstep
from data_recipes.deformers.surface_operators import submesh, vertex_normals
from data_recipes.deformers.wrinkle_regions import stream, uneven
from data_recipes.deformers.wrinkles import Region
from data_recipes.ict.facekit_segments import SOFT, Segments
from data_recipes.recipe.facekit import Folds
from data_recipes.recipe.sections import Wrinkles

UP, OUT = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
# Multi-PIE's numbers. The model's left is +x, the picture's right.
BROW_INNER, BROW_OUTER, NASION, SUBNASALE = {"left": 22, "right": 21}, {"left": 26, "right": 17}, 27, 33
NOSE_SIDE, EYE_OUTER = {"left": 35, "right": 31}, {"left": 45, "right": 36}
MOUTH_CORNER, LIPS = {"left": 54, "right": 48}, slice(48, 60)
FOREHEAD = 0.75  # brow to hair line as a share of brow to subnasale; in the canon of thirds 1, but its top doesn't move
MIDLINE_MM = 0.5
FEWEST = 6  # a region of fewer vertices is left out


@dataclass(frozen=True)
class Skin:
    """The whole skin: x (n, 3) mm, normals, triangles, polygons (q, 4); face: (n,) bool; marks: (68, 3) mm."""

    x: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    polygons: np.ndarray
    face: np.ndarray
    marks: np.ndarray


@dataclass(frozen=True)
class Patch:
    """A region before vertices without a face are left out; numbers stand for (s,) equal values."""

    name: str
    vertices: np.ndarray
    fibre: np.ndarray  # (s, 3)
    wavelength_mm: np.ndarray | float
    pattern: np.ndarray
    threshold: np.ndarray | float


def build_regions(
    x: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    polygons: Int[np.ndarray, "q 4"],
    face: Bool[np.ndarray, " n"],
    marks: Float[np.ndarray, "68 3"],
    folds: Folds,
    wrinkles: Wrinkles,
    m: int,
) -> list[Region]:
    """Return the wrinkle regions.

    x, marks: the neutral vertices and the landmarks, mm.
    polygons: with −1 in the last place of a triangle.
    face: the skin that may fold.
    m: how many controls the rig has.
    """
    skin = Skin(x, vertex_normals(x, faces), faces, polygons, face, marks)
    patches = [(folds.forehead, _forehead(skin, folds.rows, wrinkles)), (folds.glabella, _glabella(skin, wrinkles))]
    for side in ("left", "right"):
        patches.append((folds.crow, _crow(skin, side, wrinkles)))
        patches.append((folds.nasolabial, _nasolabial(skin, side, wrinkles)))
    regions = []
    for gain, patch in patches:
        used = np.unique(submesh(faces, patch.vertices, len(x))[0])
        if len(used) < FEWEST or gain == 0:
            continue
        each = np.ones(len(patch.vertices))
        regions.append(
            Region(
                name=patch.name,
                vertices=patch.vertices[used].astype(np.int32),
                fibre=patch.fibre[used],
                wavelength_mm=(patch.wavelength_mm * each)[used],
                pattern=gain * patch.pattern[used],
                threshold=(patch.threshold * each)[used],
                gain_columns=np.array([m], np.int32),  # no control: always at its gain
                gain_weights=np.ones((1, len(used)), np.float32),
            )
        )
    return regions


def walk_rows(polygons: Int[np.ndarray, "q 4"], seeds: list[int], inside: np.ndarray) -> dict[int, float]:
    """Return vertex → its row, from 0: rows are edge loops that begin at the seeds and go to both sides.

    seeds: a column of vertices, upwards.
    inside: (n,) bool; a loop ends outside.
    At a vertex of four quads a loop goes on along the edge that shares no quad with the one it came by; at any other
    vertex it ends.
    """
    beside: dict[int, dict[int, set[int]]] = {}
    for polygon in polygons[polygons[:, 3] >= 0].tolist():
        for k, vertex in enumerate(polygon):
            a, b = polygon[k - 1], polygon[(k + 1) % 4]
            around = beside.setdefault(vertex, {})
            around.setdefault(a, set()).add(b)
            around.setdefault(b, set()).add(a)
    column, row = set(seeds), {}
    for height, seed in enumerate(seeds):
        row[seed] = float(height)
        for step in set(beside.get(seed, {})) - column:
            before, vertex = seed, step
            while inside[vertex] and vertex not in row:
                row[vertex] = float(height)
                around = beside[vertex]
                ahead = set(around) - around[before] - {before}
                if len(around) != 4 or len(ahead) != 1:
                    break
                before, vertex = vertex, ahead.pop()
    return row


def _forehead(s: Skin, rows_per_fold: int, wrinkles: Wrinkles) -> Patch:
    """Ridges along the mesh's rows from the brows upwards."""
    brow = 0.5 * (s.marks[BROW_INNER["left"]] + s.marks[BROW_INNER["right"]])
    height = FOREHEAD * (brow[1] - s.marks[SUBNASALE, 1])
    reach = 1.05 * s.marks[BROW_OUTER["left"], 0]
    y = s.x[:, 1]
    band = s.face & (y > brow[1] - 4) & (y < brow[1] + height) & (s.x[:, 2] > 0)
    middle = np.flatnonzero(band & (np.abs(s.x[:, 0]) < MIDLINE_MM))
    seeds = middle[np.argsort(y[middle])].tolist()
    row = walk_rows(s.polygons, seeds, band & (np.abs(s.x[:, 0]) < reach))
    vertices, rows = np.array(list(row), int), np.array(list(row.values()))
    count = max(len(seeds) - 1, 1)
    spacing = np.linalg.norm(np.diff(s.x[seeds], axis=0), axis=1).mean() if len(seeds) > 1 else 1.0
    window = smoothstep(rows, 0.02 * count, 0.16 * count) * smoothstep(rows, 1.0 * count, 0.75 * count)
    window = window * smoothstep(np.abs(s.x[vertices, 0]), reach, 0.6 * reach)
    phase, along = rows / rows_per_fold + 0.5, s.x[vertices, 0]
    fold = uneven(phase, along, rows_per_fold * spacing, wrinkles, stream(wrinkles.seed, "forehead"))
    fibre = np.tile(UP, (len(vertices), 1))
    return Patch("forehead", vertices, fibre, fold.wavelength_mm, 0.8 * fold.pattern(window), fold.threshold)


def _glabella(s: Skin, wrinkles: Wrinkles) -> Patch:
    """Two upright grooves between the brows."""
    inner, top = s.marks[BROW_INNER["left"], :2]
    low = 0.5 * (s.marks[NASION, 1] + top)
    x, y = s.x[:, 0], s.x[:, 1]
    near = (np.abs(x) < 1.5 * inner) & (y > low - 12) & (y < top + 16) & (s.x[:, 2] > 0)
    vertices = np.flatnonzero(near & s.face)
    x, y = np.abs(x[vertices]), y[vertices]
    groove = 0.5 * inner
    pattern = 0.5 - 2.0 * np.exp(-(((x - groove) / (0.4 * groove)) ** 2))
    window = smoothstep(x, 1.45 * inner, 0.8 * inner) * smoothstep(y, low - 11, low) * smoothstep(y, top + 14, top)
    return Patch("glabella", vertices, np.tile(OUT, (len(vertices), 1)), 9.0, window * pattern, wrinkles.tension)


def _crow(s: Skin, side: str, wrinkles: Wrinkles) -> Patch:
    """A fan of folds, 19° apart, from the outer corner of the eye."""
    sign = 1.0 if side == "left" else -1.0
    away = s.x - s.marks[EYE_OUTER[side]]
    out = np.array([0.55 * sign, 0, -0.83])  # outwards along the skin
    along, distance = away @ out, np.linalg.norm(away, axis=1)
    vertices = np.flatnonzero((distance < 36) & (along > 2) & s.face)
    a, b, distance = along[vertices], away[vertices, 1], distance[vertices]
    angle = np.degrees(np.arctan2(b, a + 3.0))
    window = smoothstep(distance, 6, 12) * smoothstep(distance, 34, 20) * smoothstep(np.abs(angle + 4), 62, 38)
    radial = (a + 3.0)[:, None] * out + b[:, None] * UP
    fibre = np.cross(s.normals[vertices], radial)
    fibre /= np.maximum(np.linalg.norm(fibre, axis=1, keepdims=True), 1e-9)
    row = uneven(angle / 19 + 0.5, distance, 6.0, wrinkles, stream(wrinkles.seed, f"crow_{side}"))
    return Patch(f"crow_{side}", vertices, fibre, row.wavelength_mm, row.pattern(window), row.threshold)


def _nasolabial(s: Skin, side: str, wrinkles: Wrinkles) -> Patch:
    """One fold from the nose's wing to beside the mouth's corner: a crease with the cheek's roll beyond it."""
    sign = 1.0 if side == "left" else -1.0
    start = s.marks[NOSE_SIDE[side]] + np.array([8.0 * sign, 7.0, -4.0])
    end = s.marks[MOUTH_CORNER[side]] + np.array([12.0 * sign, -3.0, -6.0])
    bend = 0.5 * (start + end) + np.array([5.0 * sign, 3.0, 0.0])
    t = np.linspace(0, 1, 60)[:, None]
    curve = (1 - t) ** 2 * start + 2 * t * (1 - t) * bend + t**2 * end
    near = np.linalg.norm(s.x[:, None, :2] - curve[None, :, :2], axis=2)
    place = near.argmin(axis=1)
    across = np.cross(np.gradient(curve, axis=0)[place], s.normals)
    across *= np.where(sign * across[:, :1] < 0, -1.0, 1.0)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    off_lips = np.linalg.norm(s.x[:, None] - s.marks[None, LIPS], axis=2).min(axis=1) > 7
    mask = (near.min(axis=1) < 18) & (sign * s.x[:, 0] > 8) & s.face & off_lips & (s.x[:, 2] > end[2] - 30)
    vertices = np.flatnonzero(mask)
    d = ((s.x - curve[place]) * across).sum(axis=1)[vertices]
    place = place[vertices] / 59
    pattern = -1.9 * np.exp(-((d / 3.2) ** 2)) + 1.3 * np.exp(-(((d - 7.5) / 4.8) ** 2))
    window = smoothstep(place, 0.0, 0.12) * smoothstep(place, 1.0, 0.65) * smoothstep(np.abs(d), 17, 12)
    return Patch(f"nasolabial_{side}", vertices, across[vertices], 11.0, window * pattern, wrinkles.tension)


# A colour for each vertex, for pictures only: skin with lips, the mouth's inside, gums and teeth.

SKIN, LIP = np.array([0.85, 0.66, 0.55]), np.array([0.76, 0.47, 0.43])
COLOURS = {
    "mouth": np.array([0.45, 0.17, 0.17]),
    "eye_socket_left": np.array([0.78, 0.52, 0.48]),
    "eye_socket_right": np.array([0.78, 0.52, 0.48]),
    "gums_tongue": np.array([0.78, 0.42, 0.42]),
}
IVORY = np.array([0.95, 0.93, 0.87])
LIP_EDGE_MM = 1.5  # over which the lips' colour fades, to both sides of their outline
BEHIND_MM = 16.0  # vertices farther behind the outline are not lips


def paint(x: Float[np.ndarray, "n 3"], segments: Segments, marks: Int[np.ndarray, " l"]) -> UInt8[np.ndarray, "n 3"]:
    """Return every vertex's colour. x: the neutral, mm. marks: the 68 landmarks."""
    colour = np.tile(SKIN, (len(x), 1))
    for k, name in enumerate(segments.names):
        colour[segments.segment == k] = COLOURS.get(name, SKIN) if name in SOFT else IVORY
    outline = x[marks[LIPS]]
    inside = smoothstep(-outside(x[:, :2], outline[:, :2]), -LIP_EDGE_MM, LIP_EDGE_MM)
    front = (x[:, 2] > outline[:, 2].min() - BEHIND_MM) & (segments.segment == segments.names.index("face"))
    colour += (inside * front)[:, None] * (LIP - colour)
    return np.rint(255 * colour).astype(np.uint8)


def outside(points: Float[np.ndarray, "n 2"], polygon: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, " n"]:
    """Return how far points lie outside of a polygon, mm; less than 0 inside."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    along, away = (b - a)[None], points[:, None] - a[None]
    share = np.clip((away * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0, 1)
    distance = np.linalg.norm(away - share[..., None] * along, axis=-1).min(axis=1)
    y = points[:, None, 1]
    crossing = (a[None, :, 1] > y) != (b[None, :, 1] > y)
    rise = np.where(np.abs(along[..., 1]) > 1e-12, along[..., 1], 1.0)
    beyond = points[:, None, 0] < a[None, :, 0] + (y - a[None, :, 1]) * along[..., 0] / rise
    return np.where((crossing & beyond).sum(axis=1) % 2 == 1, -distance, distance)
