"""Whether an eye shows when its lids are closed, found by rays from the eyeball's surface outwards.

Where a ray meets nothing the eyeball shows: between the lids, or where it sticks out of them by as much as the skin
lies below its surface. Lids have an inner side, which may touch the eyeball behind the outer one. Eyeballs are
display-only, so this needs a rig with such props (`eye_…_left` and `eye_…_right`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from data_recipes.rig import Rig
from replicate.geometry.alignment import align
from replicate.geometry.rays import ray_hits

SIDES = ("left", "right")
NEAR_RADII = 3.5  # skin within this many radii of an eye's middle moves with its socket
FAR_RADII = 12.0  # skin farther than this never hides an eye, not even a broad nose
CONE_DEG = 52.0  # about where the eye looks at rest: its lids and their corners, but no other rim
SPARE_DEG = 30.0  # how far beside the cone skin may be that moves into it
TOUCH_MM = 0.05  # how far a lid may lie inside an eyeball of flat pieces
FULL_BLINK = 0.98


@dataclass(frozen=True)
class Eyes:
    """A rig's eyes, by side.

    faces: triangles of the lids and of all else that can hide the eye
    around: vertices around the eye, which move with its socket
    forward: where it looks at rest, a unit vector
    open_mm2: the area that shows at rest
    blink: index of its blink control
    rims: landmarks on the rims of the upper and the lower lid
    """

    faces: dict[str, Int[np.ndarray, "f 3"]]
    around: dict[str, Int[np.ndarray, " k"]]
    forward: dict[str, Float[np.ndarray, " 3"]]
    open_mm2: dict[str, float]
    blink: dict[str, int]
    rims: dict[str, tuple[int, int]]


@dataclass(frozen=True)
class Lids:
    """An eye in a pose: the share of its resting opening that shows, how far it sticks out, and the rims' gap."""

    shows: float
    sticks_out_mm: float
    gap_mm: float


def find_eyes(rig: Rig) -> Eyes | None:
    """Return a rig's eyes, or None where it has no eyeballs or no controls called blink_left and blink_right."""
    columns = {control.name: index for index, control in enumerate(rig.controls)}
    balls = _eyeballs(rig.pose_props(rig.default))
    blink = {side: columns[f"blink_{side}"] for side in SIDES if f"blink_{side}" in columns}
    if set(balls) != set(SIDES) or set(blink) != set(SIDES):
        return None
    marks = dict(zip(rig.landmark_names, rig.landmarks.tolist(), strict=True)) if rig.landmark_names else {}
    faces, around, forward, rims, open_mm2 = {}, {}, {}, {}, {}
    middles = rig.mesh.neutral[rig.mesh.faces].mean(1)
    iris = {p[0].removeprefix("eye_iris_"): p[1].mean(0) for p in rig.pose_props(rig.default) if "iris" in p[0]}
    for side, (vertices, triangles) in balls.items():
        centre, radius = _sphere(vertices)
        forward[side] = (iris[side] - centre) / np.linalg.norm(iris[side] - centre)
        towards = middles - centre
        length = np.linalg.norm(towards, axis=1)
        near = length < NEAR_RADII * radius
        ahead = towards @ forward[side] > np.cos(np.radians(CONE_DEG + SPARE_DEG)) * length
        faces[side] = rig.mesh.faces[near | (ahead & (length < FAR_RADII * radius))]
        around[side] = np.unique(rig.mesh.faces[near])
        open_mm2[side] = _rays(vertices, triangles, rig.mesh.neutral[faces[side]], forward[side])[0]
        if {f"lid_upper_{side}", f"lid_lower_{side}"} <= set(marks):
            rims[side] = marks[f"lid_upper_{side}"], marks[f"lid_lower_{side}"]
    return Eyes(faces, around, forward, open_mm2, blink, rims)


def measure_lids(
    rig: Rig, eyes: Eyes, params: Float[np.ndarray, " m"], vertices: Float[np.ndarray, "n 3"]
) -> dict[str, Lids]:
    """Return side → Lids for the eyes that blink fully in a pose (m,); vertices: the rig's in that pose."""
    sides = [side for side in SIDES if params[eyes.blink[side]] >= FULL_BLINK]
    balls = _eyeballs(rig.pose_props(params)) if sides else {}
    lids = {}
    for side in sides:
        around = eyes.around[side]
        turn, _ = align(rig.mesh.neutral[around].astype(float), vertices[around].astype(float))
        shows, out = _rays(*balls[side], vertices[eyes.faces[side]], eyes.forward[side] @ turn)
        upper, lower = eyes.rims.get(side, (0, 0))
        gap = float(np.linalg.norm(vertices[upper] - vertices[lower]))
        lids[side] = Lids(shows / max(eyes.open_mm2[side], 1e-9), out, gap)
    return lids


def _eyeballs(props) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return side → vertices and faces of all props of that eye, except the pupil, which is lifted off the ball."""
    balls = {}
    for side in SIDES:
        parts = [p for p in props if p[0].startswith("eye_") and p[0].endswith(f"_{side}") and "pupil" not in p[0]]
        if parts:
            first = np.cumsum([0, *(len(part[1]) for part in parts)])
            faces = np.concatenate([part[2] + start for part, start in zip(parts, first, strict=False)])
            balls[side] = np.concatenate([part[1] for part in parts]).astype(float), faces
    return balls


def _sphere(vertices: Float[np.ndarray, "k 3"]) -> tuple[Float[np.ndarray, " 3"], float]:
    """Return the middle and the mean radius of the sphere that fits an eyeball, squashed or not."""
    system = np.concatenate([2 * vertices, np.ones((len(vertices), 1))], 1)
    centre = np.linalg.lstsq(system, (vertices * vertices).sum(1), rcond=None)[0][:3]
    return centre, float(np.linalg.norm(vertices - centre, axis=1).mean())


def _rays(
    vertices: np.ndarray, faces: np.ndarray, lids: Float[np.ndarray, "f 3 3"], forward: Float[np.ndarray, " 3"]
) -> tuple[float, float]:
    """Return the area of an eyeball that shows (mm²) and how far it sticks out of the lids (mm). forward: its gaze."""
    centre, radius = _sphere(vertices)
    corners = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    towards = corners.mean(1) - centre
    length = np.linalg.norm(towards, axis=1)
    front = towards @ forward > np.cos(np.radians(CONE_DEG)) * length
    towards, length, area = towards[front], length[front], area[front]
    unit = towards / length[:, None]
    outwards, _ = ray_hits(centre + unit * (length - TOUCH_MM)[:, None], FAR_RADII * radius * unit, lids)
    shows = ~np.isfinite(outwards)
    within, _ = ray_hits(centre + 0 * unit[shows], towards[shows], lids)
    out = np.where(np.isfinite(within), (1 - np.where(np.isfinite(within), within, 0)) * length[shows], 0)
    return float(area[shows].sum()), float(out.max(initial=0.0))
