"""How healthy the rigs' poses are: NaN, flipped skin, vertices that fly away, teeth through skin, eyes through lids.

`make bench-poses` measures 10,000 samples of Eq. 5 as training draws them (uniform ones for a rig without clips), every
frame of the clips once, and each control alone at its ends. The mouth and the lids are measured on the frames and on
the single controls: what an animator shows, and what depends on one control. `rig_study/`
defines what is broken. It prints the worst and the controls behind them, writes bench_poses.csv and draws the worst.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from data_recipes.rig import Rig
from replicate.approximation.samples import choose_poses
from replicate.benchmarks.common import add_count, answer, bench_row, make_parser, publish, save_picture, split_names
from replicate.config import SamplesConfig
from replicate.drawing.characters import BACKGROUND, segment_colours
from replicate.drawing.marks import ringed
from replicate.drawing.panels import Words, panel_grid
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, following
from replicate.engine.stage import stream_rng
from replicate.geometry.mesh import Mesh
from replicate.methods.artefacts import rig_of
from replicate.report.results import Row, order_of
from replicate.report.tables import Table, as_text
from replicate.rig_study.eyelids import find_eyes
from replicate.rig_study.mouth_contents import depths, find_mouth
from replicate.rig_study.pose_health import Health, Skin, each_alone, measure, strongest, worst

if TYPE_CHECKING:
    import matplotlib.figure

ABOUT = "how many poses are broken: flipped triangles, teeth through skin, eyes through lids"
WRITES = "results/runs/bench/bench_poses.csv, <character>_worst_poses.png"
COUNT = 10_000
UNIFORM_MOUTHS = 1_000  # of a rig without clips: in how many of its samples the mouth is measured
DEEP_MM = 1.0
LIST_LENGTH = 5
UNIFORM_KINDS = ("uniform", "uniform, mouths")  # the sets of a rig without clips that stand for samples and for frames


@dataclass(frozen=True)
class PoseSet:
    """One set of poses: "augmented" or "uniform", "clips" or "controls"; a name for each pose; their health."""

    kind: str
    names: list[str]
    health: Health


def sets_of_poses(rig: Rig, count: int, every: int = 1) -> dict[str, tuple[list[str], np.ndarray]]:
    """Return the names and the parameters (b, m) of each set's poses. every: k takes each k-th frame of the clips."""
    samples = choose_poses(rig, SamplesConfig(count=count), lambda name: stream_rng(0, "samples", name))["training"]
    sets = {"uniform" if rig.clips is None else "augmented": ([f"sample {k}" for k in range(count)], samples)}
    if rig.clips is not None:
        names = [f"{clip.name} {frame}" for clip in rig.clips for frame in range(len(clip.values))]
        frames = np.concatenate([np.asarray(clip.values, np.float32) for clip in rig.clips])
        first = np.sort(np.unique(frames, axis=0, return_index=True)[1])[::every]
        sets["clips"] = [names[k] for k in first], frames[first]
    sets["controls"] = each_alone(rig)
    return sets


def bench(rig: Rig, count: int, every: int = 1) -> list[PoseSet]:
    """Return each set of poses with its health."""
    skin, mouth, eyes = Skin(rig.mesh), find_mouth(rig.mesh), find_eyes(rig)
    sets = []
    for kind, (names, params) in sets_of_poses(rig, count, every).items():
        if kind == "uniform":
            inner = measure(rig, params[:UNIFORM_MOUTHS], skin, mouth, eyes, f"{rig.name}, mouths")
            sets.append(PoseSet("uniform, mouths", names[:UNIFORM_MOUTHS], inner))
        full = kind in ("clips", "controls")
        health = measure(rig, params, skin, mouth if full else None, eyes if full else None, f"{rig.name}, {kind}")
        sets.append(PoseSet(kind, names, health))
    return sets


