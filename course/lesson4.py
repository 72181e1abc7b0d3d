"""What lesson 4 draws: faces in raking light and their normal errors, a wave cut through, degrees over millimetres."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.drawing.heatmap import normal_bar, normal_heat
from replicate.drawing.panels import enlarge, error_scale, panel_grid, tidy
from replicate.drawing.render import render
from replicate.report.pose_record import (
    TRUTH,
    WHOLE,
    PoseRecord,
    clay_surfaces,
    normal_means_deg,
    plain_name,
    vertex_mean_mm,
    view_of,
)

if TYPE_CHECKING:
    import matplotlib.figure

METHODS = ("linear", "lbs16", "lbs24", "lbs32", "dense", "refined", "regional")  # of a stored pose
LIMIT_DEG = 30.0  # the end of the heatmaps' colours
LAMP = np.array([0.87, 0.5])  # to a lamp that rakes from the right: along a profile, and up from it
SAMPLES = 2001  # points of a profile

Distance = Callable[[np.ndarray, np.ndarray], float]  # (predicted, target) → mm
Angle = Callable[[np.ndarray, np.ndarray, np.ndarray], float]  # (predicted, target, faces) → degrees


def pair_that_disagrees(record: PoseRecord) -> tuple[str, str]:
    """Return two methods: the first is nearer in millimetres, the second in degrees, by factors as large as any."""
    errors = {
        name: (vertex_mean_mm(record, name), normal_means_deg(record, name)[WHOLE])
        for name in METHODS
        if name in record.vertices
    }

    def gain(pair: tuple[str, str]) -> float:
        (a_mm, a_deg), (b_mm, b_deg) = (errors[name] for name in pair)
        return min(b_mm / a_mm, a_deg / b_deg)

    return max(permutations(errors, 2), key=gain)


def faces(
    record: PoseRecord, meshes: Mapping[str, Float[np.ndarray, "n 3"]], heat: bool = False, camera: str = "forehead"
) -> "matplotlib.figure.Figure":
    """Return pictures of surfaces in raking light, each under its title.

    record: for its triangles, its truth and its props
    meshes: title → vertices, mm
    heat: whether their normal errors stand below, as in Figure 10
    camera: one of `scene.CAMERAS`
    """
    width, height = (280, 250) if camera == "forehead" else (260, 325)
    view, truth = view_of(record, camera, width / height), record.vertices[TRUTH]
    clay = [
        render(
            clay_surfaces(replace(record, vertices={TRUTH: truth, "shown": mesh}), "shown", False), view, width, height
        )
        for mesh in (np.asarray(each, np.float32) for each in meshes.values())
    ]
    if not heat:
        return panel_grid([clay], list(meshes))
    hot = [
        render([normal_heat(np.asarray(mesh, np.float32), truth, record.faces, LIMIT_DEG)], view, width, height)
        for mesh in meshes.values()
    ]
    titles = [list(meshes), [""] * len(meshes)]
    return panel_grid([clay, hot], titles, bar=(1, 1, lambda figure, axes: normal_bar(figure, axes, LIMIT_DEG)))


def profile(wavelength_mm: float, amplitude_mm: float) -> "matplotlib.figure.Figure":
    """Return a cut through 40 mm of skin with a wave on it, and what raking light makes of it, seen from above.

    amplitude_mm: half of the height from crest to trough.
    """
    from matplotlib.figure import Figure

    x = np.linspace(0, 40, SAMPLES)
    angle = 2 * np.pi * x / wavelength_mm
    up, slope = amplitude_mm * np.sin(angle), amplitude_mm * 2 * np.pi / wavelength_mm * np.cos(angle)
    normals = np.stack([-slope, np.ones_like(slope)], -1) / np.hypot(slope, 1)[:, None]
    light = np.maximum(normals @ LAMP, 0)
    figure = Figure((3.3, 2.3), dpi=100)
    top, strip = figure.subplots(2, 1, height_ratios=(1.6, 1), sharex=True)
    top.fill_between(x, -2, up, color="#d9c3b0", linewidth=0)
    top.plot(x, up, color="#7a4a2a", linewidth=1.2)
    for k in range(40, SAMPLES, 80):
        top.plot(*zip((x[k], up[k]), (x[k], up[k]) + 1.6 * normals[k], strict=True), color="#31688e", linewidth=0.8)
    top.set(ylim=(-2, 4), xlim=(0, 40), aspect="equal", yticks=[])
    top.tick_params(bottom=False)
    top.set_title(
        f"wave of {wavelength_mm:g} mm, {2 * amplitude_mm:g} mm high\n"
        f"{np.abs(up).mean():.2f} mm off, {np.degrees(np.arctan(np.abs(slope))).mean():.1f}°",
        fontsize=9,
    )
    strip.imshow(light[None], extent=(0, 40, 0, 6), cmap="gray", vmin=0, vmax=1.0, aspect="equal")
    strip.set(yticks=[])
    strip.set_xlabel("mm", fontsize=8)
    for axes in (top, strip):
        axes.tick_params(labelsize=8)
        axes.spines[:].set_visible(False)
    figure.tight_layout(pad=0.6, h_pad=0.2)
    return figure


def chart(
    records: Mapping[str, PoseRecord], distance: Distance, angle: Angle, waves_mm: tuple[float, ...]
) -> "matplotlib.figure.Figure":
    """Return degrees over millimetres of all methods, with a line for waves of each length that cost so much.

    records: a name for each pose → the pose.
    """
    from matplotlib.figure import Figure

    figure = Figure((9, 5.6), dpi=100)
    axes = figure.add_subplot()
    markers = dict(zip(records, "o^s", strict=False))
    colours = {name: f"C{k}" for k, name in enumerate(METHODS)}
    spots = []
    for pose, record in records.items():
        truth = record.vertices[TRUTH]
        for name in METHODS:
            guess = record.vertices[name]
            spots.append((distance(guess, truth), angle(guess, truth, record.faces)))
            axes.plot(*spots[-1], markers[pose], color=colours[name], markersize=9, markeredgecolor="white")
    (left, bottom), (right, top) = 0.7 * np.min(spots, 0), 1.4 * np.max(spots, 0)
    for wave in waves_mm:
        axes.plot((left, right), (360 * left / wave, 360 * right / wave), color="#999999", linewidth=0.8, zorder=0)
        if 360 * right / wave > top:  # the line ends at the upper edge, else at the right one
            axes.text(top * wave / 360, 1.03 * top, f"{wave:g} mm", color="#666666", ha="center", va="bottom")
        else:
            axes.text(1.03 * right, 360 * right / wave, f"{wave:g} mm", color="#666666", va="center")
    axes.set(
        xlim=(left, right), ylim=(bottom, top), xlabel="mean distance, mm", ylabel="mean angle of normals, degrees"
    )
    for axis in "xy":
        error_scale(axes, axis)
    handles = [axes.plot([], [], "o", color=colour, label=plain_name(name))[0] for name, colour in colours.items()]
    handles += [axes.plot([], [], mark, color="#555555", label=pose)[0] for pose, mark in markers.items()]
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(1.08, 0.5), frameon=False)
    tidy(axes)
    enlarge(axes, 11)
    figure.tight_layout()
    return figure
