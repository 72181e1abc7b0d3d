"""What each piece of our regional method does: one is taken away, or changed, at a time.

`make bench-regional` trains one network for all regions at a short schedule, then with one thing changed, and compares
the errors on the validation poses, which are held out of the training animation; test poses are not used. Three of the
changes together are the method as it is: a network for each region, of the controls that move it, in regions that
overlap. It also measures whether the borders of regions show. Trainings are stages in the cache, so that a stopped run
goes on where it was.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas
from jaxtyping import Bool, Float, Int, UInt8

from data_recipes.catalogue import build_rig
from data_recipes.recipe_paths import character_label, in_command
from data_recipes.rig import Rig
from replicate.approximation.metrics import normal_error
from replicate.approximation.segments import segment_vertices
from replicate.base.exceptions import InputError
from replicate.base.paths import REFERENCE
from replicate.benchmarks.common import add_count, add_only, answer, folders_of, make_parser
from replicate.benchmarks.variants import Variant, compare_variants, variants_tables
from replicate.config import resolve
from replicate.drawing.panels import DPI, LETTER_PT, WIDTH, Words
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.rig_views import DISTINCT, EYE, UNUSED_COLOUR
from replicate.drawing.scene import Surface, camera_for
from replicate.engine.store import artefact_folder
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts, regional
from replicate.methods.method_registry import method_named, sections
from replicate.methods.plan import Plan
from replicate.methods.regional import RegionalConfig
from replicate.regional.basis import split_regions
from replicate.regional.model import load
from replicate.report.results import Row, characters_of, find
from replicate.report.tables import Table, our_value, round_off

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure


ABOUT = "what each piece of our regional method does to its errors and its size"
WRITES = "results/runs/bench/bench_regional.csv"
TABLE = "bench_regional"
STEPS = 4_000
START = {
    "by_region": False,
    "by_influence": False,
    "blend_rings": 0,
    "hidden": [384, 384],
    "training": {"peak_rate": 8e-3},
}
REGIONAL = {"by_region": True, "hidden": [128, 128], "training": {"peak_rate": 1.6e-2}}
REGION_CONTROLS = REGIONAL | {"by_influence": True}
ONE, OURS = "one network for all regions", "the same, borders blended (ours)"
CHANGES = {
    ONE: {},
    "a network for each region": REGIONAL,
    "the same, each of its region's controls": REGION_CONTROLS,
    OURS: REGION_CONTROLS | {"blend_rings": RegionalConfig().blend_rings},
    "the same, blended over two rings": REGION_CONTROLS | {"blend_rings": 2},
    "no straight line": {"line": False},
    "leaky ReLUs, no products": {"gated": False},
    "squared errors": {"squares": True},
    "balanced draws": {"training": {"draws": "balanced"}},
    "components of positions alone": {"normal_weight": 0.0},
    "one region, as many bytes": {"regions": 1, "components": 148},
    "64 regions": {"regions": 64, "components": 48, "fine": 8},
    "64 components": {"components": 64},
    "hidden layers of 256": {"hidden": [256, 256]},
    "hidden layers of 768": {"hidden": [768, 768]},
    "all components in 16 bits": {"fine": 4_096},
    "160 components": {"components": 160},
    "derivatives of the rig too": {"derivatives": 1.0},
}
SAMPLES = {"3,000 training poses": 3_000, "30,000 training poses": 30_000}
LINES = (*CHANGES, *SAMPLES)


def variants(character: str, profile: str, steps: int) -> list[Variant]:
    """Return one network for all regions, as it is and with each change, at a schedule of `steps`."""
    changes = {name: {"regional": change} for name, change in CHANGES.items()}
    changes |= {name: {"samples": {"count": count}, "regional": {}} for name, count in SAMPLES.items()}
    for change in changes.values():
        schedule = {"steps": steps} | START["training"] | change["regional"].get("training", {})
        change["regional"] = START | change["regional"] | {"training": schedule}
    more = sections(profile)
    return [
        Variant("regional", name, resolve(character, profile, change, sections=more))
        for name, change in changes.items()
    ]


def pieces_tables(rows: Sequence[Row]) -> list[Table]:
    """Return two tables for each character in `bench_regional.csv`: the pieces, and the borders of regions."""
    tables = variants_tables(rows, TABLE, "Pieces of the regional method", {"regional": LINES})
    characters = dict.fromkeys(row.character for row in rows)
    borders = [borders_table([row for row in rows if row.character == name], LINES) for name in characters]
    return [*tables, *(table for table in borders if table.body)]


SHOWN = ("refined", "dense", "linear", "regional")
ERRORS = {
    "normal_error_mean": ("deg", "Normal angle error, degrees"),
    "vertex_error_mean": ("mm", "Distance error, mm"),
}
COSTS = {"model_size": ("MB", "Size, MB"), "multiplications": ("count", "Multiplications of one pose, millions")}


def overview_table(table2: Sequence[Row], title: str, metrics: Mapping[str, tuple[str, str]]) -> Table:
    """Return what Table 2 says of our method beside the paper's networks and a line, a column for each character.

    metrics: `ERRORS` or `COSTS`.
    """
    characters, body = characters_of(table2), []
    for metric, (unit, words) in metrics.items():
        body.append((words, *[""] * len(characters)))
        for name in SHOWN:
            found = [find(table2, "table2", character, name, metric) for character in characters]
            scale = 1e-6 if metric == "multiplications" else 1.0
            digits = "ratio" if metric == "multiplications" else unit
            cells = (round_off(row.value * scale, digits) if row else "–" for row in found)
            body.append((method_named(name).label, *cells))
    return Table(title, (("", *characters),), tuple(body))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose settings are changed")
    add_count(parser, "steps", STEPS, "of each training")
    add_only(parser)
    compare = partial(compare_variants, TABLE, variants, pieces_tables, afterwards=border_errors)
    return answer(parser, compare, arguments)


# Do the borders of regions show? The regional method's errors on faces that lie in two regions, beside the others.

METRICS = ("border_normal_error", "inner_normal_error")  # of faces in two regions, and of all other faces
BATCH = 16  # poses at a time


def vertex_regions(mesh: Mesh, movable: Int[np.ndarray, " v"], count: int) -> Int[np.ndarray, " n"]:
    """Return the region of each vertex of a mesh; -1 for those that are not among the movable ones."""
    region = np.full(len(mesh.neutral), -1)
    for k, members in enumerate(split_regions(mesh.neutral[movable], count)):
        region[movable[members]] = k
    return region


def border_faces(mesh: Mesh, movable: Int[np.ndarray, " v"], regions: int) -> Bool[np.ndarray, "2 f"]:
    """Return which faces of a mesh lie in several regions, and which in a single one; those of rigid segments in none.

    movable: the vertices that the regions share out among themselves.
    """
    corners = vertex_regions(mesh, movable, regions)[mesh.faces]
    moved = (corners >= 0).all(1)
    same = (corners == corners[:, :1]).all(1)
    return np.stack([moved & ~same, moved & same])


def mean_normal_errors(
    mesh: Mesh,
    offsets_of: Callable,
    params: Float[np.ndarray, "p m"],
    truth: Float[np.ndarray, "p n 3"],
    groups: Bool[np.ndarray, "g f"],
) -> Float[np.ndarray, " g"]:
    """Return the mean normal error of some groups of faces over some poses, in degrees; NaN for an empty group.

    mesh: the neutral face.
    offsets_of: parameters (b, m) → offsets (b, n, 3) mm.
    params: of the poses.
    truth: the true offsets, mm.
    groups: which faces each group has.
    """
    sums, counts = np.zeros(len(groups)), np.zeros(len(groups))
    for start in range(0, len(params), BATCH):
        rows = slice(start, start + BATCH)
        predicted = offsets_of(np.asarray(params[rows]))
        errors = normal_error(mesh.neutral + predicted, mesh.neutral + np.asarray(truth[rows]), mesh.faces)
        for k, group in enumerate(groups):
            sums[k] += np.nansum(errors[:, group])
            counts[k] += np.isfinite(errors[:, group]).sum()
    return np.divide(sums, counts, out=np.full(len(groups), np.nan), where=counts > 0)


def border_errors(variants: Sequence[Variant], rows: Sequence[Row]) -> list[Row]:
    """Return the errors of one character's trained variants on the borders of regions, and elsewhere, as rows.

    The borders are those of the method's regions for all variants; the poses are the validation poses. rows: of the
    variants, whose table, character and profile the new ones get.
    """
    like, border_rows = rows[0], []
    for variant in variants:
        stage = regional.stage(Plan(variant.config))
        inputs = folders_of(stage.inputs)
        mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
        groups = border_faces(mesh, _movable(inputs, mesh), RegionalConfig().regions)
        offsets_of, truth = load(artefact_folder(stage.identifier)).offsets, samples.validation_offsets
        means = mean_normal_errors(mesh, offsets_of, samples.validation_params, truth, groups)
        for metric, mean in zip(METRICS, means, strict=True):
            key = (like.table, like.character, "regional", f"{metric}[{variant.change}]")
            border_rows.append(Row(*key, "deg", float(mean), None, 1, len(truth), like.profile, like.run))
    return border_rows


def _movable(inputs: Mapping[str, Path], mesh: Mesh) -> Int[np.ndarray, " v"]:

    return np.sort(segment_vertices(artefacts.load_coarse_segments(inputs, mesh)))


def borders_table(rows: Sequence[Row], changes: Sequence[str]) -> Table:
    """Return the errors of one character's variants on the borders of 16 regions and elsewhere."""
    by_metric = {row.metric: row for row in rows}
    body = []
    for change in changes:
        border, inner = (by_metric.get(f"{metric}[{change}]") for metric in METRICS)
        if border and inner:
            body.append((change, our_value(border), our_value(inner), f"{border.value / inner.value:.2f}"))
    header = ("", "on borders, degrees", "elsewhere, degrees", "ratio")
    note = "The borders are those of the method's regions, for every line: a model of one region has none there."
    return Table(f"Borders of regions: {rows[0].character}", (header,), tuple(body), (note,))