def rows(character: str, pose_set: PoseSet) -> list[Row]:
    """Return the health of one set as rows."""
    health = pose_set.health

    def row(metric: str, unit: str, value: float, poses: int = len(health.params)) -> Row:
        return bench_row("bench_poses", character, pose_set.kind, metric, unit, value, poses, "bench-poses")

    rows = [
        row("bad_vertices", "count", int(health.bad.sum())),
        row("flipped_triangles_mean", "ratio", float(health.flipped.mean())),
        row("flipped_triangles_worst", "ratio", float(health.flipped.max())),
        row("furthest_vertex", "ratio", float(health.furthest.max())),
    ]
    for kind, values in health.through.items():
        rows.append(row(f"{kind}_through_worst", "mm", float(values.max())))
        rows.append(row(f"{kind}_through_over_1mm", "ratio", float((values > DEEP_MM).mean())))
    if health.lids:
        eyes = [lid for _, _, lid in health.lids]
        rows += [
            row("eye_shows_worst", "ratio", max(lid.shows for lid in eyes), len(eyes)),
            row("eye_sticks_out_worst", "mm", max(lid.sticks_out_mm for lid in eyes), len(eyes)),
            row("lid_gap_worst", "mm", max(lid.gap_mm for lid in eyes), len(eyes)),
        ]
    return rows


def summary(rows: Sequence[Row]) -> Table:
    """Return the printed table of all rows: a set of a character a line."""
    found = {(row.character, row.method, row.metric): row for row in rows}
    body = []
    for character, kind in dict.fromkeys((row.character, row.method) for row in rows):
        poses = next(row.poses for row in rows if (row.character, row.method) == (character, kind))

        def cell(metric: str, scale: float, pattern: str, character=character, kind=kind) -> str:
            row = found.get((character, kind, metric))
            return pattern.format(scale * row.value) if row else "–"

        body.append((
            f"{character}, {kind}", f"{poses:,}", cell("bad_vertices", 1, "{:.0f}"),
            cell("flipped_triangles_mean", 100, "{:.3f}"), cell("flipped_triangles_worst", 100, "{:.2f}"),
            cell("furthest_vertex", 1, "{:.2f}"), cell("teeth_through_worst", 1, "{:.2f}"),
            cell("teeth_through_over_1mm", 100, "{:.2f}"), cell("gums_through_worst", 1, "{:.2f}"),
            cell("tongue_through_worst", 1, "{:.2f}"), cell("eye_shows_worst", 100, "{:.1f}"),
            cell("eye_sticks_out_worst", 1, "{:.2f}"),
        ))  # fmt: skip
    header = ("", "poses", "NaN", "flips, %", "worst, %", "furthest", "teeth, mm", "> 1 mm, %", "gums, mm",
              "tongue, mm", "eye shows, %", "sticks out, mm")  # fmt: skip
    notes = (
        "Flips: the share of skin triangles turned over against their neighbours; furthest: in head sizes; teeth, gums "
        "and tongue: the deepest through the skin; eyes: the share of their opening that shows at full blinks.",
    )
    return Table("Poses: what is broken", (header,), tuple(body), notes)


def health_card(rows: Sequence[Row]) -> Table:
    """Return the table of the data card: a character a line, in the order of the paper's."""
    body = []
    for character in sorted({row.character for row in rows}, key=order_of):
        found = {(row.method, row.metric): row for row in rows if row.character == character}
        value = {key: row.value for key, row in found.items()}
        samples, clips = ("augmented", "clips") if ("clips", "bad_vertices") in found else UNIFORM_KINDS
        eyes = {
            metric: max(value[kind, metric] for kind in (clips, "controls") if (kind, metric) in value)
            for metric in ("eye_shows_worst", "eye_sticks_out_worst")
            if ("controls", metric) in value
        }
        body.append((
            character, f"{found[samples, 'bad_vertices'].poses:,}", f"{value[samples, 'bad_vertices']:.0f}",
            f"{100 * value[samples, 'flipped_triangles_mean']:.3f} %",
            f"{100 * value[samples, 'flipped_triangles_worst']:.2f} %",
            f"{value[samples, 'furthest_vertex']:.2f}", f"{found[clips, 'bad_vertices'].poses:,}",
            f"{100 * value[clips, 'teeth_through_over_1mm']:.2f} %",
            f"{value[clips, 'teeth_through_worst']:.2f} mm",
            f"{100 * eyes['eye_shows_worst']:.1f} %" if eyes else "–",
            f"{eyes['eye_sticks_out_worst']:.2f} mm" if eyes else "–",
        ))  # fmt: skip
    header = ("", "samples", "NaN", "skin triangles flipped, mean", "worst", "furthest vertex", "frames",
              "with a tooth > 1 mm through skin", "deepest", "eye that shows at full blinks", "sticks out")  # fmt: skip
    return Table("What is broken in poses of our characters", (header,), tuple(body))


