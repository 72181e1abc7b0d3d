"""What lesson 3 stands on: poses of the teen, a start and a bone step for students' SSDR, a tube, and its pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from data_recipes.rig import Rig
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.samples import choose_poses, evaluate
from replicate.base.paths import REFERENCE
from replicate.baselines.skinning.bones import sweep_reference, weighted_points
from replicate.baselines.skinning.ssdr import fit, refit
from replicate.config import SamplesConfig
from replicate.drawing.heatmap import normal_bar, normal_heat
from replicate.drawing.light import RAKING
from replicate.drawing.panels import Words, enlarge, panel_grid, tidy
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, faces_in_view, forehead_camera
from replicate.geometry.mesh import Mesh
from replicate.report.pose_record import PoseRecord, load_pose, pose_file
from replicate.targets.lbs import weight_colours

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

Motions = tuple[np.ndarray, np.ndarray]  # rotations (f, bones, 3, 3), translations (f, bones, 3) in mm: v R + t

TRAINING = 60  # poses
FEWEST = 6  # vertices that a bone starts with
ITERATIONS = 60  # of the suite's fit
SWEEPS = 3  # over the bones in a bone step


@dataclass(frozen=True)
class Examples:
    """Example poses of a mesh of n vertices.

    rest: (n, 3) mm. segment: (n,), what part each vertex belongs to. names: of the parts. training: (f, n, 3) mm, poses
    to fit to.
    """

    rest: np.ndarray
    segment: np.ndarray
    names: tuple[str, ...]
    training: np.ndarray


def examples(rig: Rig) -> Examples:
    """Return training poses of a rig, as Eq. 5 draws them."""
    poses = choose_poses(rig, SamplesConfig(count=TRAINING), lambda name: np.random.default_rng([3, *name.encode()]))
    posed = np.concatenate([vertices for _, vertices in evaluate(rig, poses["training"])])
    return Examples(rig.mesh.neutral, rig.mesh.segment, rig.mesh.segment_names, posed)


# What students' SSDR calls.


def start(
    rest: Float[np.ndarray, "n 3"], poses: Float[np.ndarray, "f n 3"], bones: int, align: Callable, rounds: int = 6
) -> tuple[Motions, Float[np.ndarray, "n bones"]]:
    """Return motions and weights to start from: clusters of vertices, each carried by one bone.

    Seeds are as far from one another as can be. Then, as in k-means: each cluster's motion in each pose is found by
    `align`, and each vertex goes to the bone that leaves it least error.
    """
    seeds = [0]
    while len(seeds) < bones:
        seeds.append(int(np.argmax(np.linalg.norm(rest[:, None] - rest[seeds], axis=2).min(1))))
    labels = np.argmin(np.linalg.norm(rest[:, None] - rest[seeds], axis=2), axis=1)
    rotations, translations = np.tile(np.eye(3), (len(poses), bones, 1, 1)), np.zeros((len(poses), bones, 3))
    for _ in range(rounds):
        for b in range(bones):
            own = labels == b
            if own.sum() >= FEWEST:
                for f, pose in enumerate(poses):
                    rotations[f, b], translations[f, b] = align(rest[own], pose[own])
        left = (alone(rest, poses, (rotations, translations)) ** 2).sum(1)
        labels = np.argmin(left, axis=1)
    return (rotations, translations), np.eye(bones)[labels]


def alone(
    rest: Float[np.ndarray, "n 3"], poses: Float[np.ndarray, "f n 3"], motions: Motions
) -> Float[np.ndarray, "n k bones"]:
    """Return the matrix S of each vertex: in column b, what remains of it in all poses if bone b alone carries it, mm.

    The 3f rows are turned into fewer by a QR decomposition: an orthogonal matrix changes no length.
    """
    rotations, translations = motions
    left = np.empty((len(rest), min(3 * len(poses), translations.shape[1]), translations.shape[1]))
    for first in range(0, len(rest), 1000):
        part = slice(first, first + 1000)
        moved = np.einsum("ni,fbij->nfjb", rest[part], rotations) + translations.transpose(0, 2, 1)
        s = poses[:, part].transpose(1, 0, 2)[..., None] - moved
        left[part] = np.linalg.qr(s.reshape(len(s), -1, s.shape[-1]), mode="r")
    return left


def bone_step(
    rest: Float[np.ndarray, "n 3"],
    poses: Float[np.ndarray, "f n 3"],
    weights: Float[np.ndarray, "n bones"],
    motions: Motions,
    sweeps: int = SWEEPS,
) -> Motions:
    """Return better motions for fixed weights: one bone after the other, each as `align` does, the others held."""
    rotations, translations = motions
    points = np.concatenate([rest.astype(float), np.ones((len(rest), 1))], axis=1)
    z = weighted_points(points, weights)
    uu, vu = z.T @ z, np.einsum("fnk,nz->fkz", poses.astype(float) - rest, z)
    motion = np.concatenate(
        [(rotations - np.eye(3)).transpose(0, 3, 1, 2), translations.transpose(0, 2, 1)[..., None]], 3
    )
    for _ in range(sweeps):
        motion = sweep_reference(motion, uu, vu)
    return motion[..., :3].transpose(0, 2, 3, 1) + np.eye(3), motion[..., 3].swapaxes(1, 2)


def rmse(left: Float[np.ndarray, "n k bones"], weights: Float[np.ndarray, "n bones"], poses: int) -> float:
    """Return the root mean square distance of a skin from its poses, mm; left: the matrices S of `alone`."""
    return float(np.sqrt((np.einsum("nkb,nb->nk", left, weights) ** 2).sum() / (len(left) * poses)))


def still(poses: int, bones: int) -> Motions:
    """Return the motions of bones that stay at rest."""
    return np.tile(np.eye(3), (poses, bones, 1, 1)), np.zeros((poses, bones, 3))


def suites_bones(face: Examples, vertices: np.ndarray, bones: int) -> tuple[np.ndarray, float]:
    """Return weights (v, bones) that the suite's own SSDR finds on some vertices, four a vertex, and its RMSE in mm."""
    rest, poses = face.rest[vertices], face.training[:, vertices]
    settings = {"influences": 4, "iterations": ITERATIONS // 2, "relaxed": ITERATIONS // 2, "coherence": 0.0}
    skin = fit(rest, poses, bones, np.random.default_rng(3), **settings)
    error = vertex_error(skin.deform(*refit(skin, poses)), poses)
    return skin.dense_weights(), float(np.sqrt((error**2).mean(dtype=float)))


def spread(weights: Float[np.ndarray, "v bones"], vertices: np.ndarray, face: Examples) -> Float[np.ndarray, "n bones"]:
    """Return weights of all vertices from those of some: means over the nearest that move like them."""
    course = np.concatenate([face.rest[None], face.training[:10]]).transpose(1, 0, 2).reshape(len(face.rest), -1)
    distance, near = cKDTree(course[vertices]).query(course, 5)
    share = 1 / (1 + distance)
    return np.einsum("nk,nkb->nb", share / share.sum(1, keepdims=True), weights[near])


def wrinkled_pose() -> PoseRecord:
    """Return the teen's stored test pose whose forehead folds most, as the rig and as each method has it."""
    return load_pose(pose_file(REFERENCE, "teen"))


# The tube that two bones twist.

RADIUS_MM, LENGTH_MM = 20.0, 140.0


def tube(rings: int = 57, around: int = 48) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a tube along x: rest points (n, 3) in mm, faces, and two bones' weights (n, 2), which blend halfway."""
    x, angle = np.meshgrid(np.linspace(-0.5, 0.5, rings) * LENGTH_MM, np.arange(around) * 2 * np.pi / around)
    x, angle = x.T.ravel(), angle.T.ravel()
    rest = np.stack([x, RADIUS_MM * np.cos(angle), RADIUS_MM * np.sin(angle)], axis=1)
    first = np.arange((rings - 1) * around)
    beside = first // around * around + (first + 1) % around
    faces = np.concatenate(
        [np.stack([first, first + around, beside], 1), np.stack([beside, first + around, beside + around], 1)]
    )
    second = np.clip(0.5 + x / (0.4 * LENGTH_MM), 0, 1)
    return rest, faces.astype(np.int32), np.stack([1 - second, second], axis=1)


def draw_tube(skin: Callable, twist_deg: float, bend_deg: float = 0.0, width: int = 240) -> "matplotlib.figure.Figure":
    """Return a figure of the tube, its right half turned about its axis and bent; skin: a student's."""
    rest, faces, weights = tube()
    twist, bend = np.radians(twist_deg), np.radians(bend_deg)
    about_x = np.array([[1, 0, 0], [0, np.cos(twist), np.sin(twist)], [0, -np.sin(twist), np.cos(twist)]])
    about_z = np.array([[np.cos(bend), np.sin(bend), 0], [-np.sin(bend), np.cos(bend), 0], [0, 0, 1]])
    vertices = skin(rest, np.stack([np.eye(3), about_x @ about_z]), np.zeros((2, 3)), weights)
    ring = np.arange(len(rest)) // 48 % 8 < 4
    stripes = np.arange(len(rest)) % 48 // 6 % 2 == 0
    paint = np.where((ring ^ stripes)[:, None], (205, 120, 80), (232, 226, 214)).astype(np.uint8)
    picture = render(
        [Surface(np.float32(vertices), faces, paint=paint)], Camera((0, 10, 0), 130, 20, 25), width, round(0.75 * width)
    )
    return panel_grid([[picture]], [f"twist {twist_deg:.0f}°, bend {bend_deg:.0f}°"])


# Charts and pictures.


def rigid_chart(errors_mm: Mapping[str, float], tau_mm: float) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): how far each part of the face is from a rigid motion; errors_mm: by the parts' names."""
    from matplotlib.figure import Figure

    teeth = [error for name, error in errors_mm.items() if name.startswith("tooth")]
    bars = {name.replace("_", " "): error for name, error in errors_mm.items() if not name.startswith("tooth")}
    bars |= {f"{len(teeth)} teeth,\nthe worst": max(teeth)} if teeth else {}
    ordered = dict(sorted(bars.items(), key=lambda item: -item[1]))
    figure = Figure((8.5, 3.8), dpi=100, layout="constrained")
    axes = figure.add_subplot()
    colours = ["#D55E00" if error >= tau_mm else "#0072B2" for error in ordered.values()]
    axes.bar(range(len(ordered)), [max(error, 1e-6) for error in ordered.values()], color=colours)
    axes.set_yscale("log")
    axes.axhline(tau_mm, color="#444444", linestyle="--", linewidth=1)
    axes.text(len(ordered) - 1.45, 1.3 * tau_mm, f"τ = {tau_mm:g} mm")  # above the teeth
    axes.set_xlim(-0.6, len(ordered) + 0.2)
    axes.set_xticks(range(len(ordered)), list(ordered), rotation=35, ha="right", rotation_mode="anchor")
    axes.set_ylabel("residual of Eq. 3, mm (log)")
    tidy(axes)
    enlarge(axes, 12)
    rigid = sum(error < tau_mm for error in errors_mm.values())
    return figure, Words(
        f"A bar for each part of the face, one for all teeth; {rigid} of {len(errors_mm)} parts are below the dashed "
        f"line at {tau_mm:g} mm.",
        f"What your alignment leaves of each part, the mean over poses. Dashed: τ = {tau_mm:g} mm. Blue: below it, so "
        f"the part moves as a rigid body and needs no network; that is {rigid} of {len(errors_mm)} parts. Orange: it "
        "deforms.",
    )


