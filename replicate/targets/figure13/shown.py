"""Figure 13 in pictures and tables: the original in one pose, and the meshes that are moved like it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.marks import wireframe
from replicate.drawing.panels import Words
from replicate.drawing.prop_surfaces import carry_props, prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, frame_surfaces
from replicate.methods import artefacts
from replicate.report.results import Row, characters_of, find, most_seeds, seeds_in_words
from replicate.report.tables import Table, our_value
from replicate.targets.figure13 import moved as figure13_moved
from replicate.targets.figure13.moved import ORIGINAL, Mean
from replicate.transfer.landmark_alignment import face_of

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
HEAD, CLOSE = 1.3, 0.9  # a picture's height over its width
RIBBON_MM = 0.2
CARRIED = ("coarse", "coarse_carried")  # maps read at the new vertices, and the prediction carried over to them


@dataclass(frozen=True)
class ShownMesh:
    """A mesh in the shown pose.

    neutral: (k, 3) mm. faces: (g, 3). vertices: "truth" and the ways to move the mesh → (k, 3) mm. props: from
    `rig.pose_props`, for the true skin.
    """

    neutral: np.ndarray
    faces: np.ndarray
    vertices: dict[str, np.ndarray]
    props: tuple = field(default=())


def shown_meshes(inputs: Mapping[str, Path]) -> dict[str, ShownMesh]:
    """Return the original and the new meshes in the pose that figures show."""
    rig, params = (
        artefacts.load_rig(inputs),
        artefacts.load_samples(inputs).test_params[artefacts.load_shown_pose(inputs)],
    )
    faces = figure13_moved.faces_of(rig.mesh, figure13_moved.deforming(inputs, rig.mesh))
    meshes = {ORIGINAL: (rig.mesh.neutral, faces)}
    meshes |= {name: (new.mesh.neutral, new.mesh.faces) for name, new in figure13_moved.load_meshes(inputs).items()}
    props = tuple(rig.pose_props(params))
    return {
        name: ShownMesh(*mesh, figure13_moved.load_moved_pose(inputs, name), props) for name, mesh in meshes.items()
    }


def figure13(
    character: str, shown: Mapping[str, ShownMesh], means: Sequence[Mean], across: int | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Draw the head, and the mouth close up with its triangles, for each mesh and way; return (figure, words).

    shown: the meshes by name
    means: mean errors, for the caption
    across: the width of one picture, pixels; None for what fills the sheet
    """
    columns = 1 + len(NEW)
    width = across or cell_width(columns)
    original, cells = shown[ORIGINAL], []
    for name, first in zip(figure13_moved.SHARES, (TRUTH, "coarse"), strict=True):
        for mesh, way in ((ORIGINAL, first), *((name, way) for way in NEW)):
            title = TITLES.get((mesh, way), TITLES[way])
            count = len(np.unique(shown[mesh].faces))
            title = f"{title}: {count:,} vertices" if way == TRUTH else title
            lines = () if way == TRUTH else _errors(shown[mesh], way)
            cells.append(Cell(title, _pictures(shown[mesh], way, original, width), lines))
    return face_sheet(cells, columns), _words(character, shown, means)