def worst_in_words(rig: Rig, pose_set: PoseSet) -> list[str]:
    """Return lines that name a set's worst poses and the controls that they use most."""
    health, lines = pose_set.health, []
    measures = {"flips, %": 100 * health.flipped}
    measures |= {f"{kind} through the skin, mm": values for kind, values in health.through.items()}
    for measured, values in measures.items():
        indices = worst(values, LIST_LENGTH)
        if len(indices):
            lines.append(f"{rig.name}, {pose_set.kind}: worst {measured}")
        for k in indices:
            lines.append(f"  {values[k]:7.2f}  {pose_set.names[k]:28} {strongest(rig.controls, health.params[k])}")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser("bench_poses", "Look for broken poses.")
    add_count(parser, "count", COUNT, "samples of Eq. 5")
    add_count(parser, "every", 1, "take each k-th frame of the clips only")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    table_rows = [
        row
        for name in split_names(options.characters, "for vertices in new poses")
        for row in _rows_of(name, options, command_line)
    ]
    print(as_text(summary(table_rows)))


def _rows_of(character: str, options: argparse.Namespace, command_line: Sequence[str]) -> list[Row]:
    """Measure one character; write its rows, in place of those of an earlier run, and draw its worst poses."""
    rig = rig_of(character)
    sets = bench(rig, options.count, options.every)
    table_rows = [row for pose_set in sets for row in rows(rig.name, pose_set)]
    for pose_set in sets:
        print("\n".join(worst_in_words(rig, pose_set)))
    publish("bench_poses", table_rows, [], command_line)
    save_picture(f"{rig.name}_worst_poses", worst_poses(rig, sets))
    return table_rows


# The worst poses of a character: where its skin turns over, and where teeth leave the mouth.

POSES, COLUMNS = 10, 5
FLIP_COLOUR, BESIDE, OUTSIDE = (220, 0, 110), (250, 190, 90), (220, 0, 110)
SKIN = (214, 206, 198)
LEAST = {"flips": 1e-9, "through": 0.05}  # a pose below these gets no picture: a share, mm


