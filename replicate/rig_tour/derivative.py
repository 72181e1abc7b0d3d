"""The exact derivative of a rig by one control as a heatmap, and how far finite differences are from it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from data_recipes.rig import Rig
from replicate.drawing.heatmap import error_colours
from replicate.drawing.panels import Words, panel_grid
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.engine.exceptions import InputError
from replicate.rig_tour.layers import scale_for, share_bar

if TYPE_CHECKING:
    import matplotlib.figure

STEP = 4e-3  # of the control, for central differences


def derivative_sheet(
    rig: Rig, control: str, poses: Mapping[str, Float[np.ndarray, " m"]], camera: str = "front", width: int = 230,
    height: int = 250, renderer: str | None = None,
) -> "tuple[matplotlib.figure.Figure, Words]":  # fmt: skip
    """Return (figure, words): |∂V/∂p| of one control in some poses, and its change from the first.

    Raises InputError if there is no such control.
    """
    names = [c.name for c in rig.controls]
    if control not in names:
        raise InputError(f"rig '{rig.name}': it has no control '{control}'; allowed are {', '.join(names)}.")
    column = names.index(control)
    exact = [rig.jacobian(params, [column])[:, :, 0] for params in poses.values()]
    differences = [central(rig, params, column) for params in poses.values()]
    apart = max(np.abs(one - other).max() for one, other in zip(exact, differences, strict=True))
    lengths = [np.linalg.norm(derivative, axis=1) for derivative in exact]
    changes = [np.linalg.norm(derivative - exact[0], axis=1) for derivative in exact]
    view = camera_for(camera, rig.mesh.neutral)
    pictures, titles = [], []
    for speeds, word in ((lengths, ""), (changes, ", change")):
        limit = max(scale_for(speed) for speed in speeds)
        pictures.append([])
        for params, speed in zip(poses.values(), speeds, strict=True):
            paint = error_colours(speed, limit)
            surface = Surface(rig(params), rig.mesh.faces, lit=False, smooth=False, paint=paint)
            pictures[-1].append(render([surface], view, width, height, renderer=renderer))
        titles.append([f"{title}{word}: 0–{limit:g} mm" for title in poses])
    largest, farthest = (
        ", ".join(f"{title} {speed.max():.1f}" for title, speed in zip(poses, speeds, strict=True))
        for speeds in (lengths, changes)
    )
    first = next(iter(poses))
    return panel_grid(pictures, titles, bar=(0, 1, share_bar)), Words(
        f"Heatmaps of how fast the control {control} moves the surface of {rig.name} in {len(poses)} poses, and of how "
        f"that differs from {first}; at most, in mm per unit: {largest}; differences: {farthest}.",
        f"Above: |∂V/∂p| of {control}, exact, by forward differentiation; at most, in mm per unit: {largest}. Below: "
        f"how far the derivative is from that of {first}; at most: {farthest}. Central differences of float32 "
        f"positions (step {STEP:g}) lie within {apart:.2g} mm per unit of it.",
    )


def central(rig: Rig, params: Float[np.ndarray, " m"], column: int) -> Float[np.ndarray, "n 3"]:
    """Return the derivative by one control as a central difference."""
    poses = np.repeat(np.asarray(params, np.float32)[None], 2, axis=0)
    poses[:, column] += np.float32([STEP, -STEP])
    after, before = rig(poses).astype(float)
    return (after - before) / (2 * STEP)
