"""What lesson 5 draws with: the teen's charts, faces read from maps, losses, and what untrained decoders draw."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from replicate.approximation.cnn import MapNetwork
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.base.paths import REFERENCE
from replicate.config import CoarseConfig
from replicate.drawing.heatmap import colour_bar, error_colours
from replicate.drawing.light import RAKING
from replicate.drawing.panels import Words, error_scale, panel_grid, tidy
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for, forehead_camera
from replicate.geometry.mesh import Mesh
from replicate.report.pose_record import CHOICES, PoseRecord, load_pose, pose_file

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

Charts = Mapping[str, tuple[np.ndarray, np.ndarray]]  # by name: vertices (k,), and their UVs (k, 2)

FULL_MM = 12.0  # an offset so long in one direction is red, green or blue at its strongest


def stored_poses() -> list[PoseRecord]:
    """Return three test poses of the teen, as the rig and as each method has them; the first has the deepest folds."""
    return [load_pose(pose_file(REFERENCE, "teen", choice)) for choice in CHOICES]


def charts(mesh: Mesh) -> Charts:
    """Return the vertices and UVs of each part of a mesh that deforms; teeth are rigid and need no map."""
    names = [name for name in mesh.segment_names if not name.startswith("tooth")]
    places = {name: np.flatnonzero(mesh.segment == mesh.segment_names.index(name)) for name in names}
    return {name: (vertices, mesh.uv[vertices].astype(float)) for name, vertices in places.items()}


def read_all(
    best_map: Callable, sample: Callable, parts: Charts, offsets: Float[np.ndarray, "n 3"], size: int
) -> Float[np.ndarray, "n 3"]:
    """Return offsets in mm as maps of a size hold them, by a student's functions; as they are outside of all parts."""
    held = offsets.astype(float)
    for vertices, uv in parts.values():
        held[vertices] = sample(best_map(held[vertices], uv, size), uv)
    return held


def as_colours(offsets: Float[np.ndarray, "*s 3"]) -> np.ndarray:
    """Return offsets in mm as colours: red for x, green for y, blue for z; grey where nothing moves."""
    return np.rint(127.5 * (1 + np.clip(offsets / FULL_MM, -1, 1))).astype(np.uint8)


def enlarged(image: np.ndarray, side: int) -> np.ndarray:
    """Return a map (size, size, 3) in colours as a picture whose v axis points up, each pixel as a square."""
    places = np.arange(side) * len(image) // side
    return as_colours(image)[::-1][np.ix_(places, places)]


