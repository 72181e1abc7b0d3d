"""A tour of a rig: its layers one after the other, what a control moves, and known expressions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from data_recipes.catalogue import expression_poses
from data_recipes.rig import Rig
from replicate.base.exceptions import InputError
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.heatmap import colour_bar, error_colours
from replicate.drawing.panels import Words, panel_grid
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.rig_views import DISTINCT
from replicate.drawing.scene import Surface, camera_for
from replicate.report.tables import Table

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure


SCALES_MM = (0.5, 1, 2, 3, 5, 8, 12, 20, 30, 50, 80)  # upper ends of the heatmaps
MOVED_MM = 0.1  # a vertex that a layer moves less counts as still


@dataclass(frozen=True)
class Exhibit:
    """A layer in a pose that shows it.

    node: of the rig
    title: the layer's number and name
    does: what the layer does, in words
    amounts: of the pose's controls
    camera: the view
    """

    node: str
    title: str
    does: str
    amounts: Mapping[str, float] = field(default_factory=dict)
    camera: str = "front"


SMILE = {"smile_*": 0.9, "cheek_raise_*": 0.5}
PRESSED_IN = {f"lip_{lip}_0{place}_z": -1.0 for lip in ("upper", "lower") for place in range(1, 6)}
GRIN = {"smile_*": 0.8, "mouth_stretch_*": 1.0}
BROWS_UP = {"brow_inner_up_*": 1.0, "brow_outer_up_*": 1.0}
SHOUT = {**BROWS_UP, "jaw_open": 0.75, "smile_*": 0.6, "nose_wrinkle_*": 0.5, "squint_*": 0.5, "squash": 0.35}
EXHIBITS = (
    Exhibit("limit", "soft limits", "bends controls towards their limits", {"smile_*": 2.7, "jaw_open": 1.8}),
    Exhibit("pose_curves", "1 pose curves", "sculpted shapes, interpolated along parabolas", {**SMILE, **BROWS_UP}),
    Exhibit("skull_slide", "2 skull slide", "keeps the skin's distance from the skull", GRIN, "three_quarter"),
    Exhibit("bulges", "1 bulges", "adds flesh along the normals", {"cheek_puff_*": 1.0, **SMILE}, "three_quarter"),
    Exhibit(
        "handles",
        "3 handles",
        "free-form tweaks, radial basis functions",
        {"handle_nose_tip_y": 0.9, "handle_brow_*_02_y": 0.9, "handle_chin_y": -0.9, "handle_cheek_*_02_z": 0.9},
        "three_quarter",
    ),
    Exhibit("jaw", "4 jaw", "turns the jaw about its hinge", {"jaw_open": 0.9, "jaw_sideways": 0.3}),
    Exhibit(
        "lip_contact",
        "6 lip contact",
        "sticky corners; closed lips",
        {"jaw_open": 0.5, "sticky_*": 1.0, "lips_together": 0.6},
        "mouth",
    ),
    Exhibit(
        "teeth_contact",
        "6 teeth contact",
        "keeps lips outside the teeth",
        PRESSED_IN,
        "mouth",
    ),
    Exhibit("lids", "5 lids", "turns lids on the eyeball", {"blink_left": 1.0, "blink_right": 0.5, "eyebag_*": 0.5}),
    Exhibit(
        "flesh",
        "7 flesh",
        "delta mush: evens out, keeps the resting detail",
        {"lip_roll_upper": 1.0, "lip_roll_lower": 1.0, "jaw_open": 0.4},
        "mouth",
    ),
    Exhibit(
        "wrinkles",
        "8 wrinkles",
        "buckles compressed skin",
        {**BROWS_UP, "squint_*": 0.7, "nose_wrinkle_*": 0.6, **SMILE},
    ),
    Exhibit("head_shape", "9 head shape", "squash, stretch, bend, twist", {"squash": 0.7, "twist": 0.5}),
    Exhibit("teeth", "10 teeth", "places each tooth as a rigid body", {**SMILE, "jaw_open": 0.9}, "mouth"),
)
ABREAST = 2  # layers in a row


def layer_sheet(
    rig: Rig, exhibits: Sequence[Exhibit] = EXHIBITS, width: int = 150, height: int = 165
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): each layer's exhibit without it, with it, and how far it moves the surface in the end.

    Everything else is the same in both pictures, including the layers that come after.

    rig: one built from a recipe
    exhibits: the layers
    width, height: of a picture, pixels
    """
    pictures, titles, sentences = [], [], []
    for exhibit in exhibits:
        params = pose_params(rig, exhibit.amounts)
        view = camera_for(exhibit.camera, rig.mesh.neutral)
        on, off = rig.run_nodes(params[None])[0], rig.run_nodes(params[None], skip=(exhibit.node,))[0]
        distance = np.linalg.norm(on - off, axis=1)
        limit = scale_for(distance)
        heat = Surface(on, rig.mesh.faces, lit=False, paint=error_colours(distance, limit))
        draw = partial(render, camera=view, width=width, height=height)
        eyes = rig.default if exhibit.node == "head_shape" else params  # eyeballs are squashed with the head
        pictures += [draw(clay(rig, off, eyes)), draw(clay(rig, on, params)), draw([heat])]
        titles += [f"{exhibit.title}: off", "on", f"0–{limit:g} mm"]
        sentences.append(f"{exhibit.title} {distance.max():.1f} mm")
    across = 3 * ABREAST
    blank = np.full((height, width, 3), 255, np.uint8)
    pictures, titles = pictures + [blank] * (-len(pictures) % across), titles + [""] * (-len(titles) % across)
    rows = [pictures[k : k + across] for k in range(0, len(pictures), across)]
    bar = (0, min(1, len(rows) - 1), share_bar)
    figure = panel_grid(rows, [titles[k : k + across] for k in range(0, len(titles), across)], bar=bar)
    return figure, Words(
        f"For each layer of the character {rig.name}'s rig two clay renders, without and with it, and a heatmap. "
        f"Largest displacements: {', '.join(sentences)}.",
        f"Each layer of {rig.name} off and on, in a pose that shows it, all others on. Heatmaps: how far the layer "
        f"moves the final surface; each has the scale above it. At most: {', '.join(sentences)}.",
    )


