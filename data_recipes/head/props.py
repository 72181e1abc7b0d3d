"""Display-only things: eyeballs, brows, lashes and hair.

They ride along in pictures and are no part of the approximated mesh. Each is a plain mesh of one colour that either
turns with an eye or follows the skin under it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import PchipInterpolator

from data_recipes.head.layout import Layout, grid_quads
from data_recipes.head.sdf import distance_and_gradient, raycast
from data_recipes.head.shape import Shape, lidded_distance, skull_distance

FLIP = np.array([-1.0, 1.0, 1.0])
EYE_WHITE = (0.95, 0.95, 0.93)
PUPIL = (0.03, 0.03, 0.04)
LASHES = (0.10, 0.07, 0.06)
LIMBUS_DEG = 3.5  # width of the iris's dark rim
HAIR_MM = 6.0
# The hair line: height (mm) by angle around the head's axis, from the forehead by temple, sideburn and ear to the nape.
HAIR_LINE = (
    (0.0, 68.0),
    (18.0, 64.0),
    (36.0, 60.0),
    (50.0, 52.0),
    (62.0, 34.0),
    (70.0, 10.0),
    (76.0, 0.0),
    (82.0, 4.0),
    (90.0, 26.0),
    (102.0, 26.0),
    (114.0, 0.0),
    (126.0, -30.0),
    (150.0, -44.0),
    (180.0, -46.0),
)


@dataclass(frozen=True)
class Prop:
    """A mesh at rest: vertices (mm), triangles, RGB in [0, 1], and what it follows: "eye_left", "eye_right", "skin"."""

    name: str
    follow: str
    colour: tuple[float, float, float]
    vertices: Float[np.ndarray, "k 3"]
    faces: Int[np.ndarray, "f 3"]


def build_props(shape: Shape, layout: Layout, x: Float[np.ndarray, "n 3"]) -> tuple[Prop, ...]:
    """Return a head's props; `x` are the head's vertices."""
    wanted, left = shape.recipe.props, _eyeball(shape)
    if wanted.brows != "none":
        left.append(_brow(shape))
    if wanted.lashes != "none":
        left.append(_lashes(layout, x))
    props = [side for prop in left for side in (prop, _mirrored(prop))]
    if wanted.hair != "none":
        props.append(_hair(shape))
    return tuple(props)


def _sheet(name: str, follow: str, colour, grid: Float[np.ndarray, "rows columns 3"]) -> Prop:
    """Make a prop of a grid whose rows run up and whose columns run to the right, seen from outside."""
    quads = grid_quads(np.arange(grid.shape[0] * grid.shape[1]).reshape(grid.shape[:2]))
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    p = grid.reshape(-1, 3)
    area = np.linalg.norm(np.cross(p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]]), axis=1)
    return Prop(name, follow, tuple(float(c) for c in colour), p, faces[area > 1e-9])


def _mirrored(prop: Prop) -> Prop:
    name, follow = prop.name.replace("left", "right"), prop.follow.replace("left", "right")
    return Prop(name, follow, prop.colour, prop.vertices * FLIP, prop.faces[:, ::-1].copy())


def _eyeball(shape: Shape) -> list[Prop]:
    """Return the left eye's white, iris, its dark rim and the pupil: zones of one sphere around the gaze."""
    e = shape.recipe.eyes
    around = np.linspace(0, 2 * np.pi, 49)
    dark = tuple(0.45 * c for c in e.iris_colour)
    zones = [
        ("white", EYE_WHITE, 180.0, e.iris_deg, 25),
        ("limbus", dark, e.iris_deg, e.iris_deg - LIMBUS_DEG, 2),
        ("iris", e.iris_colour, e.iris_deg - LIMBUS_DEG, e.pupil_deg, 6),
        ("pupil", PUPIL, e.pupil_deg, 0.0, 5),
    ]
    parts = []
    for name, colour, outer, inner, rows in zones:
        angle = np.radians(np.linspace(outer, inner, rows))[:, None]
        narrow = 0.35 if e.pupil == "slit" and name == "pupil" else 1.0
        sine = np.sin(angle)
        unit = np.stack([narrow * sine * np.cos(around), sine * np.sin(around), np.cos(angle) + 0 * around], -1)
        unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
        lift = 1.003 if name == "pupil" else 1.0
        parts.append(_sheet(f"eye_{name}_left", "eye_left", colour, np.array(e.centre) + lift * e.radius * unit))
    return parts


