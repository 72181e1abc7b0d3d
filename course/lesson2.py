"""What lesson 2 works on and draws with: poses of a rig that are known by their results alone, and pictures of fits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from course.lesson1 import props_of
from data_recipes.face_rig import FaceRig
from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.samples import choose_poses
from replicate.baselines.ridge import ridges
from replicate.config import SamplesConfig
from replicate.drawing.heatmap import middle_line, normal_bar, normal_heat, split_face
from replicate.drawing.panels import MEASURES, Words, error_scale, panel_grid, tidy
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.geometry.mesh import Mesh

if TYPE_CHECKING:
    import matplotlib.figure

LIMIT_DEG = 20.0  # the end of the heatmaps' scale
ROOM = 1.2  # for heads that a shape stretches
STRENGTH = 1e-4  # λ of the first picture's line


@dataclass(frozen=True)
class Poses:
    """Poses to learn from, and held-out poses to judge by.

    mesh: of the face. inputs, test_inputs: (b, m) and (t, m), controls over their scale, so that they are about 1.
    offsets, test_offsets: (b, n, 3) and (t, n, 3) mm, from the neutral face. test_params: (t, m), raw controls.
    """

    mesh: Mesh
    inputs: np.ndarray
    offsets: np.ndarray
    test_inputs: np.ndarray
    test_offsets: np.ndarray
    test_params: np.ndarray


def known_poses(rig: FaceRig, count: int = 600, held_out: int = 60) -> Poses:
    """Return poses as the suite draws them (Eq. 5), and held-out frames of clips of which no other frame is used.

    count: poses to learn from. held_out: poses to judge by.
    """

    def stream(name: str) -> np.random.Generator:
        return np.random.default_rng([2, *name.encode()])

    chosen = choose_poses(rig, SamplesConfig(count=count, split="clips"), stream)
    params, test = chosen["training"], chosen["test"]
    test = test[np.linspace(0, len(test) - 1, held_out).round().astype(int)]
    scale, neutral = parameter_scale(params), rig.mesh.neutral
    return Poses(rig.mesh, params / scale, rig(params) - neutral, test / scale, rig(test) - neutral, test)


def errors(poses: Poses, predicted: Float[np.ndarray, "t n 3"]) -> tuple[float, float]:
    """Return the mean distance, mm, and the mean angle between normals, degrees, of offsets in the held-out poses."""
    neutral, faces = poses.mesh.neutral, poses.mesh.faces
    ours, truth = (np.asarray(offsets, np.float32) + neutral for offsets in (predicted, poses.test_offsets))
    return float(vertex_error(ours, truth).mean()), float(np.nanmean(normal_error(ours, truth, faces)))


def eyes_of(rig: FaceRig, poses: Poses, pose: int) -> list[Surface]:
    """Return the eyeballs of a held-out pose."""
    return eyes_in(rig, poses.test_params[pose], poses.mesh.neutral + poses.test_offsets[pose])


def eyes_in(rig: FaceRig, params: Float[np.ndarray, " m"], vertices: Float[np.ndarray, "n 3"]) -> list[Surface]:
    """Return the eyeballs that controls turn, in a face of these vertices."""
    return prop_surfaces(p for p in props_of(rig, params, vertices) if p[0].startswith("eye_"))


def fit_picture(
    rig: FaceRig,
    poses: Poses,
    pose: int,
    fits: Mapping[str, Float[np.ndarray, "n 3"]],
    clay: bool = True,
    width: int = 270,
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a held-out pose as the rig has it, and as fits do with their normal errors in colours.

    rig, poses: of the face.
    pose: its place among the held-out ones.
    fits: offsets by title, mm.
    clay: False leaves out the fits' surfaces.
    width: of a picture, pixels.
    """
    neutral, faces, height = poses.mesh.neutral, poses.mesh.faces, round(1.1 * width)
    view, truth = camera_for("front", neutral), neutral + poses.test_offsets[pose]
    eyes = eyes_of(rig, poses, pose)
    pictures, titles, means = [render([Surface(truth, faces), *eyes], view, width, height)], ["the rig"], []
    for title, offsets in fits.items():
        vertices = np.asarray(neutral + offsets, np.float32)
        if clay:
            pictures.append(render([Surface(vertices, faces), *eyes], view, width, height))
        pictures.append(render([normal_heat(vertices, truth, faces, LIMIT_DEG)], view, width, height))
        mean = float(np.nanmean(normal_error(vertices, truth, faces)))
        titles += [title, "its normal error"] if clay else [title]
        means.append(f"{title} {mean:.2f}°")
    figure = panel_grid([pictures], titles, bar=(0, 0, lambda figure, axes: normal_bar(figure, axes, LIMIT_DEG)))
    return figure, Words(
        f"A held-out pose of {rig.name}: the rig, and normal errors as colours; on average: {', '.join(means)}.",
        f"A held-out pose of {rig.name}. Mean angle between its normals and the rig's: {', '.join(means)}.",
    )


