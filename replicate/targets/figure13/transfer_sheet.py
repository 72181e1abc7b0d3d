"""Figure 13: the original in one pose, and new meshes of half and a quarter of its vertices that are moved like it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.artefacts import built_rig, drawn_samples, shown_pose
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.panels import Words
from replicate.drawing.prop_surfaces import carry_props, prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, frame_surfaces
from replicate.drawing.wireframe import wireframe
from replicate.targets.figure13 import moved_meshes, new_meshes
from replicate.targets.figure13.moved_meshes import ORIGINAL, Mean
from replicate.targets.figure13.transfer_tables import MESHES

if TYPE_CHECKING:
    import matplotlib.figure

TRUTH = "truth"
NEW = (TRUTH, "coarse", "deformation_transfer")  # the columns of a new mesh
TITLES = {
    (ORIGINAL, TRUTH): "The rig",
    (ORIGINAL, "coarse"): "Coarse: its own mesh",
    TRUTH: "Truth",
    "coarse": "Coarse: new mesh",
    "deformation_transfer": "Deformation transfer †",
}
LINES = ("distance", "normal error")
HEAD, CLOSE = 1.3, 0.9  # a picture's height over its width
RIBBON_MM = 0.2
CARRIED = ("coarse", "coarse_carried")  # read at the new vertices' coordinates, and taken to their places


@dataclass(frozen=True)
class ShownMesh:
    """A mesh in the shown pose.

    neutral: (k, 3); faces: (g, 3); vertices: "truth" and what moves it → (k, 3), mm. props: as `rig.pose_props` has
    them where the skin is the truth.
    """

    neutral: np.ndarray
    faces: np.ndarray
    vertices: dict[str, np.ndarray]
    props: tuple = field(default=())


def shown_meshes(inputs: Mapping[str, Path]) -> dict[str, ShownMesh]:
    """Return the original and the new meshes in the pose that figures show."""
    rig, params = built_rig.load(inputs), drawn_samples.load(inputs).test_params[shown_pose.load(inputs)]
    faces = new_meshes.faces_of(rig.mesh, new_meshes.deforming(inputs, rig.mesh))
    meshes = {ORIGINAL: (rig.mesh.neutral, faces)}
    meshes |= {name: (new.mesh.neutral, new.mesh.faces) for name, new in new_meshes.load(inputs).items()}
    props = tuple(rig.pose_props(params))
    return {name: ShownMesh(*mesh, moved_meshes.load_pose(inputs, name), props) for name, mesh in meshes.items()}


def figure13(
    character: str,
    shown: Mapping[str, ShownMesh],
    means: Sequence[Mean],
    across: int | None = None,
    renderer: str | None = None,
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the head, and the mouth close up with its triangles, for each mesh and way to move it.

    across: the width of one picture, pixels; None for what fills the sheet.
    """
    columns = 1 + len(NEW)
    width = across or cell_width(columns, LINES)
    original, cells = shown[ORIGINAL], []
    for name, first in zip(new_meshes.SHARES, (TRUTH, "coarse"), strict=True):
        for mesh, way in ((ORIGINAL, first), *((name, way) for way in NEW)):
            title = TITLES.get((mesh, way), TITLES[way])
            count = len(np.unique(shown[mesh].faces))
            title = f"{title}: {count:,} vertices" if way == TRUTH else title
            lines = () if way == TRUTH else _errors(shown[mesh], way)
            cells.append(Cell(title, _pictures(shown[mesh], way, original, width, renderer), lines))
    return face_sheet(cells, columns, LINES), _words(character, shown, means)


def _pictures(mesh: ShownMesh, way: str, original: ShownMesh, width: int, renderer: str | None) -> tuple:
    vertices = mesh.vertices[way]
    surfaces = [Surface(vertices, mesh.faces), *prop_surfaces(carry_props(mesh.props, mesh.vertices[TRUTH], vertices))]
    head, close = _head(original, 1 / HEAD), camera_for("mouth", original.neutral)
    ribbons = wireframe(vertices, mesh.faces, close, RIBBON_MM)
    return (
        render(surfaces, head, width, round(HEAD * width), renderer=renderer),
        render([*surfaces, ribbons], close, width, round(CLOSE * width), renderer=renderer),
    )


def _head(original: ShownMesh, aspect: float) -> Camera:
    used = original.vertices[TRUTH][np.unique(original.faces)]
    shown = [Surface(used, np.zeros((0, 3), np.int32)), *prop_surfaces(original.props)]
    return frame_surfaces(camera_for("front", original.neutral), shown, aspect)


def _errors(mesh: ShownMesh, way: str) -> tuple[str, str]:
    used = np.unique(mesh.faces)
    moved, truth = mesh.vertices[way], mesh.vertices[TRUTH]
    degrees = np.nanmean(normal_error(moved, truth, mesh.faces))
    return f"{vertex_error(moved[used], truth[used]).mean():.2f} mm", f"{degrees:.2f}°"


def _words(character: str, shown: Mapping[str, ShownMesh], means: Sequence[Mean]) -> Words:
    pairs = [(name, way) for name, mesh in shown.items() for way in NEW[1:] if way in mesh.vertices]
    names = {"coarse": "coarse networks", "deformation_transfer": "deformation transfer"}
    own = [f"{names[way]} on {MESHES[name]}, {' and '.join(_errors(shown[name], way))}" for name, way in pairs]
    return Words(
        "Two rows of four clay heads, their mouths close up below them with all edges. First in each row is the "
        "original mesh, above as the rig has it and below as the coarse networks have it. Then comes a mesh of half "
        "of its vertices, below of a quarter: the truth, moved by the coarse networks, moved by deformation transfer. "
        f"Mean errors: {'; '.join(own)}.",
        f"The coarse networks of {character} move meshes that they were never trained on (after Fig. 13), in the test "
        "pose whose forehead folds most. A vertex of a new mesh reads the maps at its own texture coordinates. The "
        "truth is what the rig does at its place on the original surface. Rigid segments, as teeth, are left out. "
        "Below: mean distance of vertices and mean angle between normals (Eq. 11) in this pose. "
        f"{_in_numbers(means)} † Each new triangle follows its nearest one on the rig's own posed mesh (Sumner and "
        "Popović 2004); the networks never see that mesh.",
    )


def _in_numbers(means: Sequence[Mean]) -> str:
    """Return what new places and charts that are off do to the distance over the test poses, in sentences."""
    mm = {(mean.mesh, mean.method, mean.charts): f"{mean.distance_mm:.2f} mm" for mean in means}
    poses = {mean.charts: mean.poses for mean in means}
    read, carried = (" and ".join(mm[name, way, ""] for name in MESHES if name != ORIGINAL) for way in CARRIED)
    shifts = [charts for charts in poses if charts.startswith("shift")]
    off = ", ".join(f"{in_pixels(charts.split()[1])} {mm['half', 'coarse', charts]}" for charts in shifts)
    return (
        f"Over {poses['']} test poses the distances are {read}; carried over from the networks' prediction for the "
        f"original mesh they are {carried}. Charts shifted on half of the vertices ({poses[shifts[0]]} poses): {off}."
    )


def in_pixels(count: str) -> str:
    """Return a number of pixels with its unit: "1 pixel", "0.5 pixels"."""
    return f"{count} pixel{'' if count == '1' else 's'}"
