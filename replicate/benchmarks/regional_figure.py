"""Our regional method in one figure: the regions on a head, and the way from rig parameters to vertices."""

from typing import TYPE_CHECKING

import numpy as np
import pandas
from jaxtyping import Bool, UInt8

from data_recipes.catalogue import build_rig
from data_recipes.recipe_paths import character_label
from data_recipes.rig import Rig
from replicate.benchmarks.region_borders import vertex_regions
from replicate.drawing.panels import DPI, Words
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.rig_views import DISTINCT, EYE, UNUSED_COLOUR
from replicate.drawing.scene import Surface, camera_for
from replicate.drawing.style import LETTER_PT, WIDTH
from replicate.engine.exceptions import InputError
from replicate.engine.paths import REFERENCE
from replicate.methods.regional import RegionalConfig

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

VIEWS = ("front", "three_quarter", "side")
TALL, DIAGRAM = 390, 440  # pixels: the height of the views, and of the diagram below them
DARK, LIGHT = "#333333", "#F4EFE6"


def figure_of(character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return `regional_figure` of a character, with the method's usual numbers.

    Raises InputError where the reference results don't say which segments of the character are rigid.
    """
    rig = build_rig(character)
    file = REFERENCE / f"figure07_{character_label(character)}.csv"
    if not file.is_file():
        raise InputError(f"{file}: there is no such file; `make figure07 CHARACTERS={character}` finds rigid segments.")
    kinds = dict(pandas.read_csv(file)[["segment", "kind"]].itertuples(index=False))
    rigid = np.array([kinds.get(name) != "deforms" for name in rig.mesh.segment_names])
    return regional_figure(rig, rigid, RegionalConfig(), character)


def regional_figure(
    rig: Rig, rigid: Bool[np.ndarray, " s"], config: RegionalConfig, character: str, renderer: str | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): views of the regions, and below them a diagram of the network and the bases.

    rigid: which of the mesh's segments are; they are no part of any region.
    """
    from matplotlib.figure import Figure

    colours = region_colours(rig, rigid, config.regions)
    surfaces = [Surface(rig.mesh.neutral, rig.mesh.faces, colours)]
    surfaces += prop_surfaces(prop for prop in rig.pose_props(rig.default) if prop[0].startswith(EYE))
    figure = Figure((WIDTH, (TALL + DIAGRAM) / DPI), dpi=DPI, facecolor="white")
    across, above = 1 / len(VIEWS), TALL / (TALL + DIAGRAM)
    size = round(across * WIDTH * DPI), TALL
    for place, name in enumerate(VIEWS):
        axes = figure.add_axes((across * place, 1 - above, across, above))
        axes.imshow(render(surfaces, camera_for(name, rig.mesh.neutral), *size, renderer=renderer), aspect="auto")
        axes.set_axis_off()
    _diagram(figure.add_axes((0, 0, 1, 1 - above)), config)
    hidden = " and ".join(map(str, config.hidden))
    return figure, Words(
        f"Above, {character} from three sides in {config.regions} colours, each a compact patch of the head. Below, a "
        f"diagram: of {len(rig.controls)} rig parameters a region's network sees those that move it. They go through "
        f"two gated layers of {hidden} and, beside them, through a straight line, to {config.components} coefficients, "
        f"and these through the region's basis to vertices; {config.regions} times in all. Near a border the regions "
        "on either side are blended.",
        f"The regional method on {character}. Each of the {config.regions} regions has a basis of {config.components} "
        "shapes and a network that gives its coefficients. A gated layer multiplies two linear maps of what "
        "it sees, one of them through silu; the straight line starts from ridge regression. Regions "
        "overlap by a ring of vertices on either side of a border, where one fades into the other. Gray: rigid "
        "segments.",
    )


def region_colours(rig: Rig, rigid: Bool[np.ndarray, " s"], count: int) -> UInt8[np.ndarray, "f 3"]:
    """Return a colour for each face: of the region of its first vertex, gray for rigid segments."""
    mesh = rig.mesh
    region = vertex_regions(mesh, np.flatnonzero(~rigid[mesh.segment]), count)
    palette = np.array([DISTINCT[k % len(DISTINCT)] for k in range(count)] + [UNUSED_COLOUR], np.uint8)
    return palette[region[mesh.faces[:, 0]]]


def _diagram(axes: "matplotlib.axes.Axes", config: RegionalConfig) -> None:
    """Draw the network and the bases as boxes and arrows; a unit of the axes is a tenth of the width."""
    from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

    axes.set(xlim=(0, 10), ylim=(0, DIAGRAM / 100))
    axes.set_axis_off()

    def box(x: float, y: float, wide: float, high: float, text: str, colour: str = LIGHT) -> None:
        patch = FancyBboxPatch((x, y), wide, high, "round,pad=0.05", facecolor=colour, edgecolor=DARK, linewidth=1.2)
        axes.add_patch(patch)
        axes.text(x + wide / 2, y + high / 2, text, ha="center", va="center", fontsize=LETTER_PT)

    def arrow(start: tuple[float, float], end: tuple[float, float]) -> None:
        axes.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=18, linewidth=1.5, color=DARK))

    box(0.1, 1.75, 1.4, 1.0, "$p_r$: the\ncontrols that\nmove $r$")
    for place, width in enumerate(config.hidden):
        box(2.15 + 1.95 * place, 2.75, 1.5, 0.8, f"gated layer\n{width}")
    box(2.15, 1.05, 3.45, 0.8, "straight line, starts\nfrom ridge regression")
    box(6.25, 1.75, 1.3, 1.0, f"$c_r$: {config.components}\ncoefficients")
    box(8.0, 1.75, 1.9, 1.0, "vertices $\\bar V +$\n$\\Sigma_r w_r c_r B_r$")
    arrow((1.6, 2.45), (2.1, 2.95))
    arrow((3.7, 3.15), (4.05, 3.15))
    arrow((5.65, 3.0), (6.2, 2.5))
    arrow((1.6, 2.05), (2.1, 1.6))
    arrow((5.65, 1.6), (6.2, 2.0))
    arrow((7.6, 2.25), (7.95, 2.25))
    axes.text(0.05, 4.0, f"for each of the {config.regions} regions $r$:", ha="left", fontsize=LETTER_PT)
    axes.text(6.5, 4.0, r"gated layer: $(W x + b)\cdot \mathrm{silu}(U x + d)$", ha="center", fontsize=LETTER_PT)
    basis = "$B_r$: principal components of region $r$ in the metric of Eq. 1,\n"
    few = f"the first {config.fine} of each region in 16 bits, the others in 8\n"
    weights = "$w_r$: 1 inside region $r$, less near its border, 0 outside"
    axes.text(9.95, 0.05, basis + few + weights, ha="right", va="bottom", fontsize=LETTER_PT, linespacing=1.3)