# Our regional method in one figure: the regions on a head, and the way from rig parameters to vertices.

VIEWS = ("front", "three_quarter", "side")
TALL, DIAGRAM = 390, 440  # pixels: the height of the views, and of the diagram below them
DARK, LIGHT = "#333333", "#F4EFE6"


def figure_of(character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return `regional_figure` of a character, with the method's usual settings.

    Raises InputError where the reference results don't say which segments of the character are rigid.
    """
    rig = build_rig(character)
    file = REFERENCE / f"figure07_{character_label(character)}.csv"
    if not file.is_file():
        command = f"make figure07 CHARACTERS={in_command(character)}"
        raise InputError(f"{file}: there is no such file; `{command}` finds rigid segments.")
    kinds = dict(pandas.read_csv(file)[["segment", "kind"]].itertuples(index=False))
    rigid = np.array([kinds.get(name) != "deforms" for name in rig.mesh.segment_names])
    return regional_figure(rig, rigid, RegionalConfig(), character)


def regional_figure(
    rig: Rig, rigid: Bool[np.ndarray, " s"], config: RegionalConfig, character: str
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): views of the regions, and below them a diagram of the network and the bases.

    rig: the character's.
    rigid: which segments of its mesh are rigid; no region has a part of them.
    config: the settings of the method.
    character: what the words call it.
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
        axes.imshow(render(surfaces, camera_for(name, rig.mesh.neutral), *size), aspect="auto")
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


if __name__ == "__main__":
    sys.exit(main())
