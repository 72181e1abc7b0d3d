"""Show what linear blend skinning does to a face: its bones and weights, errors by their number, lost wrinkles."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from data_recipes.rig import Rig
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.base.progress import Progress
from replicate.baselines.skinning.bone_network import usual_motion
from replicate.baselines.skinning.ssdr import Skin, refit
from replicate.cli.running import make
from replicate.drawing.heatmap import normal_bar, normal_heat
from replicate.drawing.panels import DPI, Words, panel_grid, save_figure, tidy
from replicate.drawing.render import render
from replicate.drawing.rig_views import read_lines, write_lines
from replicate.drawing.scene import Surface, camera_for, forehead_camera
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts, skinned
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.publication import publish_pictures
from replicate.report.tables import Table
from replicate.targets.shown_records import Picture

if TYPE_CHECKING:
    import matplotlib.figure


BONES = (4, 8, 16, 24, 32, 48, 64)  # the numbers of bones in Table 2, and others


@dataclass(frozen=True)
class SkinPicture(Picture):
    """The settings of the figures, with the upper end of the colours of normal errors."""

    limit_deg: float


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that draws one character's figures, for which skins of more and more bones are fitted."""
    inputs = [artefacts.rig_stage(plan), artefacts.samples_stage(plan), artefacts.shown_pose_stage(plan)]
    inputs += [skinned.stage(plan, bones) for bones in BONES]
    settings = SkinPicture(plan.character, plan.config.seed, plan.config.evaluation.heatmap_deg)
    return [plan.stage("lbs", draw, settings, *inputs)]


def draw(context: StageContext) -> None:
    """Measure skins of several numbers of bones on test poses, and draw what they are."""
    rig, samples = artefacts.load_rig(context.inputs), artefacts.load_samples(context.inputs)
    skins = {bones: skinned.load_skin(context.inputs, bones) for bones in BONES}
    count = len(samples.test_params)
    rows = np.sort(context.rng("poses").choice(count, min(TEST, count), replace=False))
    test = rig.mesh.neutral + np.asarray(samples.test_offsets[rows], np.float32)
    training = samples.draw(context.rng("training"), min(TRAINING, len(samples)))
    wrinkle_pose = rig.mesh.neutral + np.asarray(
        samples.test_offsets[artefacts.load_shown_pose(context.inputs)], np.float32
    )
    posed = rig.mesh.neutral + samples.offsets(training)
    with context.progress(len(skins), "LBS", 0) as bar:
        stem = context.out / f"lbs_{context.config.character}"
        save_all(rig, skins, posed, test, wrinkle_pose, context.config.limit_deg, stem, bar)


def run(options: argparse.Namespace) -> None:
    """Draw the figures of every character and publish them."""
    publish_pictures("lbs", make(options, stages))


# The pictures and the errors.

HEADER = ("bones", "poses", "rmse_mm", "mean_mm", "normal_deg", "floor_rmse_mm", "floor_normal_deg")
WEIGHT_BONES = (8, 16, 32)  # numbers of bones whose weights are painted
WRINKLE_BONES = (16, 32, 64)  # numbers of bones shown in a wrinkled pose
TEST, TRAINING = 200, 64  # poses that errors and the bones' motions are measured on
ALONE = 6  # bones shown one by one
GOLDEN = 0.618034  # the turn of hue from one bone to the next, so that neighbours differ
GAMMA = 2.2  # colours to this power are proportional to light
PALE, DEEP = (236, 236, 232), (178, 24, 43)  # the colours of the weights 0 and 1


def bone_colours(skin: Skin) -> UInt8[np.ndarray, "n 3"]:
    """Return each vertex's colour: the colours of its bones, mixed like light by its weights."""
    from matplotlib.colors import hsv_to_rgb

    k = np.arange(skin.bones)
    colours = hsv_to_rgb(np.stack([(k * GOLDEN) % 1, 0.8 - 0.25 * (k % 2), np.ones(skin.bones)], 1))
    return np.rint(255 * (skin.dense_weights() @ colours**GAMMA) ** (1 / GAMMA)).astype(np.uint8)


