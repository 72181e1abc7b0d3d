"""A head of ours as a file for Blender: its mesh and charts, and the places of Rigify's joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import RBFInterpolator

from data_recipes.head.neutral_head import Eye, Head

# The joints of Rigify's face on a head of ours: some from our landmarks, and the others by a smooth warp.

Place = Float[np.ndarray, " 3"]
Joints = dict[str, Place]  # "<bone>:head" or "<bone>:tail" → mm, in the head's axes
SKIN = ("face", "cranium", "ear_left", "ear_right")
SAME_MM = 0.5  # joints of the metarig this close coincide


def fit_joints(head: Head, metarig: Joints) -> Joints:
    """Return the place of every joint of Rigify's metarig on a head.

    metarig: the joints of the metarig as Blender adds it, mm, in the axes of our heads (x to the face's left, y up,
    z forward); bones on the right have ".R" in their names. Joints that coincide in it must coincide in the result.
    """
    marks = marked_joints(head)
    marks |= {name.replace(".L", ".R"): place * (-1, 1, 1) for name, place in marks.items() if ".L" in name}
    known = [name for name in marks if name in metarig]
    source = np.array([metarig[name] for name in known])
    _, once = np.unique(source.round(1), axis=0, return_index=True)
    target = np.array([marks[name] for name in known])
    warp = RBFInterpolator(source[once], target[once], kernel="thin_plate_spline", smoothing=1.0)
    fitted = {}
    for name, place in metarig.items():
        near = np.linalg.norm(source - place, axis=1)
        if near.min() < SAME_MM:
            fitted[name] = target[near.argmin()]
        else:
            fitted[name] = _on_skin(head, warp(place[None])[0])
    return fitted


def marked_joints(head: Head) -> Joints:
    """Return the joints of the middle and of the left side that the head's landmarks give, mm."""
    x, marks, curves = head.vertices, head.landmarks, head.curves

    def at(name: str) -> Place:
        return x[marks[name]]

    # points of the face that joints are built from
    on_midline = _midline(head)
    tip, top = at("nose_tip"), at("lip_upper_top")
    bridge = on_midline(0.0, -1.0)
    base = on_midline((tip[1] + top[1]) / 2, -1.0)
    chin, lip = at("chin"), at("lip_lower_bottom")
    under = _lowest_of_chin(head)
    lips = {side: _lip(head, side) for side in ("upper", "lower")}
    rim = x[head.grids["eye_left"][0]]  # from the outer corner over the upper lid to the inner one, and back below
    lids = [rim[round(share * len(rim)) % len(rim)] for share in np.arange(0, 1.01, 1 / 8)]
    brow = [x[curves["brow_left"][i]] for i in (-1, len(curves["brow_left"]) // 2, 0)]
    jaw_corner, cheek, wing = at("jaw_corner_left"), at("cheek_left"), at("nose_wing_left")
    eye = head.eyes["left"]
    inner = at("eye_inner_left")

    # nose, lips, jaw, cheeks, brows and eyes, by one joint each
    joints = {
        "nose:head": bridge,
        "nose:tail": on_midline(0.45 * tip[1], -1.0),
        "nose.001:tail": tip,
        "nose.002:tail": tip + 0.5 * (base - tip) + (0, -2.0, 0),
        "nose.003:tail": base,
        "nose.004:tail": 0.35 * base + 0.65 * top,
        "lip.T.L:head": lips["upper"][0],
        "lip.T.L:tail": lips["upper"][1],
        "lip.B.L:head": lips["lower"][0],
        "lip.B.L:tail": lips["lower"][1],
        "lip.T.L.001:tail": at("mouth_corner_left"),
        "jaw:tail": under,
        "jaw:head": under + 0.45 * (np.array([0, jaw_corner[1], jaw_corner[2]]) - under) + (0, -4.0, 0),
        "chin:tail": chin,
        "chin.001:tail": on_midline((chin[1] + lip[1]) / 2 + 2.0, -1.0),
        "jaw.L:tail": jaw_corner,
        "jaw.L.001:tail": _on_skin(head, 0.6 * under + 0.4 * jaw_corner + (4.0, -4.0, 4.0)),
        "cheek.T.L:tail": cheek,
        "cheek.B.L:tail": _on_skin(head, 0.5 * (cheek + at("mouth_corner_left")) + (14.0, -4.0, 0)),
        "cheek.T.L.001:tail": _on_skin(head, 0.6 * inner + 0.4 * np.array([wing[0], inner[1], inner[2]]) + (0, -7, 0)),
        "nose.L:tail": wing,
        "brow.T.L:tail": brow[0],
        "brow.T.L.001:tail": brow[1],
        "brow.T.L.002:tail": brow[2],
        "eye.L:head": eye.centre,
        "eye.L:tail": eye.centre + np.array([0, 0, 1.2 * eye.radius]),
        "temple.L:tail": _beside(head, head.jaw_pivot),
    }

    # the chains of the lids, and of the lower brow half-way between upper lid and brow
    for i in range(4):
        joints[f"lid.T.L{_suffix(i)}:head"] = lids[i]
        joints[f"lid.B.L{_suffix(i)}:head"] = lids[4 + i]
    for i, lid in enumerate(lids[:5]):
        above = np.array([np.interp(-lid[0], [-b[0] for b in brow], [b[k] for b in brow]) for k in range(3)])
        place = _on_skin(head, 0.45 * above + 0.55 * lid)
        joints[f"brow.B.L{_suffix(min(i, 3))}:{'head' if i < 4 else 'tail'}"] = place
    return joints | _ear(head) | _inside(head)


def _ear(head: Head) -> Joints:
    """Return the joints of the left ear, around its rim: from the front over the top and the back to the lobe."""
    ear = head.vertices[np.array(head.part_names)[head.part] == "ear_left"]
    y, z = ear[:, 1], ear[:, 2]
    front = ear[np.argmax(z - 0.2 * np.abs(y - y.mean()))]
    top = ear[np.argmax(y + 0.5 * z)]
    back = ear[np.argmax(y - 1.0 * z)]
    behind = ear[np.argmin(z + 0.5 * y)]
    lobe = ear[np.argmin(y)]
    joints = {"ear.L:head": front, "ear.L:tail": top, "ear.L.001:tail": back, "ear.L.002:tail": behind}
    return joints | {"ear.L.003:tail": lobe}


def _suffix(i: int) -> str:
    """Return the end of a bone's name by which Blender counts: nothing, .001, .002 …"""
    return f".{i:03d}" if i else ""


def _inside(head: Head) -> Joints:
    """Return the joints of teeth, tongue and neck, which lie in the middle plane inside the head."""
    x, parts = head.vertices, np.array(head.part_names)[head.part]
    joints = {}
    for bone, jaw in (("teeth.T", "tooth_upper"), ("teeth.B", "tooth_lower")):
        teeth = x[np.char.startswith(parts, jaw)]
        height = teeth[:, 1].mean()
        joints[f"{bone}:head"] = np.array([0, height, teeth[:, 2].max()])
        joints[f"{bone}:tail"] = np.array([0, height, teeth[:, 2].min()])
    rings = x[head.grids["tongue"]].mean(axis=1) * (0, 1, 1)  # from the root to the tip
    steps = np.arange(len(rings)) / (len(rings) - 1)
    tongue = np.stack([np.interp([1, 2 / 3, 1 / 3, 0], steps, column) for column in rings.T], axis=1)
    for i in range(3):
        joints[f"tongue{_suffix(i)}:head"] = tongue[i]
        joints[f"tongue{_suffix(i)}:tail"] = tongue[i + 1]
    neck = x[parts == "neck"]
    bottom = neck[neck[:, 1] < neck[:, 1].min() + 5.0].mean(axis=0) * (0, 1, 1)
    pivot = np.array([0, head.jaw_pivot[1] - 20.0, head.jaw_pivot[2] - 18.0])  # where the skull sits on the spine
    joints |= {
        "spine.004:head": bottom,
        "spine.004:tail": (bottom + pivot) / 2,
        "spine.005:tail": pivot,
        "spine.006:tail": np.array([0, x[:, 1].max(), pivot[2]]),
        "face:head": pivot,
        "face:tail": (pivot + np.array([0, x[:, 1].max(), pivot[2]])) / 2,
    }
    return joints


def _midline(head: Head):
    """Return a function of y and an offset z, mm, that gives the point of the face's middle line at this height."""
    x = head.vertices[head.curves["midline"]]
    line = x[x[:, 2] > head.jaw_pivot[2] + 20.0]

    def place(height: float, forward: float) -> Place:
        nearest = line[np.argmin(np.abs(line[:, 1] - height))]
        return nearest + np.array([0, 0, forward])

    return place


def _lowest_of_chin(head: Head) -> Place:
    """Return the lowest point of the middle line under the chin."""
    x = head.vertices[head.curves["midline"]]
    chin = head.vertices[head.landmarks["chin"]]
    behind = x[(x[:, 2] > chin[2] - 22.0) & (x[:, 2] < chin[2] - 8.0) & (x[:, 1] < chin[1])]
    return behind[np.argmin(behind[:, 1])] if len(behind) else chin + np.array([0, -10.0, -12.0])


def _lip(head: Head, side: str) -> tuple[Place, Place]:
    """Return two points of a lip's red: in the middle of the mouth, and half-way to the left corner."""
    x = head.vertices
    red = (x[head.curves[f"lip_{side}"]] + x[head.curves[f"seam_{side}"]]) / 2
    k = len(red) // 2
    places = [_on_skin(head, red[i]) for i in (k, k // 2)]
    places[0][0] = 0.0
    return places[0], places[1]


def _beside(head: Head, place: Place) -> Place:
    """Return the skin's point to the left of a place in the middle plane."""
    skin = head.vertices[_skin(head)]
    skin = skin[skin[:, 0] > 20.0]
    return skin[np.argmin(np.linalg.norm(skin[:, 1:] - place[1:], axis=1))]


def _skin(head: Head) -> np.ndarray:
    """Return the vertices of the skin."""
    return np.flatnonzero(np.isin(np.array(head.part_names)[head.part], SKIN))


def _on_skin(head: Head, place: Place) -> Place:
    """Return a place projected onto the skin's tangent plane at the nearest vertex."""
    skin = _skin(head)
    nearest = skin[np.argmin(np.linalg.norm(head.vertices[skin] - place, axis=1))]
    a, b, c = head.vertices[head.faces[(head.faces == nearest).any(axis=1)]].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a).sum(axis=0)
    normal /= np.linalg.norm(normal)
    return place + ((head.vertices[nearest] - place) @ normal) * normal


HANGING = 0.5  # the share of the mouth's bag that follows the lips, less and less inwards
BETWEEN_JAWS_MM = 24.0  # the height over which the bag goes from the lower teeth to the upper ones
EYE_ROWS, EYE_COLUMNS = 14, 24  # of an eyeball's vertices


def write_head_file(head: Head, metarig: Joints, path: Path) -> None:
    """Write vertices (mm), triangles, charts, labels and joints of a head and two eyeballs as .npz.

    A triangle's label is the segment of most of its corners.
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
    """Return how each vertex of the mouth's bag follows lips and teeth.

    Columns: the vertex; a vertex of the lips; the share of its motion that the bag's vertex follows; the share of the
    upper teeth in the rest.
    """
    x, rings, seam = head.vertices, head.grids["mouth_bag"], head.grids["mouth"][0]
    bag = np.flatnonzero(np.array(head.part_names)[head.part] == "mouth_bag")
    share, lip = np.zeros(len(x)), np.full(len(x), seam[0])
    for k, ring in enumerate(rings):
        share[ring] = np.interp(k / (len(rings) - 1), [0, HANGING], [1.0, 0.0])
        lip[ring] = seam
    upper = np.clip((x[:, 1] - x[seam, 1].mean()) / BETWEEN_JAWS_MM + 0.5, 0.0, 1.0)
    return np.stack([bag, lip[bag], share[bag], upper[bag]], axis=1)


def eyeball(eye: Eye) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "f 3"], Float[np.ndarray, "k 2"]]:
    """Return the vertices (mm), triangles and chart of an eyeball: rings about the gaze, open at the back."""
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
    """Return triangles turned so that they face away from the origin."""
    a, b, c = places[faces].transpose(1, 0, 2)
    inwards = np.einsum("fk,fk->f", np.cross(b - a, c - a), a) < 0
    return np.where(inwards[:, None], faces[:, [0, 2, 1]], faces)
