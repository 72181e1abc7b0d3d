"""Scenes: surfaces and fixed cameras."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

CLAY = (208, 203, 197)
WHITE = (255, 255, 255)


@dataclass(frozen=True)
class Finish:
    """How a surface shines: the strength of its glints, and how sharp they are (Phong's exponent)."""

    specular: float
    shininess: float


MATT = Finish(0.10, 24.0)
WET = Finish(0.22, 60.0)  # eyeballs, mouths
SILKY = Finish(0.16, 14.0)  # hair


@dataclass(frozen=True)
class Surface:
    """A triangle mesh to draw.

    vertices: (n, 3) mm.
    faces: (f, 3).
    colours: one RGB triple 0–255, or (f, 3) uint8, one for each face.
    lit: False draws the colours as they are, as heatmaps need.
    paint: (n, 3) uint8, a colour for each vertex in place of `colours`; faces blend those of their corners.
    finish: how it shines.
    framed: whether `frame_surfaces` makes room for it.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: tuple[int, int, int] | np.ndarray = CLAY
    lit: bool = True
    paint: np.ndarray | None = None
    finish: Finish = MATT
    framed: bool = True


@dataclass(frozen=True)
class Camera:
    """A perspective view.

    focus: (x, y, z) mm, the middle of the picture.
    height_mm: how much of the focal plane is seen, top to bottom.
    azimuth_deg: 0 = from the front, positive = from the picture's right.
    elevation_deg: positive = from above.
    distance_mm: from eye to focus.
    """

    focus: tuple[float, float, float]
    height_mm: float
    azimuth_deg: float = 0.0
    elevation_deg: float = 0.0
    distance_mm: float = 900.0


# For a head of the teen's size, eyes at y = 0; `camera_for` scales them to other heads by the width from ear to ear.
HEAD_WIDTH_MM = 188.0
HEAD_FROM_MM = -60.0  # the width is measured above this height: a bust's shoulders don't count
CHIN = -0.62  # a head's lower end, below it are neck and shoulders: in widths of the head, from the eyes
CAMERAS = {
    "front": Camera((0, -11, 40), 264),
    "three_quarter": Camera((0, -11, 30), 264, 35, 6),
    "side": Camera((0, -11, 6), 264, 80, 4),
    "forehead": Camera((0, 42, 78), 78, 14, 4),
    "mouth": Camera((0, -55, 85), 94, 12, 0),
    # Not for pictures: the skin between brow and hair line, whose wrinkles decide the test pose that figures show.
    "wrinkles": Camera((0, 60, 75), 66, 0, 10),
}


def camera_for(name: str, neutral: Float[np.ndarray, "n 3"]) -> Camera:
    """Return a named camera, scaled to the width of a head in its neutral pose."""
    camera, scale = CAMERAS[name], _width_mm(neutral) / HEAD_WIDTH_MM
    focus = tuple(scale * x for x in camera.focus)
    return Camera(focus, scale * camera.height_mm, camera.azimuth_deg, camera.elevation_deg, scale * camera.distance_mm)


def above_neck(neutral: Float[np.ndarray, "n 3"]) -> np.ndarray:
    """Return (n,) bool: which vertices are of the head; all of them where a mesh has none above `CHIN`."""
    is_head = neutral[:, 1] > CHIN * _width_mm(neutral)
    return is_head if is_head.any() else ~is_head


def _width_mm(neutral: Float[np.ndarray, "n 3"]) -> float:
    head = neutral[neutral[:, 1] > HEAD_FROM_MM]
    return float(np.ptp((head if len(head) else neutral)[:, 0]))


def following(camera: Camera, rest: Float[np.ndarray, "k 3"], posed: Float[np.ndarray, "k 3"]) -> Camera:
    """Return the camera shifted with the mean of some vertices, so that they stay in the picture in a pose."""
    shift = np.mean(posed - rest, axis=0, dtype=float)
    return replace(camera, focus=tuple(float(x) for x in np.asarray(camera.focus) + shift))


def forehead_camera(
    neutral: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], posed: Float[np.ndarray, "n 3"]
) -> Camera:
    """Return the camera "forehead" moved to the forehead of a pose, however far the head nods or turns.

    It is lowered where the forehead doesn't reach to the top of the picture.
    """
    forehead = np.unique(faces[forehead_faces(neutral, faces)])
    camera = following(camera_for("forehead", neutral), neutral[forehead], posed[forehead])
    above = max(0.0, float(project(posed[forehead].astype(float), camera, 1, 1)[0][:, 1].min()))
    down = above * camera.height_mm * axes(camera)[0][1]
    return replace(camera, focus=tuple(float(x) for x in np.asarray(camera.focus) - down))


def axes(camera: Camera) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Return the camera's right, up and backward unit vectors as rows, and the eye's place in mm."""
    azimuth, elevation = np.radians(camera.azimuth_deg), np.radians(camera.elevation_deg)
    backward = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
    right = np.cross([0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right)
    rows = np.stack([right, np.cross(backward, right), backward])
    return rows, np.asarray(camera.focus, float) + camera.distance_mm * backward


def project(
    vertices: Float[np.ndarray, "n 3"], camera: Camera, width: int, height: int
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Return each vertex's place in pixels (x right, y down, pixel centres at .5) and its depth before the eye, mm."""
    rows, eye = axes(camera)
    view = (vertices - eye) @ rows.T
    depth = -view[:, 2]
    scale = height / camera.height_mm * camera.distance_mm / depth
    return np.stack([width / 2 + view[:, 0] * scale, height / 2 - view[:, 1] * scale], -1), depth


def frame_surfaces(camera: Camera, surfaces: Sequence[Surface], aspect: float, margin: float = 0.04) -> Camera:
    """Return the camera moved and widened so that the surfaces fill a picture.

    aspect: the picture's width over its height. margin: the share of the height that stays free on each side.
    """
    points = np.concatenate([np.asarray(surface.vertices, float) for surface in surfaces if surface.framed])
    for _ in range(3):  # perspective changes a little as the focus moves
        pixels, _ = project(points, camera, 1, 1)
        low, high = pixels.min(0), pixels.max(0)
        rows, _ = axes(camera)
        middle = ((low + high) / 2 - 0.5) * camera.height_mm
        focus = np.asarray(camera.focus) + middle[0] * rows[0] - middle[1] * rows[1]
        height = camera.height_mm * max(high[1] - low[1], (high[0] - low[0]) / aspect) / (1 - 2 * margin)
        camera = replace(camera, focus=tuple(focus.tolist()), height_mm=float(height))
    return camera


def faces_in_view(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], camera: Camera, facing: float = 0.3
) -> np.ndarray:
    """Return (f,) bool: faces that are inside the camera's square frame and turned to it, even if others hide them."""
    pixels, _ = project(vertices.astype(float), camera, 1, 1)
    inside = ((pixels > 0) & (pixels < 1)).all(-1)
    corners = vertices[faces].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    to_eye = axes(camera)[1] - corners.mean(1)
    cosine = (normals * to_eye).sum(-1) / (np.linalg.norm(normals, axis=-1) * np.linalg.norm(to_eye, axis=-1) + 1e-30)
    return inside[faces].all(-1) & (cosine > facing)


def forehead_faces(neutral: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> np.ndarray:
    """Return (f,) bool: faces that the camera "wrinkles" sees; on a mesh with none there, all that "front" sees."""
    visible = faces_in_view(neutral, faces, camera_for("wrinkles", neutral))
    return visible if visible.sum() >= 12 else faces_in_view(neutral, faces, camera_for("front", neutral))