def weight_colours(weights: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Return a colour for each weight from 0 (`PALE`) to 1 (`DEEP`)."""
    return np.rint(np.array(PALE) + weights[:, None] * (np.array(DEEP) - PALE)).astype(np.uint8)


def weight_picture(
    mesh: Mesh, skins: Mapping[int, Skin], width: int = 250, height: int = 290
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Draw all weights at once for several numbers of bones, from the front and three-quarters; return (figure, words).

    skins: by number of bones
    width: of one picture, pixels
    height: of one picture, pixels
    """
    counts = [bones for bones in WEIGHT_BONES if bones in skins] or sorted(skins)
    rows = []
    for view in ("front", "three_quarter"):
        draw = partial(render, camera=camera_for(view, mesh.neutral), width=width, height=height)
        rows.append([draw([Surface(mesh.neutral, mesh.faces, paint=bone_colours(skins[b]))]) for b in counts])
    in_words = ", ".join(map(str, counts))
    return panel_grid(rows, [f"{bones} bones" for bones in counts]), Words(
        f"The head at rest, each vertex in the mixed colours of the bones that move it, for {in_words} bones.",
        f"Weights that SSDR finds for {in_words} bones. Each bone has a colour; a vertex mixes the colours of its "
        "bones (eight at most) by their weights. Where borders are soft, neighbouring bones blend.",
    )


def one_by_one(
    mesh: Mesh, skin: Skin, poses: Float[np.ndarray, "b n 3"], width: int = 190, height: int = 222
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Draw the bones that move the most skin, each alone, with how far it goes; return (figure, words).

    poses: the poses that the motions are measured on, (b, n, 3), mm
    width: of one picture, pixels
    height: of one picture, pixels
    """
    turn, shift = usual_motion(skin, poses)
    dense = skin.dense_weights()
    reach = (dense**2).sum(0) * (shift + 30 * turn)  # a turn moves what lies some 30 mm away
    bones = np.argsort(-reach, kind="stable")[:ALONE]
    draw = partial(render, camera=camera_for("front", mesh.neutral), width=width, height=height)
    pictures = [draw([Surface(mesh.neutral, mesh.faces, paint=weight_colours(dense[:, b]))]) for b in bones]
    titles = [f"{np.degrees(turn[b]):.1f}°, {shift[b]:.1f} mm" for b in bones]
    in_words = "; ".join(
        f"{(dense[:, b] > 0.01).sum():,} vertices, {title}" for b, title in zip(bones, titles, strict=True)
    )
    return panel_grid([pictures], titles), Words(
        f"The head at rest {len(bones)} times, each time one bone's weights in red: {in_words}.",
        f"{len(bones)} of {skin.bones} bones, one a picture: the redder a vertex, the larger the bone's weight. Above "
        "each: how far the bone turns, and how far its centre moves (root mean square over training poses).",
    )


def wrinkle_picture(
    mesh: Mesh,
    skins: Mapping[int, Skin],
    truth: Float[np.ndarray, "n 3"],
    limit_deg: float,
    width: int = 232,
    height: int = 270,
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Draw one wrinkled pose as skins of more and more bones approximate it; return (figure, words).

    skins: by number of bones
    truth: the wrinkled pose, (n, 3), mm
    limit_deg: the upper end of the colours
    width: of one picture, pixels
    height: of one picture, pixels
    """
    counts = [bones for bones in WRINKLE_BONES if bones in skins] or sorted(skins)
    posed = {bones: skins[bones].deform(*refit(skins[bones], truth[None]))[0] for bones in counts}
    view = forehead_camera(mesh.neutral, mesh.faces, truth)
    draw = partial(render, camera=view, width=width, height=height)
    clay = [draw([Surface(vertices, mesh.faces)]) for vertices in (truth, *posed.values())]
    heat = [draw([normal_heat(vertices, truth, mesh.faces, limit_deg)]) for vertices in (truth, *posed.values())]
    means = {b: float(np.nanmean(normal_error(vertices, truth, mesh.faces))) for b, vertices in posed.items()}
    in_words = ", ".join(f"{bones} bones {mean:.2f}°" for bones, mean in means.items())
    bar = (1, 1, partial(normal_bar, limit_deg=limit_deg))
    titles = ["Ground truth", *(f"{bones} bones" for bones in counts)]
    return panel_grid([clay, heat], titles, ("surface", "normal error"), bar), Words(
        f"A wrinkled forehead, true and skinned, with normal errors below from 0 to {limit_deg:g} degrees: {in_words}.",
        "The test pose that folds the forehead most: the truth, then skins whose bones are refitted to it. A fold is a "
        "few vertices wide and a bone moves many vertices, so that few bones leave folds shallow and the finest ones "
        f"out. Mean normal error over the whole mesh: {in_words}.",
    )


def measured_lines(
    mesh: Mesh, skins: Mapping[int, Skin], truth: Float[np.ndarray, "b n 3"], progress: Progress | None = None
) -> list[tuple[int, int, float, float, float, float, float]]:
    """Return a line with the columns of `HEADER` for each skin: its errors on test poses, and a floor for them.

    With B bones a skin's displacements in all poses, as a matrix (3b, n), have rank 4B at most. No matrix of that rank
    is closer to the true ones than their truncated singular value decomposition. So that is a floor, if a loose one:
    it obeys neither limits on weights nor rotations.
    """
    b, n, _ = truth.shape
    offsets = (truth - mesh.neutral).astype(np.float64).transpose(0, 2, 1).reshape(3 * b, n)
    left, strengths, right = np.linalg.svd(offsets, full_matrices=False)
    lines = []
    for bones, skin in sorted(skins.items()):
        posed = skin.deform(*refit(skin, truth))
        count = min(4 * bones, len(strengths))
        flat = (left[:, :count] * strengths[:count]) @ right[:count]
        floor = (mesh.neutral + flat.reshape(b, 3, n).transpose(0, 2, 1)).astype(np.float32)
        errors = [
            (float(np.sqrt((d.astype(np.float64) ** 2).mean())), float(d.mean(dtype=np.float64)),
             float(np.nanmean(normal_error(v, truth, mesh.faces), dtype=np.float64)))
            for v in (posed, floor)
            for d in (vertex_error(v, truth),)
        ]  # fmt: skip
        lines.append((bones, b, *errors[0], errors[1][0], errors[1][2]))
        if progress is not None:
            progress.update(1)
    return lines


def curve(lines: Sequence[Mapping[str, str]], character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): errors against the number of bones, with the floors of their rank."""
    from matplotlib.figure import Figure

    figure = Figure((10, 3.6), dpi=DPI, layout="constrained")
    bones = [int(line["bones"]) for line in lines]
    pairs = (
        ("rmse_mm", "floor_rmse_mm", "RMSE, mm"),
        ("normal_deg", "floor_normal_deg", "normal angle error, degrees"),
    )
    for axes, (column, floor, label) in zip(figure.subplots(1, 2), pairs, strict=True):
        axes.plot(bones, [float(line[column]) for line in lines], "o-", color="#555555", label="SSDR, refitted")
        axes.plot(bones, [float(line[floor]) for line in lines], "--", color="#009E73", label="PCA floor of rank 4B")
        axes.set_xscale("log", base=2)
        axes.set_yscale("log")
        axes.set_xticks(bones, [str(k) for k in bones])
        axes.set_xlabel("bones B")
        axes.set_ylabel(label)
        tidy(axes)
    axes.legend(frameon=False, fontsize=8)
    first, last = lines[0], lines[-1]
    ends = [
        f"{float(e['rmse_mm']):.2f} mm and {float(e['normal_deg']):.2f}°, {e['bones']} bones" for e in (first, last)
    ]
    return figure, Words(
        f"Two line charts of error against the number of bones, from {ends[0]} to {ends[1]}.",
        f"Errors of {character}'s skins on test poses, bones refitted to each: from {ends[0]}, to {ends[1]}. Dashed: "
        "the least squares fit of the same rank, 4 a bone, whose RMSE no skin can pass.",
    )


def save_all(
    rig: Rig,
    skins: Mapping[int, Skin],
    training: Float[np.ndarray, "b n 3"],
    test: Float[np.ndarray, "t n 3"],
    wrinkle_pose: Float[np.ndarray, "n 3"],
    limit_deg: float,
    stem: Path,
    progress: Progress | None = None,
) -> None:
    """Write all pictures of a character's skins with their words, and the errors as CSV.

    skins: by number of bones
    training: the poses that the bones' motions are measured on, (b, n, 3), mm
    test: the poses that errors are measured on, (t, n, 3), mm
    wrinkle_pose: the test pose that is drawn, (n, 3), mm
    limit_deg: the upper end of the colours of normal errors
    stem: the beginning of all file names, "…/lbs_teen"
    """
    mesh = rig.mesh
    lines = measured_lines(mesh, skins, test, progress)
    write_lines(stem.with_suffix(".csv"), HEADER, lines)
    few = skins[min(skins, key=lambda bones: abs(bones - WEIGHT_BONES[1]))]
    pictures = {
        "1_weights": weight_picture(mesh, skins),
        "2_bones": one_by_one(mesh, few, training),
        "3_curve": curve(read_lines(stem.with_suffix(".csv"), HEADER), rig.name),
        "4_wrinkles": wrinkle_picture(mesh, skins, wrinkle_pose, limit_deg),
    }
    for name, (figure, words) in pictures.items():
        save_figure(figure, stem.with_name(f"{stem.name}_{name}.png"), words)


def lbs_table(file: Path, character: str) -> Table:
    """Return the errors behind the curves, a line for each number of bones."""
    body = [(line["bones"], *(f"{float(line[name]):.2f}" for name in HEADER[2:])) for line in read_lines(file, HEADER)]
    header = ("bones", "RMSE, mm", "mean, mm", "normal, degrees", "PCA floor: RMSE, mm", "normal, degrees")
    return Table(f"Linear blend skinning of {character}", (header,), tuple(body))
