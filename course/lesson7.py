"""What lesson 7 works on and draws: the teen's networks from the repository, faces with control points, and charts."""

import contextlib
import io
import json
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float

from data_recipes.catalogue import character_parts
from data_recipes.rig import Rig
from replicate.drawing.characters import character_surfaces
from replicate.drawing.light import PORTRAIT
from replicate.drawing.marks import balls_in_front
from replicate.drawing.panels import enlarge, panel_grid, tidy
from replicate.drawing.render import render
from replicate.drawing.scene import camera_for, frame_surfaces
from replicate.inverse.at_vertices import at_vertices
from replicate.inverse.configurations import files_of, read_drags, targets_of
from replicate.inverse.ik_network import IkModel, load_ik
from replicate.inverse.solver import jacobians, solve
from replicate.methods import coarse, regional, trained
from replicate.methods.artefacts import rig_of

if TYPE_CHECKING:
    import matplotlib.figure

CHARACTER = "teen"
MODELS = {"regional": regional.load_model, "coarse": coarse.load_model}  # ours, and the paper's CNN
PLANE = 2  # coordinates of a control point that count, x and y (§5.3.1)


@dataclass(frozen=True)
class Networks:
    """An approximation of the teen at its control points, its IK networks, and the controls' limits.

    controls: names of the m controls.
    lower, default, upper: (m,) of the controls.
    points: names of the c control points.
    vertices: (c,) of the mesh.
    rest: (c, 3), where they are in the neutral pose, mm.
    offsets: controls (b, m) → offsets (b, c, 3), mm, in torch.
    ik: the networks of §4.
    """

    controls: tuple[str, ...]
    lower: np.ndarray
    default: np.ndarray
    upper: np.ndarray
    points: tuple[str, ...]
    vertices: np.ndarray
    rest: np.ndarray
    offsets: Callable[[torch.Tensor], torch.Tensor]
    ik: IkModel

    def places(self, controls: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b k"]:
        """Return x and y of the control points in turn, mm, float64."""
        with torch.no_grad():
            moved = self.offsets(torch.from_numpy(np.asarray(controls, np.float32))).numpy()
        return (self.rest + moved.astype(np.float64))[..., :PLANE].reshape(len(moved), -1)

    def slopes(self, controls: Float[np.ndarray, " m"]) -> Float[np.ndarray, "k m"]:
        """Return the Jacobian of `places` by reverse differentiation, mm per unit of each control."""
        exact = jacobians(self.offsets, np.asarray(controls)[None])[0]
        return exact[:, :PLANE].reshape(-1, len(controls)).astype(np.float64)

    def targets(self, **moves: tuple[float, float]) -> Float[np.ndarray, " k"]:
        """Return x and y of where the control points are wanted, mm: (x, y) mm from rest for some, by name."""
        wanted = self.rest[:, :PLANE].astype(np.float64)
        for name, move in moves.items():
            wanted[self.points.index(name)] += move
        return wanted.ravel()


@cache
def networks(model: str = "regional") -> Networks:
    """Return the teen's networks that come with the repository; nothing is trained, and no rig is built."""
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(trained.FOLDER / f"{CHARACTER}.zip") as archive:
        archive.extractall(folder)
        inputs = {part.name: part for part in Path(folder).iterdir()}
        approximation, ik = MODELS[model](inputs), load_ik(inputs[f"inverse_{model}"])
        neutral = np.load(inputs[trained.NEUTRAL], allow_pickle=False)
        names, *limits = zip(*json.loads(inputs[trained.CONTROLS].read_text(encoding="utf-8")), strict=True)
    rest = ik.neutral.numpy()
    vertices = np.array([np.linalg.norm(neutral - point, axis=1).argmin() for point in rest])
    points = tuple(name for group in character_parts(CHARACTER)[0].control_points.values() for name in group)
    lower, default, upper = (np.array(values) for values in limits)
    return Networks(names, lower, default, upper, points, vertices, rest, at_vertices(approximation, vertices), ik)


@cache
def teen() -> Rig:
    """Return the teen's rig, which is built the first time."""
    with contextlib.redirect_stdout(io.StringIO()):  # a page shall not say how long that took
        return rig_of(CHARACTER)


def animation_error_mm() -> float:
    """Return the regional network's mean distance error on held-out poses of the animation, over the whole mesh."""
    return trained.entries()[CHARACTER]["errors"]["regional"]["distance_mm"]


def mean_distance(one: Float[np.ndarray, " k"], other: Float[np.ndarray, " k"]) -> float:
    """Return the mean distance of points whose x and y stand in turn, mm."""
    return float(np.linalg.norm((one - other).reshape(-1, PLANE), axis=1).mean())


def by_descent(net: Networks, target: Float[np.ndarray, " k"]) -> Float[np.ndarray, " m"]:
    """Return the controls by the suite's own solver: Eq. 8 by L-BFGS-B, within limits."""
    wanted = np.column_stack([target.reshape(-1, PLANE), net.rest[:, PLANE]])[None]
    rest, every = torch.from_numpy(net.rest), np.arange(len(net.default))
    limits = net.default, net.lower, net.upper, net.upper - net.lower
    answer = solve(lambda controls: rest + net.offsets(controls), wanted, *limits, every, PLANE, 0.02, iterations=100)
    return answer.params[0].astype(np.float64)


def drags(net: Networks) -> list[Float[np.ndarray, " k"]]:
    """Return where the points are wanted in each of Table 4's configurations, x and y in turn, mm."""
    configurations = read_drags(*files_of(CHARACTER), net.points)
    return [wanted[:, :PLANE].astype(np.float64).ravel() for wanted in targets_of(net.rest, net.points, configurations)]


def by_networks(net: Networks, target: Float[np.ndarray, " k"]) -> Float[np.ndarray, " m"]:
    """Return the controls that the IK networks give for x and y of the points, within the limits or not."""
    wanted = np.column_stack([target.reshape(-1, PLANE), net.rest[:, PLANE]])
    return net.ik.solve(wanted[None])[0].astype(np.float64)


def on_rig(rig: Rig, net: Networks, controls: Float[np.ndarray, " m"]) -> Float[np.ndarray, " k"]:
    """Return x and y of the rig's control points, mm."""
    return rig(np.asarray(controls, np.float32))[net.vertices, :PLANE].astype(np.float64).ravel()


def faces(
    rig: Rig, net: Networks, poses: Mapping[str, Float[np.ndarray, " m"]], target: Float[np.ndarray, " k"]
) -> "matplotlib.figure.Figure":
    """Return the rig in some poses, each under its title, with red balls where the control points are wanted."""
    view = camera_for("front", rig.mesh.neutral)
    view = frame_surfaces(view, character_surfaces(rig, rig.default, view), 0.8)
    wanted = np.column_stack([target.reshape(-1, PLANE), net.rest[:, PLANE]])
    pictures = []
    for controls in poses.values():
        surfaces = character_surfaces(rig, np.asarray(controls, np.float32), view)
        balls = balls_in_front(wanted, surfaces[0].vertices)
        pictures.append(render([*surfaces, balls], view, 280, 350, studio=PORTRAIT))
    return panel_grid([pictures], list(poses))


def slope_chart(steps: Sequence[float], curves: Mapping[str, Sequence[float]]) -> "matplotlib.figure.Figure":
    """Return how far two Jacobians are apart over the step of the differences. curves: name → a number a step."""
    from matplotlib.figure import Figure

    figure = Figure((8, 3.6), dpi=100)
    axes = figure.add_subplot()
    for name, curve in curves.items():
        axes.loglog(steps, curve, "o-", markersize=4, label=name)
    axes.set(xlabel="step of the differences, in units of a control", ylabel="relative difference")
    axes.legend(frameon=False)
    tidy(axes)
    enlarge(axes, 11)
    figure.tight_layout()
    return figure


def damping_chart(
    jacobian: Float[np.ndarray, "k m"], runs: Mapping[float, Sequence[tuple[float, float]]]
) -> "matplotlib.figure.Figure":
    """Return what each damping makes of J's directions, and how the points near their places.

    runs: μ → what is left by the network and on the rig, mm, a pair for each round.
    """
    from matplotlib.figure import Figure

    sizes = np.linalg.svd(jacobian, compute_uv=False)
    figure = Figure((10, 4.2), dpi=100)
    left, right = figure.subplots(1, 2)
    for damping, distances in runs.items():
        (line,) = left.loglog(sizes, sizes / (sizes**2 + damping), label=f"μ = {damping:g}")
        turn, by_net, by_rig = damping**0.5, *np.transpose(distances)
        if sizes.min() < turn < sizes.max():
            left.scatter([turn], [1 / (2 * turn)], color=line.get_color(), zorder=3)
        right.semilogy(by_net, "o-", markersize=4, color=line.get_color())
        right.semilogy(by_rig, "--", color=line.get_color())
    left.loglog(sizes, 1 / sizes, ":", color="#555555", label="no damping")
    left.set(xlabel="σ of a direction, mm per unit", ylabel="controls moved for 1 mm", ylim=(1e-4, 10))
    right.set(xlabel="round", ylabel="mean distance of points, mm", ylim=(0.01, 10))
    right.plot([], "o-", markersize=4, color="#555555", label="by the network")
    right.plot([], "--", color="#555555", label="on the rig")
    left.legend(frameon=False, loc="lower right", fontsize=10)
    right.legend(frameon=False, loc="lower right", fontsize=10)
    for axes in (left, right):
        tidy(axes)
        enlarge(axes, 11)
    figure.tight_layout()
    return figure
