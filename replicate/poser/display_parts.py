"""Eyeballs, brows and hair for a page: meshes that are only displayed, and how they go with the face.

No method approximates them. What lies on the skin goes with the vertices that are nearest at rest. An eyeball turns and
shifts by the sum of what each control, alone at its limits, does to it.
"""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from data_recipes.rig import Prop, Rig
from replicate.drawing.prop_surfaces import BUST, NEAREST, finish_of
from replicate.geometry.alignment import align
from replicate.poser.pack import Parts, indices

EYE = "eye"
EyePoints = dict[str, np.ndarray]  # by side: the vertices of an eyeball, (k, 3) mm
FINEST = np.iinfo(np.int16).max
STILL_MM = 0.01  # an eyeball that moves less is not moved


def display_contents(rig: Rig, progress: Callable) -> Parts:
    """Return a rig's props, those on the skin first, as a page carries them; a rig without props has none.

    progress: as `StageContext.progress`.
    """
    props = [_used(prop) for prop in rig.pose_props(rig.default)]
    props.sort(key=lambda prop: prop[0].startswith(EYE))
    if not props:
        return {"display": None}, {}
    vertices = np.concatenate([prop[1] for prop in props]).astype(np.float64)
    firsts = np.cumsum([0, *(len(prop[1]) for prop in props)])
    on_skin = firsts[sum(not prop[0].startswith(EYE) for prop in props)]
    finishes = list(dict.fromkeys(finish_of(prop[0]) for prop in props))
    step = float(np.abs(vertices).max()) / FINEST
    paint = [
        np.column_stack([prop[3], np.full(len(prop[1]), finishes.index(finish_of(prop[0])), np.uint8)])
        for prop in props
    ]
    faces = np.concatenate([prop[2] + first for prop, first in zip(props, firsts[:-1], strict=True)])
    index, weight = _nearest(rig.mesh.neutral, vertices[:on_skin])
    eyes, motions = _eyeballs(rig, props, firsts, progress)
    words = {
        "step_mm": step,
        "framed": [[int(a), int(b)] for prop, a, b in zip(props, firsts, firsts[1:], strict=False) if prop[0] != BUST],
        "finishes": [[finish.specular, finish.shininess] for finish in finishes],
        "eyes": eyes,
    }
    return {"display": words}, {
        "display.vertices": np.rint(vertices / step).astype(np.int16),
        "display.faces": indices(faces, len(vertices)),
        "display.paint": np.concatenate(paint).astype(np.uint8),
        "display.index": indices(index, len(rig.mesh.neutral)),
        "display.weight": np.rint(255 * weight).astype(np.uint8),
        **motions,
    }


def _used(prop: tuple) -> Prop:
    """Return a prop without the vertices that are in no face, and with a colour for each of the others."""
    name, vertices, faces, colours = prop
    used, faces = np.unique(faces, return_inverse=True)
    paint = np.broadcast_to(np.asarray(colours, np.uint8), (len(vertices), 3))
    return name, vertices[used], faces.reshape(-1, 3), paint[used]


def _nearest(neutral: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    distance, index = cKDTree(neutral).query(places, k=NEAREST)
    weight = 1 / (distance + 0.5) ** 2
    return index, weight / weight.sum(axis=1, keepdims=True)


def _eyeballs(rig: Rig, props: list[Prop], firsts: np.ndarray, progress: Callable) -> tuple[list[dict], dict]:
    """Return each eyeball's first and last vertices and centre, and what the controls do to it."""
    sides: dict[str, list[int]] = {}
    for k, prop in enumerate(props):
        if prop[0].startswith(EYE):
            sides.setdefault(prop[0].rsplit("_", 1)[-1], []).append(k)
    if not sides:
        return [], {}
    rest = _eye_points(rig.pose_props(rig.default))
    centres = {side: sphere_centre(rest[side]) for side in sides}
    turns = {side: np.zeros((len(rig.controls), 2, 6), np.float32) for side in sides}
    with progress(2 * len(rig.controls), "eyeballs") as bar:
        for end, limits in enumerate((rig.lower, rig.upper)):
            for j, posed in _alone(rig, rest, limits, np.arange(len(rig.controls)), bar.update):
                for side, centre in centres.items():
                    turns[side][j, end] = rigid_motion(rest[side], posed[side], centre)
    words = [
        {"parts": [[int(firsts[k]), int(firsts[k + 1])] for k in sides[side]], "centre": centres[side].tolist()}
        for side in sides
    ]
    return words, {f"display.eye.{i}": turns[side] for i, side in enumerate(sides)}


def _alone(
    rig: Rig, rest: EyePoints, limits: np.ndarray, controls: np.ndarray, done: Callable[[int], None]
) -> Iterator[tuple[int, EyePoints]]:
    """Yield each of some controls that moves an eyeball, and where the eyeballs are with that control at its limit.

    Most controls move none, so they are tried in groups, and a group that moves one is halved. done: is called with
    how many controls are finished.
    """
    params = np.array(rig.default)
    params[controls] = limits[controls]
    posed = _eye_points(rig.pose_props(params))
    if all(np.abs(posed[side] - rest[side]).max() < STILL_MM for side in rest):
        done(len(controls))
    elif len(controls) == 1:
        yield int(controls[0]), posed
        done(1)
    else:
        for half in np.array_split(controls, 2):
            yield from _alone(rig, rest, limits, half, done)


def _eye_points(props: list[tuple]) -> EyePoints:
    points: dict[str, list[np.ndarray]] = {}
    for name, vertices, _, _ in props:
        if name.startswith(EYE):
            points.setdefault(name.rsplit("_", 1)[-1], []).append(vertices)
    return {side: np.concatenate(parts).astype(np.float64) for side, parts in points.items()}


def rigid_motion(
    rest: Float[np.ndarray, "k 3"], posed: Float[np.ndarray, "k 3"], centre: Float[np.ndarray, " 3"]
) -> Float32[np.ndarray, " 6"]:
    """Return the turn about a centre, as a rotation vector in radians, and the centre's shift in mm; zeros if still."""
    if np.abs(posed - rest).max() < STILL_MM:
        return np.zeros(6, np.float32)
    rotation, translation = align(rest, posed)
    turn = Rotation.from_matrix(rotation.T).as_rotvec()
    return np.concatenate([turn, centre @ rotation + translation - centre]).astype(np.float32)


def sphere_centre(points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " 3"]:
    """Return the centre of the sphere that fits some points best, mm."""
    system = np.concatenate([2 * points, np.ones((len(points), 1))], axis=1)
    return np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0][:3]
