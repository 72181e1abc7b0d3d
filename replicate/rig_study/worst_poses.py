"""The worst poses of a character: where its skin turns over, and where teeth leave the mouth."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from data_recipes.rig import Rig
from replicate.drawing.characters import BACKGROUND, segment_colours
from replicate.drawing.marks import ringed
from replicate.drawing.panels import Words, panel_grid
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, following
from replicate.geometry.mesh import Mesh
from replicate.rig_study.mouth_contents import depths, find_mouth
from replicate.rig_study.pose_health import Skin, worst

if TYPE_CHECKING:
    import matplotlib.figure

POSES, COLUMNS = 10, 5
FLIP_COLOUR, BESIDE, OUTSIDE = (220, 0, 110), (250, 190, 90), (220, 0, 110)
SKIN = (214, 206, 198)
LEAST = {"flips": 1e-9, "through": 0.05}  # a pose below these gets no picture: a share, mm


def worst_poses(
    rig: Rig, sets: Sequence, width: int = 250, height: int = 270
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the poses with most flipped triangles, then those whose teeth go furthest.

    sets: of poses, each with `kind`, `names` and `health`, as in the benchmark of poses
    width, height: of a picture, pixels
    """
    flips = _rank(sets, lambda health: health.flipped, "flips")
    deep = _rank(sets, lambda health: health.through.get("teeth", ()), "through")
    skin, mouth = Skin(rig.mesh), find_mouth(rig.mesh)
    pictures, titles = [], []
    for value, name, params in flips:
        vertices = rig(params)
        flipped = skin.flipped(vertices[None])[0]
        colours = _flip_colours(rig.mesh, skin, flipped)
        camera = following(camera_for("front", rig.mesh.neutral), rig.mesh.neutral, vertices)
        picture = _picture(rig, params, vertices, colours, camera, width, height)
        pictures.append(ringed(picture, vertices[skin.faces[flipped]].mean(1), camera, FLIP_COLOUR))
        titles.append(f"{name}: {100 * value:.2f} %")
    _fill(pictures, titles, width, height)
    for value, name, params in deep:
        vertices = rig(params)
        depth_mm = depths(mouth, vertices)
        out = np.zeros(len(vertices), bool)
        out[mouth.points[depth_mm > LEAST["through"]]] = True
        colours = segment_colours(rig.mesh, SKIN)
        colours[out[rig.mesh.faces].any(1)] = OUTSIDE
        camera = camera_for("mouth", rig.mesh.neutral)
        camera = following(camera, rig.mesh.neutral[mouth.points], vertices[mouth.points])
        picture = _picture(rig, params, vertices, colours, camera, width, height)
        pictures.append(ringed(picture, vertices[out], camera, OUTSIDE))
        titles.append(f"{name}: {value:.2f} mm")
    _fill(pictures, titles, width, height)
    if not pictures:
        pictures, titles = [np.full((height, width, 3), 255, np.uint8)], ["nothing found"]
    step = min(COLUMNS, len(pictures))
    rows = [pictures[k : k + step] for k in range(0, len(pictures), step)]
    figure = panel_grid(rows, [titles[k : k + step] for k in range(0, len(titles), step)])
    return figure, _words(rig, flips, deep)


def _words(rig, flips: list, deep: list) -> Words:
    most = f"up to {100 * flips[0][0]:.2f} % of the skin's triangles" if flips else "none"
    far = f"up to {deep[0][0]:.2f} mm" if deep else "nowhere"
    count = f"{len(flips)} with most flipped triangles ({most}), {len(deep)} with teeth furthest through skin ({far})"
    return Words(
        f"Renders of the character {rig.name} in its worst poses: {count}.",
        f"{rig.name}: {count}; of samples of training, frames of clips and single controls. Flipped triangles are "
        "magenta, those beside them orange; magenta are teeth, gums and tongue, too, where they have left the mouth. A "
        "ring is around each such place, hidden ones too.",
    )


def _rank(sets: Sequence, value_of, kind: str) -> list[tuple[float, str, np.ndarray]]:
    """Return the largest values of all sets with their poses' names and parameters, at most one from each clip."""
    entries: dict[str, tuple[float, str, np.ndarray]] = {}
    for poses in sets:
        values = value_of(poses.health)
        count = 0
        for k in worst(values, len(values)) if len(values) else ():
            source = poses.names[k].rsplit(" ", 1)[0] if poses.kind == "clips" else poses.names[k]
            if source not in entries and values[k] >= LEAST[kind]:  # a sample can be in two sets
                entries[source] = float(values[k]), poses.names[k], poses.health.params[k]
                count += 1
            if count == POSES:
                break
    return sorted(entries.values(), key=lambda entry: -entry[0])[:POSES]


def _flip_colours(mesh: Mesh, skin: Skin, flipped: Bool[np.ndarray, " f"]) -> np.ndarray:
    """Return each face's colour: flipped, beside a flipped one (which is easily missed by itself), or neither."""
    colours = segment_colours(mesh, SKIN)
    near = np.zeros(len(mesh.neutral), bool)
    near[skin.faces[flipped]] = True
    colours[near[mesh.faces].any(1)] = BESIDE
    colours[skin.face_indices[flipped]] = FLIP_COLOUR
    return colours


def _picture(rig, params, vertices, colours, camera: Camera, width: int, height: int) -> np.ndarray:
    surfaces = [Surface(vertices, rig.mesh.faces, colours), *prop_surfaces(rig.pose_props(params))]
    return render(surfaces, camera, width, height, BACKGROUND)


def _fill(pictures: list, titles: list, width: int, height: int) -> None:
    """Fill the last row with white pictures."""
    while len(pictures) % COLUMNS:
        pictures.append(np.full((height, width, 3), 255, np.uint8))
        titles.append("")
