"""The wrinkle model in pictures: compression painted on the face, and how a fold grows out of it."""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from data_recipes.rig import Rig
from replicate.drawing.panels import DPI, Words, panel_grid, tidy
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.rig_study.tour import clay, pose_params

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

NO_REGION = (205, 205, 205)
DIVERGING = "RdBu_r"  # red is compressed, blue is stretched, white is at rest
STEPS = np.linspace(0, 1, 13)


def strain(rig: Rig, params: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
    """Return c̃ at every vertex: where regions overlap, the one of larger size; NaN outside all of them."""
    compression = np.full(len(rig.mesh.neutral), np.nan)
    for state in rig.wrinkle_states(params).values():
        before = np.nan_to_num(compression[state.vertices])
        larger = np.abs(state.compression) >= np.abs(before)
        compression[state.vertices] = np.where(larger, state.compression, before)
    return compression


def strain_colours(strain: Float[np.ndarray, " n"], limit: float) -> UInt8[np.ndarray, "n 3"]:
    """Return each vertex's colour for a strain from −limit to limit; grey outside the regions."""
    from matplotlib import colormaps

    colours = np.rint(colormaps[DIVERGING](0.5 + np.nan_to_num(strain) / (2 * limit))[:, :3] * 255).astype(np.uint8)
    colours[np.isnan(strain)] = NO_REGION
    return colours


def strain_bar(figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes", limit: float) -> None:
    """Draw the bar of `strain_colours` in `axes`."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bar = figure.colorbar(ScalarMappable(Normalize(-100 * limit, 100 * limit), DIVERGING), cax=axes, extend="both")
    bar.set_label("compression, %", labelpad=0)
    bar.ax.tick_params(labelsize=8)
    bar.outline.set_linewidth(0.5)


def strain_sheet(
    rig: Rig, poses: Mapping[str, Float[np.ndarray, " m"]], limit: float = 0.2, width: int = 200, height: int = 218
) -> "tuple[matplotlib.figure.Figure, Words]":  # fmt: skip
    """Return (figure, words): the diffused compression of every region in some poses, and the folds that it raises.

    rig: one with wrinkles
    poses: raw rig parameters by title
    limit: the strain with the last colour
    width, height: of a picture, pixels
    """
    view = camera_for("front", rig.mesh.neutral)
    draw = partial(render, camera=view, width=width, height=height)
    strain_row, clay_row, percentages = [], [], []
    for title, params in poses.items():
        vertices, compression = rig(params), strain(rig, params)
        paint = strain_colours(compression, limit)
        strain_row.append(draw([Surface(vertices, rig.mesh.faces, lit=False, paint=paint)]))
        clay_row.append(draw(clay(rig, vertices, params)))
        percentages.append(f"{title} {100 * np.nanmax(compression):.0f} %")
    figure = panel_grid(
        [strain_row, clay_row], list(poses), ("compression", "surface"), (0, 0, partial(strain_bar, limit=limit))
    )
    return figure, Words(
        f"The character {rig.name} in {len(poses)} poses, above coloured by compression, below as clay. Largest "
        f"compression: {', '.join(percentages)}.",
        f"Compression c̃ across the folds of each region of {rig.name}; grey skin is in no region. Largest: "
        f"{', '.join(percentages)}.",
    )


def fold_chart(
    rig: Rig, amounts: Mapping[str, float], region: str = "forehead"
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): one region while controls rise from 0 to these amounts.

    Left, the vertex that ends highest: compression, its excess over the threshold, height. Middle: excess against
    compression, every vertex at every step. Right: the profile of the folds along the region's middle line.
    """
    from matplotlib.figure import Figure

    # the region at each step, and the vertex that ends highest
    whole = pose_params(rig, amounts)
    states = [rig.wrinkle_states(rig.default + step * (whole - rig.default))[region] for step in STEPS]
    last = states[-1]
    best = int(np.argmax(np.abs(last.height_mm)))
    figure = Figure((10, 3.1), dpi=DPI, layout="constrained")
    growth, soft, profile = figure.subplots(1, 3)
    # left: growth at that vertex
    growth.plot(100 * STEPS, [100 * s.compression[best] for s in states], color="#0072B2", label="c̃, %")
    growth.plot(100 * STEPS, [100 * s.excess[best] for s in states], color="#E69F00", label="c₊, %")
    height = growth.twinx()
    height.plot(100 * STEPS, [abs(s.height_mm[best]) for s in states], color="#D55E00", label="height, mm (right)")
    height.set_ylim(bottom=0)
    growth.set_xlabel("controls, % of the pose")
    lines = [*growth.get_lines(), *height.get_lines()]
    growth.legend(lines, [line.get_label() for line in lines], fontsize=7, loc="upper left", frameon=False)
    # middle: the soft threshold
    c, over = (100 * np.concatenate([getattr(s, part) for s in states]) for part in ("compression", "excess"))
    soft.scatter(c, over, s=1.5, color="#0072B2", linewidths=0)
    soft.axvline(100 * last.threshold.min(), color="black", linewidth=0.6, linestyle=":")
    soft.set_xlim(left=-5)
    soft.set_xlabel("compression c̃, %")
    soft.set_ylabel("excess c₊, %")
    # right: the profile along the middle line
    line, along = middle_line(rig.mesh.neutral[last.vertices])
    for step in (3, 6, 9, 12):
        share = f"{100 * STEPS[step]:.0f} %"
        colour = str(0.9 * (1 - step / 12))
        profile.plot(along, states[step].height_mm[line], color=colour, linewidth=1, label=share)
    profile.set_xlabel("up the middle of the region, mm")
    profile.set_ylabel("height of the folds, mm")
    profile.legend(fontsize=7, frameon=False)
    for axes in (growth, soft, profile):
        tidy(axes)
    section = last.height_mm[line]
    top, under = section.max(), section.min()
    return figure, Words(
        f"Three charts of the {region} of {rig.name} while controls rise: growth at one vertex, the soft threshold, "
        f"and the profile of the folds, from {under:.2f} to {top:.2f} mm.",
        f"The {region} of {rig.name} as its controls rise from 0 to the pose. Left: the vertex that moves most. "
        f"Middle: nothing folds below {100 * last.threshold.min():.1f} % (dotted), the shallowest not below "
        f"{100 * last.threshold.max():.1f} %. Right: their section, from {under:.2f} to {top:.2f} mm in the end.",
    )


def middle_line(places: Float[np.ndarray, "s 3"], half_width_mm: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices near the region's middle from bottom to top, and how far up each lies in mm."""
    middle = np.median(places[:, 0])
    near = np.flatnonzero(np.abs(places[:, 0] - middle) < half_width_mm)
    order = near[np.argsort(places[near, 1])]
    return order, places[order, 1] - places[order, 1].min()
