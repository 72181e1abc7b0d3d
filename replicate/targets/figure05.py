"""Figure 5: poses of the training data, and strips of the clips behind them."""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from data_recipes.rig import Clip, Rig, frames_per_second
from replicate.cli.running import make
from replicate.drawing.panels import Words, panel_grid, save_figure
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.rig_views import read_lines, write_lines
from replicate.drawing.scene import Camera, Surface, camera_for, frame_surfaces
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.publication import publish_pictures
from replicate.report.tables import Table
from replicate.targets.shown_records import Picture

if TYPE_CHECKING:
    import matplotlib.figure


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that draws one character's figure."""
    inputs = (artefacts.rig_stage(plan), artefacts.samples_stage(plan))
    return [plan.stage("figure05", draw, Picture(plan.character, plan.config.seed), *inputs)]


def draw(context: StageContext) -> None:
    """Draw some training poses, and a strip of each kind of clip (Fig. 5)."""
    rig, samples = artefacts.load_rig(context.inputs), artefacts.load_samples(context.inputs)
    choice = choose(len(samples), context.rng("poses"))
    stem = context.out / f"figure05_{context.config.character}"
    save_poses(rig, samples.params[choice], choice, stem)
    if rig.clips:
        save_clips(rig, stem.with_name(f"{stem.name}_clips"))


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character and publish it."""
    publish_pictures("figure05", make(options, stages))


# Figure 5: example poses of the training data in clay; and strips of the clips behind them (Eq. 5).

POSES = 8
FRAMES = 6
POSES_HEADER = ("pose", "sample", "control", "value", "lower", "upper")
CLIPS_HEADER = ("kind", "clip", "frames", "shown_frame", "time_s")


def choose(count: int, generator: np.random.Generator) -> Int[np.ndarray, " k"]:
    """Draw the indices of the samples to show, in rising order. count: the number of all samples."""
    return np.sort(generator.choice(count, min(POSES, count), replace=False))


def figure05(
    rig: Rig, params: Float[np.ndarray, "k m"], width: int = 340, height: int = 364
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): some poses of the training data, in clay.

    params: the poses' rig parameters, (k, m)
    width: of one picture, pixels
    height: of one picture, pixels
    """
    posed = [_surfaces(rig, row) for row in params]
    view = _view_of_all(rig, posed, width / height)
    pictures = [render(surfaces, view, width, height) for surfaces in posed]
    pictures += [np.full((height, width, 3), 255, np.uint8)] * (len(pictures) % 2)
    titles = [f"{k + 1}" if k < len(params) else "" for k in range(len(pictures))]
    half = len(pictures) // 2
    figure = panel_grid([pictures[:half], pictures[half:]], [titles[:half], titles[half:]])
    used = [int((row != rig.default).sum()) for row in params]
    beyond = [int(((row < rig.lower) | (row > rig.upper)).sum()) for row in params]
    total = len(rig.controls)
    how_many = f"all {total}" if min(used) == total else f"{min(used)} to {max(used)} of {total}"
    about = f"{len(params)} training poses of {rig.name}; each uses {how_many} controls"
    source = (
        "drawn uniformly within the controls' limits, since the character has no clips"
        if rig.clips is None
        else f"samples of Eq. 5, drawn at random; {min(beyond)} to {max(beyond)} of them lie beyond their limits"
    )
    return figure, Words(
        f"Clay renders from the front of {about}.",
        f"Example poses from the training data (after Fig. 5): {about}; {source}. Hair, brows and eyeballs are for "
        "display only.",
    )


def save_poses(rig: Rig, params: Float[np.ndarray, "k m"], samples: Int[np.ndarray, " k"], stem: Path) -> None:
    """Write Figure 5 of a rig as PNG, its words as JSON, and the controls that are off their defaults as CSV.

    samples: each pose's index in the training data.
    """
    figure, words = figure05(rig, params)
    save_figure(figure, stem.with_suffix(".png"), words)
    lines = (
        (k + 1, samples[k], rig.controls[j].name, params[k, j], rig.lower[j], rig.upper[j])
        for k in range(len(params))
        for j in np.flatnonzero(params[k] != rig.default)
    )
    write_lines(stem.with_suffix(".csv"), POSES_HEADER, lines)


