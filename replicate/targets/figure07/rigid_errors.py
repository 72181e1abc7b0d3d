"""Eq. 3 of every segment against τ: which segments move rigidly, and by how much the others don't."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.drawing.panels import DPI, Words, save_figure
from replicate.drawing.style import WIDTH, enlarge, error_scale, tidy
from replicate.geometry.mesh import Mesh
from replicate.report.character_words import with_layout
from replicate.targets.figure07.mesh_segments import segment_palette

if TYPE_CHECKING:
    import matplotlib.figure

LEAST_MM = 1e-4  # of the axis: what is rigid to rounding stands there
LINE, FRAME = 0.33, 1.3  # inches: a segment, and what is above and below them


def rigid_errors_chart(
    mesh: Mesh, errors_mm: Float[np.ndarray, " s"], rigid: Collection[int], tau_mm: float, name: str
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): each segment's mean residual of Eq. 3, in a line of its own; rigid ones share the first.

    Lines go from the smallest to the largest. rigid: indices of the segments that count as rigid. name: the
    character's.
    """
    from matplotlib.figure import Figure

    palette = np.array(segment_palette(mesh, rigid)) / 255
    order = np.argsort(errors_mm, kind="stable")
    together = [k for k in order if k in rigid]
    alone = [k for k in order if k not in rigid]
    first = int(bool(together))
    places = dict.fromkeys(together, 0) | {k: first + line for line, k in enumerate(alone)}
    lines = [f"{len(together)} rigid"] * first + [mesh.segment_names[k].replace("_", " ") for k in alone]
    figure = Figure((WIDTH, LINE * len(lines) + FRAME), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    heights = [places[k] for k in order]
    lengths = np.maximum(errors_mm[order], LEAST_MM)
    axes.scatter(lengths, heights, c=palette[order], edgecolors="#333333", linewidths=0.6, s=80, zorder=3)
    axes.axvline(tau_mm, color="#333333", linestyle="--", linewidth=1.2)
    at = {"xytext": (5, 5), "textcoords": "offset points", "xycoords": axes.get_xaxis_transform()}
    axes.annotate(f"τ = {tau_mm:g} mm", (tau_mm, 1), va="bottom", **at)
    axes.set_yticks(range(len(lines)), lines)
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.margins(x=0.08)
    axes.set_xlabel("mean of $e_k$ (Eq. 3), mm")
    error_scale(axes)
    tidy(axes)
    enlarge(axes)
    deforming = [k for k in range(len(errors_mm)) if k not in rigid]
    sides = [f"The largest of a rigid one is {errors_mm[list(rigid)].max():.2g} mm."] if rigid else []
    sides += [f"The smallest of a deforming one is {errors_mm[deforming].min():.2g} mm."] if deforming else []
    whose = with_layout(name, mesh.segment_names)
    return figure, Words(
        f"A dot chart on a logarithmic axis: how far each segment of {whose} is from a rigid motion; {len(rigid)} lie "
        f"left of the line at {tau_mm:g} mm. {' '.join(sides)}",
        f"How far each segment of {whose} is from moving rigidly, in training poses; what lies left of τ is placed by "
        f"§3.4 instead of a network. {' '.join(sides)} Colours are those of Figure 7.",
    )


def save_rigid_errors(
    mesh: Mesh, errors_mm: Sequence[float], rigid: Collection[int], tau_mm: float, stem: Path
) -> None:
    """Write the chart as <stem>_rigidity.png, with its words; the character's name is the end of the stem's."""
    name = stem.name.partition("_")[2]
    figure, words = rigid_errors_chart(mesh, np.asarray(errors_mm), rigid, tau_mm, name)
    save_figure(figure, stem.with_name(f"{stem.name}_rigidity.png"), words)