def course_chart(errors_mm: Sequence[float], suite_mm: float) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the RMSE after each iteration; suite_mm: what the suite's own fit ends at."""
    from matplotlib.figure import Figure

    figure = Figure((7.5, 3.4), dpi=100, layout="constrained")
    axes = figure.add_subplot()
    axes.plot(errors_mm, "o-", color="#0072B2", label="yours")
    axes.axhline(suite_mm, color="#555555", linestyle="--", linewidth=1.2, label=f"the suite's, after {ITERATIONS}")
    axes.set(xlabel="iteration", ylabel="RMSE, mm", ylim=(0, None))
    axes.legend(frameon=False)
    tidy(axes)
    return figure, Words(
        f"The error falls from {errors_mm[0]:.2f} mm to {errors_mm[-1]:.2f} mm; a dashed line at {suite_mm:.2f} mm.",
        f"Your fit, from clusters ({errors_mm[0]:.2f} mm) to {errors_mm[-1]:.2f} mm after {len(errors_mm) - 1} "
        f"iterations. Dashed: {suite_mm:.2f} mm, where the suite's own SSDR ends after {ITERATIONS}, on the same "
        "vertices and poses, with as many bones and weights. It also starts more cleverly, and extrapolates its steps.",
    )


def one_by_one(
    mesh: Mesh, weights: Float[np.ndarray, "n bones"], count: int, width: int = 158
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the bones that are seen most from the front, one a picture, six in a row."""
    camera = camera_for("front", mesh.neutral)
    seen = np.unique(mesh.faces[faces_in_view(mesh.neutral, mesh.faces, camera)])
    shown = np.argsort(-(weights[seen] ** 2).sum(0), kind="stable")[:count]
    draw = partial(render, camera=camera, width=width, height=round(1.17 * width))
    pictures = [draw([Surface(mesh.neutral, mesh.faces, paint=weight_colours(weights[:, b]))]) for b in shown]
    led = (weights > 0.5).sum(0)
    titles = [f"bone {b}: {led[b]:,}" for b in shown]
    rows = range(0, len(shown), 6)
    return panel_grid([pictures[k : k + 6] for k in rows], [titles[k : k + 6] for k in rows]), Words(
        f"The head at rest {len(shown)} times, each time one bone's weights in red; {'; '.join(titles)} vertices.",
        f"The {len(shown)} of {weights.shape[1]} bones that are seen most from the front, one a picture: the redder a "
        "vertex, the larger the bone's weight. Above each: its number, and how many vertices follow it by more than "
        "half (`(w > 0.5).sum(0)` counts them).",
    )


def tear(record: PoseRecord, guess: np.ndarray) -> tuple[int, int]:
    """Return the two ends of the edge on the forehead along which the error of vertices (n, 3), mm, jumps most."""
    truth, faces = record.vertices["truth"], record.faces
    shown = faces[faces_in_view(truth, faces, forehead_camera(record.neutral, faces, truth))]
    edges = np.concatenate([shown[:, [0, 1]], shown[:, [1, 2]], shown[:, [2, 0]]])
    error = guess - truth
    one, other = edges[np.argmax(np.linalg.norm(error[edges[:, 0]] - error[edges[:, 1]], axis=1))]
    return int(one), int(other)


def forehead_row(
    record: PoseRecord, guesses: Mapping[str, np.ndarray], limit_deg: float = 20.0, width: int = 195
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the true forehead and approximations of it, with their normals' errors.

    guesses: by title, vertices (n, 3) in mm.
    """
    truth, faces = record.vertices["truth"], record.faces
    camera = forehead_camera(record.neutral, faces, truth)
    draw = partial(render, camera=camera, width=width, height=round(0.9 * width), studio=RAKING)
    shown = {"the rig": truth, **guesses}
    clay = [draw([Surface(np.float32(v), faces)]) for v in shown.values()]
    heat = [draw([normal_heat(np.float32(v), truth, faces, limit_deg)]) for v in shown.values()]
    means = [
        f"{title}: {vertex_error(np.float32(v), truth).mean():.2f} mm and "
        f"{np.nanmean(normal_error(np.float32(v), truth, faces)):.2f}°"
        for title, v in guesses.items()
    ]

    def bar(figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes") -> None:
        normal_bar(figure, axes, limit_deg)
        axes.set_ylabel("degrees")  # the row says of what

    figure = panel_grid([clay, heat], list(shown), ("surface", "normal error"), (1, 1, bar))
    return figure, Words(
        f"A wrinkled forehead: the rig's and {', '.join(guesses)}; below, errors of the normals in colours.",
        f"A test pose with folds. Means over the whole head: {'; '.join(means)}.",
    )