def share_bar(figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes") -> None:
    """Draw one bar for heatmaps whose scales stand above them."""
    bar = colour_bar(figure, axes, 100.0, "% of the scale above each heatmap")
    bar.set_ticks([0, 50, 100])
    bar.ax.tick_params(labelsize=8)


def build_up(
    rig: Rig, amounts: Mapping[str, float], width: int = 132, height: int = 146, columns: int = 7
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): one pose after each node, starting with the neutral face.

    rig: one built from a recipe
    amounts: of the pose's controls
    width, height: of a picture, pixels
    columns: pictures in a row
    """
    params = pose_params(rig, amounts)
    view = camera_for("front", rig.mesh.neutral)
    pictures, titles = [], []
    for name, state in rig.node_steps(params[None]):
        vertices = np.asarray(state["x"])[0].T
        eyes = params if "shape" in state else rig.default  # eyeballs are squashed with the head
        pictures.append(render(clay(rig, vertices, eyes), view, width, height))
        titles.append("neutral" if name == "limit" else f"+ {name}")
    blank = np.full((height, width, 3), 255, np.uint8)
    pictures, titles = pictures + [blank] * (-len(pictures) % columns), titles + [""] * (-len(titles) % columns)
    figure = panel_grid(
        [pictures[k : k + columns] for k in range(0, len(pictures), columns)],
        [titles[k : k + columns] for k in range(0, len(titles), columns)],
    )
    steps = ", ".join(title for title in titles if title)
    return figure, Words(
        f"Clay renders of the character {rig.name} in one pose after each node of its rig: {steps}.",
        f"One pose of {rig.name} after each node, in the order of evaluation. Teeth come last, since they follow the "
        "jaw and the head as rigid bodies.",
    )


def layer_table(rig: Rig, poses: Float[np.ndarray, "b m"], exhibits: Sequence[Exhibit] = EXHIBITS) -> Table:
    """Return how far each layer moves the final surface over some poses, in the order of evaluation."""
    whole = rig.run_nodes(poses)
    lines = []
    for exhibit in exhibits:
        distance = np.linalg.norm(whole - rig.run_nodes(poses, skip=(exhibit.node,)), axis=2)
        mask = distance > MOVED_MM
        mean = distance[mask].mean() if mask.any() else 0.0
        share = f"{100 * mask.mean():.0f} %"
        lines.append((exhibit.title, exhibit.does, share, f"{mean:.2f}", f"{distance.max():.1f}"))
    return Table(
        f"What each layer of {rig.name} adds",
        (("", "what it does", "vertices moved", "mean, mm", "largest, mm"),),
        tuple(lines),
        (
            f"Over {len(poses)} poses: the surface with all layers against that without this one. Moved: by more than "
            f"{MOVED_MM:g} mm; the mean is over those.",
        ),
    )


def scale_for(distance: Float[np.ndarray, " n"]) -> float:
    """Return the first of `SCALES_MM` that all but one vertex in a thousand stay below."""
    far = float(np.quantile(distance, 0.999))
    return next((scale for scale in SCALES_MM if far <= scale), SCALES_MM[-1])


def clay(rig: Rig, vertices: Float[np.ndarray, "n 3"], params: Float[np.ndarray, " m"]) -> list[Surface]:
    """Return the surface as clay, with the eyeballs of a pose."""
    eyes = [prop for prop in rig.pose_props(params) if prop[0].startswith("eye")]
    return [Surface(np.asarray(vertices, np.float32), rig.mesh.faces), *prop_surfaces(eyes)]


# Poses for figures: amounts of named controls, as a riggers' sheet lists them.

SIDES = ("left", "right")


def pose_params(rig: Rig, amounts: Mapping[str, float]) -> Float32[np.ndarray, " m"]:
    """Return parameters (m,): the defaults and these amounts; "*" in a name stands for both sides.

    Controls that a smaller rig lacks are left out; InputError if it lacks all of them.
    """
    columns = {control.name: k for k, control in enumerate(rig.controls)}
    params, matches = rig.default.copy(), 0
    for pattern, amount in amounts.items():
        for name in dict.fromkeys(pattern.replace("*", side) for side in SIDES):
            if name in columns:
                params[columns[name]] = amount
                matches += 1
    if amounts and not matches:
        names = ", ".join(amounts)
        raise InputError(f"rig '{rig.name}': it has none of the controls {names}; `rig.controls` lists those it has.")
    return params


# The exact derivative of a rig by one control as a heatmap, and how far finite differences are from it.

STEP = 4e-3  # of the control, for central differences


def derivative_sheet(
    rig: Rig, control: str, poses: Mapping[str, Float[np.ndarray, " m"]], camera: str = "front", width: int = 230,
    height: int = 250
) -> "tuple[matplotlib.figure.Figure, Words]":  # fmt: skip
    """Return (figure, words): |∂V/∂p| of one control in some poses, and its change from the first.

    rig: one that JAX differentiates
    control: its name; InputError if the rig lacks it
    poses: raw rig parameters by title
    camera: the view
    width, height: of a picture, pixels
    """
    names = [c.name for c in rig.controls]
    if control not in names:
        raise InputError(f"rig '{rig.name}': there is no control '{control}'; there are {', '.join(names)}.")
    column = names.index(control)
    exact = [rig.jacobian(params, [column])[:, :, 0] for params in poses.values()]
    differences = [central(rig, params, column) for params in poses.values()]
    apart = max(np.abs(a - b).max() for a, b in zip(exact, differences, strict=True))
    lengths = [np.linalg.norm(derivative, axis=1) for derivative in exact]
    changes = [np.linalg.norm(derivative - exact[0], axis=1) for derivative in exact]
    view = camera_for(camera, rig.mesh.neutral)
    pictures, titles = [], []
    for speeds, word in ((lengths, ""), (changes, ", change")):
        limit = max(scale_for(speed) for speed in speeds)
        pictures.append([])
        for params, speed in zip(poses.values(), speeds, strict=True):
            paint = error_colours(speed, limit)
            surface = Surface(rig(params), rig.mesh.faces, lit=False, paint=paint)
            pictures[-1].append(render([surface], view, width, height))
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


# Pictures of a rig that is known by its samples: its segments in colours, and a few of its poses.

COLUMNS, TALL = 4, 1.2  # pictures in a row; a picture's height over its width
SHOWN = 6  # poses that differ most
ROOM = 1.15  # around a neutral head, for poses that stretch it


def known_faces(rig: Rig) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the segments on the neutral face, then that face and the poses that differ most."""
    mesh, width = rig.mesh, cell_width(COLUMNS)
    colours = np.array([DISTINCT[k % len(DISTINCT)] for k in range(len(mesh.segment_names))], np.uint8)
    segments = Surface(mesh.neutral, mesh.faces, colours[mesh.segment[mesh.faces].max(axis=1)])
    poses = dict(list(expression_poses(rig).items())[: SHOWN + 1])
    surfaces = {"segments": segments} | {name: Surface(rig(pose), mesh.faces) for name, pose in poses.items()}
    camera = camera_for("three_quarter", mesh.neutral)
    camera = replace(camera, height_mm=ROOM * camera.height_mm)
    cells = [
        Cell(name.replace("_", " "), (render([surface], camera, width, round(TALL * width)),))
        for name, surface in surfaces.items()
    ]
    return face_sheet(cells, COLUMNS), Words(
        f"Clay renders of {rig.name}: {len(mesh.segment_names)} segments in colours, then {len(poses)} known poses.",
        f"What is known of {rig.name}: its segments, the neutral face, and poses that are far apart. A face that is "
        "torn, turned or of the wrong size is seen here before anything is trained.",
    )
