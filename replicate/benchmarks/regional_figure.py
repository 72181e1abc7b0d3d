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
from replicate.engine.exceptions import InputError
from replicate.engine.paths import REFERENCE
from replicate.methods.regional import RegionalConfig

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

WIDTH, HEIGHT = 300, 380  # pixels of a view
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
    """Return (figure, words): two views of the regions, and a diagram of the network and the bases.

    rigid: which of the mesh's segments are; they are no part of any region.
    """
    from matplotlib.figure import Figure

    colours = region_colours(rig, rigid, config.regions)
    surfaces = [Surface(rig.mesh.neutral, rig.mesh.faces, colours)]
    surfaces += prop_surfaces(prop for prop in rig.pose_props(rig.default) if prop[0].startswith(EYE))
    figure = Figure((11.5, 3.9), dpi=DPI, facecolor="white")
    for place, name in enumerate(("front", "three_quarter")):
        axes = figure.add_axes((0.005 + 0.21 * place, 0.02, 0.21, 0.96))
        axes.imshow(render(surfaces, camera_for(name, rig.mesh.neutral), WIDTH, HEIGHT, renderer=renderer))
        axes.set_axis_off()
    _diagram(figure.add_axes((0.44, 0.02, 0.555, 0.96)), len(rig.controls), config)
    hidden = " and ".join(map(str, config.hidden))
    return figure, Words(
        f"Left, {character} from two sides in {config.regions} colours, each a compact patch of the head. Right, a "
        f"diagram: {len(rig.controls)} rig parameters go through two gated layers of {hidden} and, beside them, "
        f"through a straight line, to {config.regions} times {config.components} coefficients, and these through a "
        "basis a region to vertices.",
        f"The regional method on {character}. Each of the {config.regions} regions has a basis of {config.components} "
        "shapes; one network gives the coefficients of all of them. A gated layer multiplies two linear maps of what "
        "it sees, one of them through silu; the straight line starts from ridge regression. Gray: rigid segments.",
    )


def region_colours(rig: Rig, rigid: Bool[np.ndarray, " s"], count: int) -> UInt8[np.ndarray, "f 3"]:
    """Return a colour for each face: of the region of its first vertex, gray for rigid segments."""
    mesh = rig.mesh
    region = vertex_regions(mesh, np.flatnonzero(~rigid[mesh.segment]), count)
    palette = np.array([DISTINCT[k % len(DISTINCT)] for k in range(count)] + [UNUSED_COLOUR], np.uint8)
    return palette[region[mesh.faces[:, 0]]]


def _diagram(axes: "matplotlib.axes.Axes", controls: int, config: RegionalConfig) -> None:
    """Draw the network and the bases as boxes and arrows."""
    from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

    axes.set(xlim=(0, 10), ylim=(0, 6))
    axes.set_axis_off()

    def box(x: float, y: float, wide: float, high: float, text: str, colour: str = LIGHT) -> None:
        patch = FancyBboxPatch((x, y), wide, high, "round,pad=0.05", facecolor=colour, edgecolor=DARK, linewidth=0.8)
        axes.add_patch(patch)
        axes.text(x + wide / 2, y + high / 2, text, ha="center", va="center", fontsize=8.5)

    def arrow(start: tuple[float, float], end: tuple[float, float]) -> None:
        axes.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=10, color=DARK))

    count = config.regions * config.components
    box(0.1, 2.5, 1.5, 1.0, f"p\n{controls} rig\nparameters")
    for place, width in enumerate(config.hidden):
        box(2.35 + 1.75 * place, 3.6, 1.35, 1.1, f"gated layer\n{width}")
    box(2.35, 1.3, 3.1, 0.9, "straight line\n(starts from ridge regression)")
    box(6.2, 2.5, 1.6, 1.0, f"c\n{config.regions} × {config.components}\n= {count:,}")
    box(8.35, 2.5, 1.55, 1.0, "vertices\n$V_r = \\bar V_r + c_r B_r$")
    arrow((1.7, 3.2), (2.3, 4.1))
    arrow((3.75, 4.15), (4.05, 4.15))
    arrow((5.55, 4.1), (6.15, 3.25))
    arrow((1.7, 2.8), (2.3, 1.8))
    arrow((5.55, 1.8), (6.15, 2.75))
    arrow((7.9, 3.0), (8.3, 3.0))
    axes.text(4.0, 5.35, r"gated layer: $(W x + b)\cdot \mathrm{silu}(U x + d)$", ha="center", fontsize=9)
    basis = "$B_r$: principal components\nof region $r$ in the metric of Eq. 1,\n"
    few = f"first {config.fine} of each region in 16 bits,\nthe others in 8"
    axes.text(8.0, 2.1, basis + few, ha="center", va="top", fontsize=8)