def halves(
    rig: FaceRig,
    poses: Poses,
    pose: int,
    offsets: Float[np.ndarray, "n 3"],
    title: str,
    width: int = 250,
) -> "matplotlib.figure.Figure":
    """Return a picture of a held-out pose: its left half the rig's, its right half of other offsets.

    rig, poses: of the face.
    pose: its place among the held-out ones.
    offsets: mm.
    title: of the picture.
    width: pixels.
    """
    neutral, height = poses.mesh.neutral, round(1.1 * width)
    view, truth = camera_for("front", neutral), neutral + poses.test_offsets[pose]
    eyes = eyes_of(rig, poses, pose)
    left, right = (
        render([Surface(np.asarray(x, np.float32), poses.mesh.faces), *eyes], view, width, height)
        for x in (truth, neutral + offsets)
    )
    line = middle_line(neutral, truth, poses.mesh.faces, view, width, height)
    return panel_grid([[split_face(left, right, line)]], [title])


def first_line(poses: Poses) -> Float[np.ndarray, "t n 3"]:
    """Return the suite's straight line in the held-out poses, offsets in mm, for the picture that opens the lesson."""
    flat = poses.offsets.reshape(len(poses.offsets), -1)
    (line,) = ridges("linear", poses.inputs, flat, (STRENGTH,))
    return line(poses.test_inputs).reshape(poses.test_offsets.shape)


def shapes_picture(
    rig: FaceRig,
    mean: Float[np.ndarray, "n 3"],
    shapes: Float[np.ndarray, "c n 3"],
    sizes: Sequence[float],
    width: int = 180,
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the mean face of a rig with some shapes added and, below, subtracted.

    sizes: the coefficient of each shape, mm. width: of a picture, pixels.
    """
    mesh = rig.mesh
    view = camera_for("front", mesh.neutral)
    view, rows = replace(view, height_mm=ROOM * view.height_mm), []
    for sign in (1, -1):
        faces = [
            np.float32(mesh.neutral + mean + sign * size * shape) for size, shape in zip(sizes, shapes, strict=False)
        ]
        surfaces = [[Surface(x, mesh.faces), *eyes_in(rig, rig.default, x)] for x in faces]
        rows.append([render(each, view, width, round(1.1 * width)) for each in surfaces])
    figure = panel_grid(rows, [f"shape {k + 1}" for k in range(len(sizes))], ["added", "subtracted"])
    return figure, Words(
        f"Clay renders of the mean face with each of {len(sizes)} principal shapes added and subtracted.",
        "The mean face with your first shapes, each twice its standard deviation over the poses. Nobody sculpted them.",
    )


def error_chart(
    counts: Sequence[int],
    curves: Mapping[str, Sequence[tuple[float, float]]],
    levels: Mapping[str, tuple[float, float]],
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): errors in mm and in degrees against the number of shapes.

    counts: of shapes. curves: by name, what `errors` gives at each count. levels: the same where no shapes are counted.
    """
    from matplotlib.figure import Figure

    figure = Figure((10, 4.4), dpi=100, layout="constrained")
    for which, (axes, (_, _, label)) in enumerate(zip(figure.subplots(1, 2), MEASURES, strict=True)):
        for (name, curve), style in zip(curves.items(), ("o-", "s-", "D--", "^--"), strict=False):
            axes.plot(counts, [point[which] for point in curve], style, label=name)
        for (name, level), colour in zip(levels.items(), ("#555555", "#999999"), strict=False):
            axes.axhline(level[which], color=colour, linestyle=":", label=name)
        axes.set(xscale="log", xlabel="shapes", ylabel=label)
        axes.set_xticks(counts, [str(count) for count in counts])
        tidy(axes)
        error_scale(axes, "y")
        axes.minorticks_off()
    handles, names = axes.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=3, frameon=False)
    last = "; ".join(f"{name} {curve[-1][0]:.2f} mm, {curve[-1][1]:.2f}°" for name, curve in curves.items())
    return figure, Words(
        f"Mean errors in held-out poses against the number of shapes, in mm and in degrees. With {counts[-1]}: {last}.",
        f"Mean errors in held-out poses, which are of other clips. With {counts[-1]} shapes: {last}.",
    )