def worst_poses(
    rig: Rig, sets: Sequence, width: int = 250, height: int = 270
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the poses with most flipped triangles, then those whose teeth go furthest.

    sets: of poses, each with `kind`, `names` and `health`, as in the benchmark of poses
    width, height: of a picture, pixels
    """
    flips = _rank(sets, lambda health: health.flipped, "flips")
    deep = _rank(sets, lambda health: health.through.get("teeth", ()), "through")
    skin, mouth = Skin(rig.mesh), find_mouth(rig.mesh)
    pictures, titles = [], []
    for value, name, params in flips:
        vertices = rig(params)
        flipped = skin.flipped(vertices[None])[0]
        colours = _flip_colours(rig.mesh, skin, flipped)
        camera = following(camera_for("front", rig.mesh.neutral), rig.mesh.neutral, vertices)
        picture = _picture(rig, params, vertices, colours, camera, width, height)
        pictures.append(ringed(picture, vertices[skin.faces[flipped]].mean(1), camera, FLIP_COLOUR))
        titles.append(f"{name}: {100 * value:.2f} %")
    _fill(pictures, titles, width, height)
    for value, name, params in deep:
        vertices = rig(params)
        depth_mm = depths(mouth, vertices)
        out = np.zeros(len(vertices), bool)
        out[mouth.points[depth_mm > LEAST["through"]]] = True
        colours = segment_colours(rig.mesh, SKIN)
        colours[out[rig.mesh.faces].any(1)] = OUTSIDE
        camera = camera_for("mouth", rig.mesh.neutral)
        camera = following(camera, rig.mesh.neutral[mouth.points], vertices[mouth.points])
        picture = _picture(rig, params, vertices, colours, camera, width, height)
        pictures.append(ringed(picture, vertices[out], camera, OUTSIDE))
        titles.append(f"{name}: {value:.2f} mm")
    _fill(pictures, titles, width, height)
    if not pictures:
        pictures, titles = [np.full((height, width, 3), 255, np.uint8)], ["nothing found"]
    step = min(COLUMNS, len(pictures))
    rows = [pictures[k : k + step] for k in range(0, len(pictures), step)]
    figure = panel_grid(rows, [titles[k : k + step] for k in range(0, len(titles), step)])
    return figure, _words(rig, flips, deep)


def _words(rig, flips: list, deep: list) -> Words:
    most = f"up to {100 * flips[0][0]:.2f} % of the skin's triangles" if flips else "none"
    far = f"up to {deep[0][0]:.2f} mm" if deep else "nowhere"
    count = f"{len(flips)} with most flipped triangles ({most}), {len(deep)} with teeth furthest through skin ({far})"
    return Words(
        f"Renders of the character {rig.name} in its worst poses: {count}.",
        f"{rig.name}: {count}; of samples of training, frames of clips and single controls. Flipped triangles are "
        "magenta, those beside them orange; magenta are teeth, gums and tongue, too, where they have left the mouth. A "
        "ring is around each such place, hidden ones too.",
    )


def _rank(sets: Sequence, value_of, kind: str) -> list[tuple[float, str, np.ndarray]]:
    """Return the largest values of all sets with their poses' names and parameters, at most one from each clip."""
    entries: dict[str, tuple[float, str, np.ndarray]] = {}
    for poses in sets:
        values = value_of(poses.health)
        count = 0
        for k in worst(values, len(values)) if len(values) else ():
            source = poses.names[k].rsplit(" ", 1)[0] if poses.kind == "clips" else poses.names[k]
            if source not in entries and values[k] >= LEAST[kind]:  # a sample can be in two sets
                entries[source] = float(values[k]), poses.names[k], poses.health.params[k]
                count += 1
            if count == POSES:
                break
    return sorted(entries.values(), key=lambda entry: -entry[0])[:POSES]


def _flip_colours(mesh: Mesh, skin: Skin, flipped: Bool[np.ndarray, " f"]) -> np.ndarray:
    """Return each face's colour: flipped, beside a flipped one (which is easily missed by itself), or neither."""
    colours = segment_colours(mesh, SKIN)
    near = np.zeros(len(mesh.neutral), bool)
    near[skin.faces[flipped]] = True
    colours[near[mesh.faces].any(1)] = BESIDE
    colours[skin.face_indices[flipped]] = FLIP_COLOUR
    return colours


def _picture(rig, params, vertices, colours, camera: Camera, width: int, height: int) -> np.ndarray:
    surfaces = [Surface(vertices, rig.mesh.faces, colours), *prop_surfaces(rig.pose_props(params))]
    return render(surfaces, camera, width, height, BACKGROUND)


def _fill(pictures: list, titles: list, width: int, height: int) -> None:
    """Fill the last row with white pictures."""
    while len(pictures) % COLUMNS:
        pictures.append(np.full((height, width, 3), 255, np.uint8))
        titles.append("")


if __name__ == "__main__":
    sys.exit(main())