def face_as_pictures(
    record: PoseRecord, mesh: Mesh, maps: Mapping[str, np.ndarray], side: int = 200
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a pose, its offsets as colours on the skin, and maps of charts; maps: by chart's name."""
    truth = record.vertices["truth"]
    draw = partial(render, camera=camera_for("front", mesh.neutral), width=side, height=side, studio=RAKING)
    painted = Surface(mesh.neutral, mesh.faces, paint=as_colours(truth - mesh.neutral), lit=False)
    pictures = [draw([Surface(truth, mesh.faces)]), draw([painted])]
    titles = ["a pose", "its offsets, as colours"]
    for name, image in maps.items():
        pictures.append(enlarged(image, side))
        titles.append(name.replace("_", " "))
    size = len(next(iter(maps.values())))
    return panel_grid([pictures[:3], pictures[3:]], [titles[:3], titles[3:]]), Words(
        f"A posed head, the neutral head coloured by its offsets, and {len(maps)} square maps in the same colours.",
        "The face as pictures: where each vertex goes, red for x, green for y, blue for z, grey for nothing. The maps "
        f"have {size}×{size} pixels and hold the same offsets, each for one band of the face; v points up.",
    )


def forehead(record: PoseRecord, vertices: np.ndarray, title: str, width: int = 230) -> "matplotlib.figure.Figure":
    """Return a figure of the forehead of a pose."""
    camera = forehead_camera(record.neutral, record.faces, record.vertices["truth"])
    surface = Surface(np.float32(vertices), record.faces)
    return panel_grid([[render([surface], camera, width, round(0.9 * width), studio=RAKING)]], [title])


def floor_chart(
    record: PoseRecord, held: Mapping[int, np.ndarray], networks: Mapping[str, np.ndarray]
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): errors of a pose as maps hold it, by their size, with networks' errors as lines.

    held: by size, vertices (n, 3) in mm. networks: by name, the same.
    """
    from matplotlib.figure import Figure

    truth, faces = record.vertices["truth"], record.faces

    def errors(vertices: np.ndarray) -> tuple[float, float]:
        single = np.float32(vertices)
        return float(vertex_error(single, truth).mean()), float(np.nanmean(normal_error(single, truth, faces)))

    figure = Figure((9, 3.4), dpi=100, layout="constrained")
    found = {size: errors(vertices) for size, vertices in held.items()}
    lines = {name: errors(vertices) for name, vertices in networks.items()}
    labels = ("distance error, mm", "normal angle error, degrees")
    for which, (axes, label) in enumerate(zip(figure.subplots(1, 2), labels, strict=True)):
        axes.plot(list(found), [pair[which] for pair in found.values()], "o-", color="#0072B2", label="your maps")
        highest = max(pair[which] for pair in lines.values())
        for (name, pair), style in zip(lines.items(), ("--", ":"), strict=False):
            axes.axhline(pair[which], color="#D55E00", linestyle=style)
            place = "bottom" if pair[which] == highest else "top"  # such lines may be as good as one
            words, across = f"{name} {pair[which]:.2f}", axes.get_yaxis_transform()
            up = (0, 2 if place == "bottom" else -2)
            axes.annotate(words, (1, pair[which]), up, across, "offset points", ha="right", va=place, color="#D55E00")
        axes.set_xscale("log", base=2)
        error_scale(axes, "y")
        axes.set_xticks(list(found), [str(size) for size in found])
        axes.set(xlabel="pixels a side", ylabel=label)
        tidy(axes)
    axes.legend(frameon=False)
    words = "; ".join(f"{size} pixels {mm:.3f} mm and {deg:.2f}°" for size, (mm, deg) in found.items())
    others = "; ".join(f"{name} {mm:.2f} mm and {deg:.2f}°" for name, (mm, deg) in lines.items())
    return figure, Words(
        f"Two charts that fall with the maps' size: {words}. Lines: {others}.",
        f"What your maps of one pose lose, means over the whole head: {words}. Lines: {others}, in the same pose.",
    )


def loss_picture(
    mesh: Mesh, parts: Charts, loss_mm: Float[np.ndarray, " n"], size: int, side: int = 260
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): what maps lose, on the head, on the mouth, and in the chart that loses most."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    limit = float(np.ceil(np.quantile(loss_mm, 0.995) * 20) / 20)
    paint = error_colours(loss_mm, limit, 0.5)
    surface = Surface(mesh.neutral, mesh.faces, paint=paint, lit=False)
    views = [render([surface], camera_for(v, mesh.neutral), side, side) for v in ("front", "mouth")]
    worst = max(parts, key=lambda name: loss_mm[parts[name][0]].sum())
    vertices, _ = parts[worst]
    own = np.isin(mesh.faces, vertices).all(1)
    flat = Figure((side / 100, side / 100), dpi=100)
    axes = flat.add_axes((0.01, 0.01, 0.98, 0.98))
    corners = paint[mesh.faces[own]].mean(1) / 255
    axes.add_collection(PolyCollection(list(mesh.uv[mesh.faces[own]]), facecolors=corners, edgecolors="none"))
    for tick in np.linspace(0, 1, size):
        axes.axhline(tick, color="#777777", linewidth=0.25)
        axes.axvline(tick, color="#777777", linewidth=0.25)
    axes.set(xlim=(0, 1), ylim=(0, 1), xticks=(), yticks=())
    canvas = FigureCanvasAgg(flat)
    canvas.draw()
    views.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())

    def draw_bar(figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes") -> None:
        bar = colour_bar(figure, axes, limit, "lost, mm", 0.5)
        bar.ax.tick_params(labelsize=7, pad=1, length=2)
        bar.ax.yaxis.label.set_size(8)

    share = loss_mm[vertices].sum() / loss_mm.sum()
    title = worst.replace("_", " ")
    return panel_grid([views], ["the head", "its mouth", f"the chart of {title}"], bar=(0, 0, draw_bar)), Words(
        f"The head, its mouth and a chart coloured by what maps of {size} pixels a side lose, up to {limit:g} mm.",
        f"What your {size}×{size} maps lose, the mean over three poses: at most {loss_mm.max():.2f} mm. The chart is "
        f"that of {title}, which has {share:.0%} of all loss; pixels sit where its grid lines cross.",
    )


# Decoders that nobody has trained.


def fresh_network(inputs: int, uv: np.ndarray, seed: int = 5) -> MapNetwork:
    """Return one of the paper's networks as it is before training."""
    torch.manual_seed(seed)
    shape = CoarseConfig()
    return MapNetwork(inputs, uv, shape.map_size, shape.channels, shape.hidden, shape.leaky_slope)


def fresh_dense(network: MapNetwork, seed: int = 5) -> nn.Sequential:
    """Return a network whose last layer is dense, in the place of the convolutions, before training."""
    torch.manual_seed(seed)
    layers: list[nn.Module] = []
    for layer in network.dense:
        layers += [nn.Linear(layer.in_features, layer.out_features), nn.LeakyReLU(network.slope)]
    return nn.Sequential(*layers, nn.Linear(network.dense[-1].out_features, 3 * network.map_size**2))


def weights_of(*parts: nn.Module) -> int:
    """Return how many numbers some layers learn."""
    return sum(weight.numel() for part in parts for weight in part.parameters())


def decoder_picture(
    rows: Mapping[str, Sequence[np.ndarray]], side: int = 150
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): maps (size, size, 3) that untrained networks draw, each row as bright as it can be."""
    pictures, alike = [], {}
    for name, maps in rows.items():
        around = np.stack(maps) - np.mean(maps, axis=(0, 1, 2))
        scaled = around * FULL_MM / np.quantile(np.abs(around), 0.98)
        pictures.append([enlarged(image, side) for image in scaled])
        alike[name] = float(np.corrcoef(around[:, :, 1:].ravel(), around[:, :, :-1].ravel())[0, 1])
    titles = [f"pose {k + 1}" for k in range(len(pictures[0]))]
    words = "; ".join(f"{name} {value:.2f}" for name, value in alike.items())
    return panel_grid(pictures, titles, list(rows)), Words(
        f"Maps of untrained networks in colours. Correlation of neighbouring pixels: {words}.",
        f"Maps that networks draw before they have learned anything. Correlation of neighbouring pixels: {words}.",
    )