def clip_kinds(clips: Sequence[Clip]) -> dict[str, Clip]:
    """Return the first clip of each kind. Our clips are named number_kind_expression; others have the kind "clip"."""
    kinds: dict[str, Clip] = {}
    for clip in clips:
        match = re.fullmatch(r"\d+_([^_]+)_.+", clip.name)
        kinds.setdefault(match[1] if match else "clip", clip)
    return kinds


def shown_frames(clip: Clip, count: int = FRAMES) -> Int[np.ndarray, " count"]:
    """Return frames spread evenly over a clip, without its two ends, where our clips are at rest."""
    return np.linspace(0, len(clip.values) - 1, count + 2)[1:-1].round().astype(int)


def clip_strips(rig: Rig, width: int = 210, height: int = 258) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a strip of frames of the first clip of each kind, in clay."""
    kinds, titles, rate = clip_kinds(rig.clips or ()), [], frames_per_second(rig)
    posed = [[_surfaces(rig, clip.values[k]) for k in shown_frames(clip)] for clip in kinds.values()]
    view = _view_of_all(rig, [surfaces for strip in posed for surfaces in strip], width / height)
    rows = [[render(surfaces, view, width, height) for surfaces in strip] for strip in posed]
    for clip in kinds.values():
        frames = shown_frames(clip)
        titles.append([f"{k / rate:.1f} s" for k in frames])
    strips = ", ".join(f"{kind} ({clip.name}, {len(clip.values) / rate:.1f} s)" for kind, clip in kinds.items())
    return panel_grid(rows, titles, tuple(kinds)), Words(
        f"{len(kinds)} strips of clay renders of {rig.name}, {FRAMES} frames each, time from left to right: {strips}.",
        f"The animation of {rig.name} that Eq. 5 multiplies: the first clip of each kind, {FRAMES} frames spread "
        f"evenly over it: {strips}; {len(rig.clips or ())} clips in all.",
    )


def _view_of_all(rig: Rig, posed: Sequence[Sequence[Surface]], aspect: float) -> Camera:
    """Return a view from the front with room for every pose: also stretched or bent heads, and their hair."""
    return frame_surfaces(
        camera_for("front", rig.mesh.neutral), [surface for pose in posed for surface in pose], aspect
    )


def _surfaces(rig, params: Float[np.ndarray, " m"]) -> list[Surface]:
    return [Surface(rig(params), rig.mesh.faces), *prop_surfaces(rig.pose_props(params))]


def save_clips(rig: Rig, stem: Path) -> None:
    """Write the strips of a rig's clips as PNG, their words as JSON, and the frames shown as CSV."""
    figure, words = clip_strips(rig)
    save_figure(figure, stem.with_suffix(".png"), words)
    lines = (
        (kind, clip.name, len(clip.values), k, k / frames_per_second(rig))
        for kind, clip in clip_kinds(rig.clips or ()).items()
        for k in shown_frames(clip)
    )
    write_lines(stem.with_suffix(".csv"), CLIPS_HEADER, lines)


def poses_table(file: Path, character: str) -> Table:
    """Return the numbers behind a character's Figure 5: how many controls each pose uses, and which most.

    A control's use is its value over the limit on that side.
    """
    poses: dict[str, list[tuple[float, str]]] = {}
    for line in read_lines(file, POSES_HEADER):
        value = float(line["value"])
        limit = abs(float(line["upper" if value > 0 else "lower"]))
        poses.setdefault(f"{line['pose']} (sample {line['sample']})", []).append(
            (abs(value) / limit if limit else np.inf, line["control"])
        )
    body = []
    for name, used in poses.items():
        used.sort(key=lambda pair: (-pair[0], pair[1]))
        farthest = ", ".join(f"{control} {share:.1f}" for share, control in used[:3])
        body.append((name, f"{len(used)}", f"{sum(share > 1 for share, _ in used)}", farthest))
    header = ("pose", "controls used", "beyond limits", "farthest, over limit")
    return Table(f"Training poses of {character} in Fig. 5", (header,), tuple(body))
