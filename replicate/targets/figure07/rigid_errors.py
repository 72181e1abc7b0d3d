"""Eq. 3 of every segment against τ: which segments move rigidly, and by how much the others don't."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.drawing.panels import DPI, Words, save_figure
from replicate.drawing.style import tidy
from replicate.geometry.mesh import Mesh
from replicate.targets.figure07.mesh_segments import segment_palette

if TYPE_CHECKING:
    import matplotlib.figure

ASIDE = {"rotation": -50, "ha": "right", "va": "bottom", "rotation_mode": "anchor"}  # names don't meet so
LEAST_MM = 1e-4  # of the axis: what is rigid to rounding stands there


def rigid_errors_chart(
    mesh: Mesh, errors_mm: Float[np.ndarray, " s"], rigid: Collection[int], tau_mm: float, name: str
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): each segment's mean residual of Eq. 3, from the smallest to the largest.

    rigid: indices of the segments that count as rigid. name: the character's.
    """
    from matplotlib.figure import Figure

    palette = np.array(segment_palette(mesh, rigid)) / 255
    order = np.argsort(errors_mm, kind="stable")
    heights = np.maximum(errors_mm[order], LEAST_MM)
    figure = Figure((10, 3.2), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    axes.scatter(range(len(order)), heights, c=palette[order], edgecolors="#333333", linewidths=0.6, s=42, zorder=3)
    axes.axhline(tau_mm, color="#333333", linestyle="--", linewidth=1)
    axes.annotate(f"τ = {tau_mm:g} mm", (0, tau_mm), (0, 4), textcoords="offset points", fontsize=9)
    for place, k in enumerate(order):
        if k not in rigid:
            words = mesh.segment_names[k].replace("_", " ")
            axes.annotate(words, (place, heights[place]), (-6, 0), textcoords="offset points", fontsize=8, **ASIDE)
    axes.set_yscale("log")
    axes.set_ylim(top=30 * max(tau_mm, float(heights[-1])))  # room for names
    axes.set_xticks([])
    axes.set_xlabel(f"{len(order)} segments, the most rigid first")
    axes.set_ylabel("mean of $e_k$ (Eq. 3), mm")
    tidy(axes)
    deforming = [k for k in range(len(errors_mm)) if k not in rigid]
    sides = [f"The largest of a rigid one is {errors_mm[list(rigid)].max():.2g} mm."] if rigid else []
    sides += [f"The smallest of a deforming one is {errors_mm[deforming].min():.2g} mm."] if deforming else []
    return figure, Words(
        f"A dot chart on a logarithmic axis: how far each segment of {name} is from a rigid motion; {len(rigid)} lie "
        f"below the line at {tau_mm:g} mm. {' '.join(sides)}",
        f"How far each segment of {name} is from moving rigidly, in training poses; what lies below τ is placed by "
        f"§3.4 instead of a network. {' '.join(sides)} Colours are those of Figure 7.",
    )


def save_rigid_errors(
    mesh: Mesh, errors_mm: Sequence[float], rigid: Collection[int], tau_mm: float, stem: Path
) -> None:
    """Write the chart as <stem>_rigidity.png, with its words; the character's name is the end of the stem's."""
    name = stem.name.partition("_")[2]
    figure, words = rigid_errors_chart(mesh, np.asarray(errors_mm), rigid, tau_mm, name)
    save_figure(figure, stem.with_name(f"{stem.name}_rigidity.png"), words)