def _brow(shape: Shape) -> Prop:
    """Return the left brow: a rounded strip over the brow ridge, blunt at the nose and pointed at the temple."""
    recipe = shape.recipe
    s, thin = recipe.skull, recipe.props.brows == "thin"
    t, across = np.linspace(0, 1, 33), np.linspace(-1, 1, 9)
    inner, outer = np.array(s.brow_inner), np.array(s.brow_outer)
    line = inner + (outer - inner) * (0.10 + 1.02 * t)[:, None]
    rise = s.brow_radii[0] * (0.35 + (0.9 if thin else 0.65) * np.sin(np.pi * t**1.15) - 0.75 * t**3)
    half = (1.5 if thin else 3.1) * np.minimum(1, (t / 0.07 + 0.25)) ** 0.5 * (1 - t**2.5) ** 0.8 + 0.15
    flat = np.stack([np.broadcast_to(line[:, 0], (9, 33)), line[:, 1] + rise + across[:, None] * half], -1)
    origin = np.concatenate([flat, np.zeros((9, 33, 1))], -1).reshape(-1, 3)
    straight = np.array([0.0, 0, 1.0]) + 0 * origin
    origin[:, 0] *= 0.5  # the rays fan out, so that they meet the temple at a fair angle
    straight[:, 0] = origin[:, 0] / np.repeat(line[None, :, 2], 9, 0).ravel()
    straight /= np.linalg.norm(straight, axis=1, keepdims=True)
    p, normal = _on_skin(lambda q: lidded_distance(recipe, q), origin, straight)
    blunt = np.minimum(1, t / 0.05) * np.minimum(1, (1 - t) / 0.05)
    height = 1.5 * (1 - across[:, None] ** 2) * blunt * (0.5 + 0.5 * half / half.max()) - 0.25
    grid = (p + height.reshape(-1, 1) * normal).reshape(9, 33, 3)
    return _sheet("brow_left", "skin", tuple(0.7 * c for c in recipe.props.hair_colour), grid)


def _lashes(layout: Layout, x: Float[np.ndarray, "n 3"]) -> Prop:
    """Return the left eye's upper lashes: a dark band that stands out from the rim, longest towards the temple."""
    rings = layout.grids["eye_left"]
    upper = np.arange(rings.shape[1] // 2 + 1)[::-1]  # from the nose to the temple
    rim, next_ring = x[rings[0, upper]], x[rings[1, upper]]
    t = np.linspace(0, 1, len(upper))
    out = rim - rim.mean(0)
    out = (out - out[:, 2:] * (0, 0, 1)) / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    long = (2.4 * np.sin(np.pi * t**1.3) ** 0.6)[:, None]
    tip = rim + long * (0.75 * np.array([0, 0, 1.0]) + 0.45 * out + np.array([0.25, 0.2, 0]) * t[:, None])
    return _sheet("lashes_left", "skin", LASHES, np.stack([rim, tip, 0.65 * rim + 0.35 * next_ring + (0, 0, 0.15)]))


def _hair(shape: Shape) -> Prop:
    """Return the hair: a cap over the skull that is thin at the hair line and ripples along its strands."""
    recipe = shape.recipe
    centre = np.array(recipe.skull.cranium) + np.array([0.0, -14.0, 2.0])
    scale = recipe.skull.cranium_radii[1] / 74.0
    columns, rows = 145, 30
    turn = np.linspace(-np.pi, np.pi, columns)
    side = np.degrees(np.abs(turn))
    line = PchipInterpolator(*np.array(HAIR_LINE).T)(side) * scale
    line = line + 1.6 * scale * np.cos(np.radians(9 * side)) * np.clip((70 - side) / 20, 0, 1)  # a fringe of locks
    level = np.stack([0 * line, line, np.full(columns, centre[2])], -1)
    aside = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], -1)
    edge, _ = _on_skin(lambda q: skull_distance(recipe, q), level, aside)
    low = np.arctan2(edge[:, 1] - centre[1], np.hypot(edge[:, 0], edge[:, 2] - centre[2]))
    share = np.concatenate([[0.0, 0.0, 0.01], np.linspace(0.03, 1, rows - 3) ** 1.1])[:, None]
    pitch = low + (np.pi / 2 - low) * share
    direction = np.stack([np.cos(pitch) * np.sin(turn), np.sin(pitch), np.cos(pitch) * np.cos(turn)], -1).reshape(-1, 3)
    p, normal = _on_skin(lambda q: skull_distance(recipe, q), centre + 0 * direction, direction)
    thick = HAIR_MM * scale * (0.35 + 0.65 * np.minimum(share / 0.18, 1) ** 0.6)
    strands = 0.55 * np.abs(np.cos(18 * turn + 1.2 * np.sin(3 * turn))) + 0.25 * np.cos(41 * turn)
    thick = thick + scale * strands * np.clip(share / 0.05, 0, 1) * (1 - share) ** 0.5
    thick[0] = -0.6
    grid = (p + thick.reshape(-1, 1) * normal).reshape(rows, columns, 3)
    return _sheet("hair", "skin", recipe.props.hair_colour, grid)


def _on_skin(sdf, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where rays meet a surface, and its unit normals there."""
    p = raycast(sdf, origins, directions)
    _, normal = distance_and_gradient(sdf, p, 0.5)
    return p, normal / np.linalg.norm(normal, axis=1, keepdims=True)