def _pictures(mesh: ShownMesh, way: str, original: ShownMesh, width: int) -> tuple:
    vertices = mesh.vertices[way]
    surfaces = [Surface(vertices, mesh.faces), *prop_surfaces(carry_props(mesh.props, mesh.vertices[TRUTH], vertices))]
    head, close = _head(original, 1 / HEAD), camera_for("mouth", original.neutral)
    ribbons = wireframe(vertices, mesh.faces, close, RIBBON_MM)
    return (
        render(surfaces, head, width, round(HEAD * width)),
        render([*surfaces, ribbons], close, width, round(CLOSE * width)),
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
    phrases = [f"{names[way]} on {MESHES[name]}, {' and '.join(_errors(shown[name], way))}" for name, way in pairs]
    return Words(
        "Two rows of four clay heads, their mouths close up below them with all edges. First in each row is the "
        "original mesh, above as the rig has it and below as the coarse networks have it. Then comes a mesh of half "
        "of its vertices, below of a quarter: the truth, moved by the coarse networks, moved by deformation transfer. "
        f"Mean errors: {'; '.join(phrases)}.",
        f"The coarse networks of {character} move meshes that they were never trained on (after Fig. 13), in the test "
        "pose whose forehead folds most. A vertex of a new mesh reads the maps at its own texture coordinates. The "
        "truth is what the rig does at its place on the original surface. Rigid segments, as teeth, are left out. "
        "Below: mean distance of vertices and mean angle between normals (Eq. 11) in this pose. "
        f"{_in_numbers(means)} † Each new triangle follows its nearest one on the rig's own posed mesh (Sumner and "
        "Popović 2004); the networks never see that mesh.",
    )


def _in_numbers(means: Sequence[Mean]) -> str:
    """Return the distances over the test poses on new meshes, and with charts that are off, in sentences."""
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
    """Return a length with its unit: "1 pixel", "0.5 pixels"."""
    return f"{count} pixel{'' if count == '1' else 's'}"


# Figure 13 between characters: the original in one pose, and other characters' faces that are moved like it.

MOVED = {"coarse": "coarse networks", "deformation_transfer": "deformation transfer †"}
OTHER_HEAD, OTHER_CLOSE = 1.35, 0.8  # a picture's height over its width


def sheet_of_others(
    character: str, inputs: Mapping[str, Path], folders: Mapping[str, Path], across: int | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a row for each other character's face, with its mouth close up below.

    folders: other characters' names → the artefacts of their stages. across: the width of one picture, pixels; None for
    what fills the sheet.
    """
    mesh = artefacts.load_mesh(inputs)
    width, cells, phrases = across or cell_width(2 + len(MOVED)), [], []
    for other, folder in folders.items():
        pose, about = figure13_moved.load_other_pose(folder), figure13_moved.load_alignment(folder)
        cells.append(
            Cell(f"{character}: the rig", _other_pictures(pose["source"], mesh.neutral, face_of(mesh).faces, width))
        )
        errors = {way: _other_errors(pose, way) if about["controls"] else () for way in MOVED}
        for way, title in MOVED.items():
            pictures = _other_pictures(pose[way], pose["head"], pose["faces"], width)
            cells.append(Cell(f"{other}: {title}", pictures, errors[way]))
        title = f"{other}: its own rig" if about["controls"] else f"{other}: neutral"
        cells.append(Cell(title, _other_pictures(pose["own"], pose["head"], pose["faces"], width)))
        phrases.append(_in_words(other, about, errors))
    return face_sheet(cells, 2 + len(MOVED)), Words(
        "Rows of four clay faces without eyes and teeth, their mouths close up below. First the face that the "
        "networks are trained on, then another character's face: moved by the coarse networks, moved by deformation "
        "transfer, and as its own rig has it. " + " ".join(phrases),
        f"The coarse networks of {character} move the faces of other characters (after Fig. 13), in the test pose "
        "whose forehead folds most. A thin-plate spline through landmarks that both have brings the other face to the "
        f"charts; offsets are scaled by the ratio of distances between landmarks. {' '.join(phrases)} Another person's "
        "own rig is no truth: it says how that person would do the same, with other folds and proportions. † Each "
        "triangle follows its nearest one on the rig's own posed mesh (Sumner and Popović 2004), aligned alike.",
    )


def _in_words(other: str, about: Mapping[str, float], errors: Mapping[str, tuple]) -> str:
    aligned = f"{other}: {about['landmarks']} landmarks, scale {about['scale']:.2f}"
    if not about["controls"]:
        return f"{aligned}; its rig has no control of the same name, so that its neutral face stands last."
    means = ", ".join(f"{MOVED[way].removesuffix(' †')} {' and '.join(pair)}" for way, pair in errors.items())
    return f"{aligned}, {about['controls']} controls of the same names; mean differences from its own rig: {means}."


def _other_pictures(posed: np.ndarray, neutral: np.ndarray, faces: np.ndarray, width: int) -> tuple[np.ndarray, ...]:
    surface, used = Surface(posed, faces), np.unique(faces)
    framed = Surface(posed[used], np.zeros((0, 3), np.int32))
    head = frame_surfaces(camera_for("front", neutral), [framed], 1 / OTHER_HEAD)
    return (
        render([surface], head, width, round(OTHER_HEAD * width)),
        render([surface], camera_for("mouth", neutral), width, round(OTHER_CLOSE * width)),
    )


def _other_errors(pose: Mapping[str, np.ndarray], way: str) -> tuple[str, str]:
    degrees = np.nanmean(normal_error(pose[way], pose["own"], pose["faces"]))
    return f"{vertex_error(pose[way], pose['own']).mean():.2f} mm", f"{degrees:.2f}°"


# Figure 13 in numbers: every way to move meshes of another topology, and what charts that are off cost.

MESHES = {"original": "its own mesh", "half": "half of the vertices", "quarter": "a quarter"}
LABELS = {
    "coarse": "Coarse networks",
    "refined": "Refined networks",
    "coarse_carried": "Coarse networks, carried from the own mesh",
    "deformation_transfer": "Deformation transfer of the rig's mesh †",
    "deformation_transfer_coarse": "Deformation transfer of the coarse networks' mesh",
    "neutral": "Neutral pose",
}
KINDS = (("vertex", "mm", "Distance error, mm"), ("normal", "deg", "Normal angle error, degrees"))
NOTES = (
    "Networks are trained on the own mesh and read at the texture coordinates of the new one. The truth is the rig's "
    "movement, carried to the new vertices by barycentric coordinates.",
    "Carried: the networks' movement of the own mesh, taken to the new vertices by the same coordinates as the truth.",
    "† Sumner and Popović 2004; it is handed the true mesh of each pose, which the networks are not.",
)
OTHER_NOTES = (
    "Networks of one character move another one's face, aligned by landmarks, offsets scaled by the distances between "
    "them. The numbers are differences from the other's own rig at the same numbers of the same controls.",
    "That rig is no truth: it is another person, who folds elsewhere. A difference of zero is out of reach.",
    NOTES[-1],
)


def tables13(ours: Sequence[Row]) -> list[Table]:
    """Return two tables for each character, of every way on every mesh and of charts that are off.

    Tables of other characters' faces follow if any were moved and measured.
    """
    rows = [row for row in ours if row.table == "figure13"]
    tables = [make(rows, character) for character in characters_of(rows) for make in (meshes_table, charts_table)]
    return tables + [table for character in characters_of(rows) if (table := others_table(rows, character))]


def meshes_table(rows: Sequence[Row], character: str) -> Table:
    """Return the mean errors of every way to move every mesh of one character."""
    rows = [row for row in rows if row.character == character]
    present = {row.method for row in rows}
    body: list[tuple[str, ...] | None] = []
    for kind, _, words in KINDS:
        body += [None] if body else []
        body.append((words, *[""] * len(MESHES)))
        for way in (way for way in LABELS if way in present):
            found = [find(rows, "figure13", character, way, f"{kind}_error_mean[{mesh}]") for mesh in MESHES]
            body.append((LABELS[way], *map(our_value, found)))
    return Table(
        f"Meshes of other topologies: {character}", (("", *MESHES.values()),), tuple(body), (*NOTES, _about(rows))
    )


def charts_table(rows: Sequence[Row], character: str) -> Table:
    """Return the mean errors of one character's coarse networks on charts that are shifted and turned."""
    pattern = re.compile(r"vertex_error_mean\[half\]\[(.+)\]")
    rows = [row for row in rows if row.character == character and row.method == "coarse"]
    charts = sorted((match[1] for row in rows if (match := pattern.fullmatch(row.metric))), key=_amount)
    body = []
    for chart in charts:
        cells = []
        for mesh in ("half", "quarter"):
            for kind, _, _ in KINDS:
                row = find(rows, "figure13", character, "coarse", f"{kind}_error_mean[{mesh}][{chart}]")
                cells.append(our_value(row))
        body.append((chart, *cells))
    spans = ("", MESHES["half"], "", MESHES["quarter"], "")
    notes = ("Shifts are in pixels of the coarse maps; every chart is moved on its own, in random directions.",)
    return Table(
        f"Charts that are off: {character}", (spans, ("", "mm", "degrees", "mm", "degrees")), tuple(body), notes
    )


def others_table(rows: Sequence[Row], character: str) -> Table | None:
    """Return the mean differences of other characters' faces, moved by every way, from their rigs; None for none."""
    pattern = re.compile(r"vertex_error_mean\[([^\]]+)\]")
    rows = [row for row in rows if row.character == character]
    named = dict.fromkeys(match[1] for row in rows if (match := pattern.fullmatch(row.metric)))
    others = [name for name in named if name not in MESHES]
    if not others:
        return None
    body = []
    for way in LABELS:
        cells = []
        for other in others:
            for kind, _, _ in KINDS:
                row = find(rows, "figure13", character, way, f"{kind}_error_mean[{other}]")
                cells.append(our_value(row))
        body.append((LABELS[way], *cells))
    spans = ("", *(cell for other in others for cell in (other, "")))
    units = ("", *("mm", "degrees") * len(others))
    return Table(f"Faces of other characters: {character}", (spans, units), tuple(body), (*OTHER_NOTES, _about(rows)))


def _amount(chart: str) -> tuple[str, float]:
    kind, amount, _ = chart.split(" ")
    return kind, float(amount)


def _about(rows: Sequence[Row]) -> str:
    poses = max((row.poses or 0 for row in rows), default=0)
    profiles = ", ".join(sorted({row.profile for row in rows}))
    return f"{poses} test poses; {seeds_in_words([most_seeds(rows)])}; profile {profiles}."
