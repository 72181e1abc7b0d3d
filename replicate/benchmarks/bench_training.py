"""What decides the networks' errors: peak rates, the augmentation and balanced draws of §3.5, a bound on gradients.

`make bench-training` trains each method several times with one thing changed and compares the errors on the validation
poses, which are held out of the training animation; test poses are not used. Every method gets the same changes at the
same short schedule. Trainings are stages in the cache, so that a stopped run goes on where it was.

"Raw animation" is what §3.5 argues against (claim C12): coarse networks trained on as many poses, drawn from the
training animation as it is, each frame as likely as any other (Eq. 5 with all factors 1). Validation and test poses are
the profile's. They are frames of the animation too, often neighbours of training frames, which favours the raw
animation: poses unlike the animation's, for which the paper augments, are not among them. So the same three networks,
raw, balanced and with uniform draws, are trained once more without some whole clips, and measured on these. No setting
is chosen by the results. A rig without clips has no animation, and no such rows.

The paper augments and balances for the sake of rare expressions, which a mean over frames hardly sees. So the errors on
whole clips are also given for each of 16 intervals of the test poses' landmarks along their first principal component,
and as the mean over the intervals, in which a rare one counts as much as a frequent one. That component may follow the
motion of the whole head; a second axis is that of the landmarks after a rigid fit to the neutral ones.
"""

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.approximation.metrics import Errors
from replicate.approximation.sampling import balance_bins
from replicate.benchmarks.common import (
    add_count,
    add_only,
    answer,
    artefacts_of,
    folders_of,
    in_groups,
    make_parser,
    make_stages,
    publish,
    selected,
    split_names,
)
from replicate.benchmarks.variants import floor_deg, validation_errors
from replicate.config import Config, resolve
from replicate.engine.stage import Stage, in_order
from replicate.engine.store import artefact_folder
from replicate.geometry.alignment import align
from replicate.methods import artefacts, measurement
from replicate.methods.method_registry import method_named
from replicate.methods.plan import Plan
from replicate.report.manifest import section
from replicate.report.notebooks import folder_of
from replicate.report.results import Row, characters_of, error_rows
from replicate.report.tables import Table, round_off

if TYPE_CHECKING:
    import matplotlib.figure

# The trainings as a table.

TABLE = "bench_training"
METRICS = {
    "validation_vertex_error": ("mm", "mm"),
    "validation_normal_error": ("deg", "degrees"),
    "normal_error_over_floor": ("ratio", "degrees / floor"),
    "clips_vertex_error": ("mm", "other clips, mm"),
    "clips_normal_error": ("deg", "other clips, degrees"),
}
AXES = {  # of the intervals that rare poses are found by
    "landmarks": "by the landmarks",
    "expressions": "by the landmarks less the head's motion",
}
METHODS = ("coarse", "refined", "dense")
BALANCED, RAW_ANIMATION = "balanced draws", "raw animation"  # changes that claim C12 compares
TWICE, RESTART = "twice the steps", "twice the steps, in two cycles"  # one long schedule, or a warm restart
USUAL = "peak rate 0.005"  # the recipe of the profile, among the changes: augmented, with uniform draws


def trainings_tables(rows: Iterable[Row]) -> list[Table]:
    """Return a table for each character in `bench_training.csv`: what was changed, mm, degrees, and over the floor.

    A row's metric is metric[change], as `replicate.benchmarks.bench_training` writes it.
    """
    shown = [row for row in rows if row.table == TABLE and row.method in METHODS]
    return [_trainings_table([row for row in shown if row.character == name], name) for name in characters_of(shown)]


def _trainings_table(rows: Sequence[Row], character: str) -> Table:
    by_change: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        metric, _, change = row.metric.rstrip("]").partition("[")
        by_change.setdefault((row.method, change), {})[metric] = row
    lines = []
    for method in METHODS:
        for change in sorted(change for name, change in by_change if name == method):
            found = (by_change[method, change].get(metric) for metric in METRICS)
            cells = (round_off(row.value, row.unit) if row else "" for row in found)
            lines.append((method, (method, change, *cells)))
    header = ("", "peak rate or change", *(name for _, name in METRICS.values()))
    validation = [row.poses or 0 for row in rows if not row.metric.startswith("clips_")]
    notes = [f"errors on {max(validation)} poses held out of the training animation; one seed."] if validation else []
    if clips := [row.poses or 0 for row in rows if row.metric.startswith("clips_")]:
        notes.append(
            f"Other clips: trained anew, with whole clips held out, and measured on {max(clips)} poses of these."
        )
    return Table(
        f"Trainings that differ in one thing: {character}", (header,), in_groups(lines), tuple(notes), text_columns=2
    )


def axis_text(rows: Iterable[Row]) -> str:
    """Return the controls that §3.5's intervals follow most, with their correlations, from `bench_training.csv`.

    A line for each character, after a heading.
    """
    all_rows = [row for row in rows if row.table == TABLE and row.metric.startswith("interval_correlation[")]
    lines = []
    for character in characters_of(all_rows):
        correlations = sorted((row for row in all_rows if row.character == character), key=lambda row: -abs(row.value))
        controls = (f"{row.metric.rstrip(']').partition('[')[2]} {row.value:+.2f}" for row in correlations)
        lines.append(f"{character}: {', '.join(controls)}")
    return "\n".join(["controls that the intervals follow most, with their correlations", *lines] if lines else [])


def draws_text(samples_per_bin: Sequence[int]) -> str:
    """Return which share of the samples, those in the emptier half of §3.5's intervals, gets half of its draws.

    samples_per_bin: how many samples lie in each interval of the landmarks' first principal component.
    """
    counts = sorted(count for count in samples_per_bin if count)
    rare = counts[: len(counts) // 2]
    return (
        f"{len(rare)} of {len(counts)} intervals hold {100 * sum(rare) / sum(counts):.1f} % of the samples and get "
        f"{100 * len(rare) / len(counts):.0f} % of the draws"
    )


def balance_text(name: str) -> str:
    """Return, for each character whose manifest records it, how §3.5's balanced draws were spread over the samples."""
    lines = []
    for character, facts in section(folder_of(name), "table2").get("characters", {}).items():
        samples = [stage for title, stage in facts.get("stages", {}).items() if title.startswith("samples-")]
        counts = samples[0].get("notes", {}).get("samples_per_bin") if samples else None
        if counts:
            lines.append(f"{character}: {draws_text(counts)}")
    return "\n".join(lines)


ABOUT = "what peak rates, augmentation, balanced draws and a bound on gradients do to the networks' errors"
WRITES = "results/runs/bench/bench_training.csv"
SECTIONS = {"coarse": "coarse", "refined": "refinement", "dense": "dense"}
RATES = (2e-3, 5e-3, 1.2e-2)
CHANGES = {  # in words → of the training's schedule
    **{f"peak rate {rate:g}": {"peak_rate": rate} for rate in RATES},
    BALANCED: {"draws": "balanced"},
    "gradients as they are": {"largest_gradient": 0.0},
    TWICE: {},
    RESTART: {"schedule": "two_cycles"},
}
LONGER = (TWICE, RESTART)  # changes whose trainings have twice the steps
AXIS_CONTROLS = 4
STEPS = 4_000  # of the short schedule
FLOORS = ("coarse", "refined")  # the methods whose maps have one
ON_CLIPS = {  # the coarse trainings that are measured on whole clips too, and what charts call them
    USUAL: "augmented, uniform draws",
    BALANCED: "augmented, balanced draws",
    RAW_ANIMATION: "raw animation",
}
COLOURS = ("#0072B2", "#D55E00", "#555555")


@dataclass(frozen=True)
class Variant:
    """One training: of which method, and what is changed, in words and as overrides of the profile.

    clips: whether it is measured on whole clips, of which training has no frame.
    """

    method: str
    change: str
    overrides: dict
    clips: bool = False

    def __str__(self) -> str:
        """Return what the training is called."""
        return f"{self.method}, {self.change}" + (", other clips" if self.clips else "")


def variants(steps: int) -> list[Variant]:
    """Return all trainings at a schedule of `steps`: each method's peak rates, then other changes to the profile."""
    choices = [
        Variant(method, words, _at(section, (2 if words in LONGER else 1) * steps, training))
        for method, section in SECTIONS.items()
        for words, training in CHANGES.items()
    ]
    raw = _at("coarse", steps, {}) | {"samples": {"low": 1.0, "high": 1.0}}
    choices.append(Variant("coarse", RAW_ANIMATION, raw))
    coarse = [variant for variant in choices if variant.method == "coarse" and variant.change in ON_CLIPS]
    return [*choices, *map(_on_other_clips, coarse)]


def _on_other_clips(variant: Variant) -> Variant:
    samples = variant.overrides.get("samples", {}) | {"split": "clips"}
    return replace(variant, overrides=variant.overrides | {"samples": samples}, clips=True)


def _at(section: str, steps: int, training: dict) -> dict:
    """Return the overrides that train a section's networks, and the coarse ones below them, for so many steps."""
    short = {"training": {"steps": steps}}
    return {"coarse": short, section: {"training": {"steps": steps} | training}}


def stages_of(config: Config, variant: Variant) -> dict[str, Stage]:
    """Return by name the stages of a training and all behind them; the one that needs all others comes last."""
    plan, method = Plan(config), method_named(variant.method)
    wanted = [measurement.stage(plan, method)] if variant.clips else list(method.stages(plan))
    return {stage.name: stage for stage in in_order(wanted)}


def has_clips(config: Config) -> bool:
    """Return whether a character's rig, which is built where it is missing, has an animation."""
    return artefacts.load_rig(artefacts_of(TABLE, config, [artefacts.rig_stage(Plan(config))])).clips is not None


def clip_rows(stages: dict[str, Stage], config: Config, variant: Variant) -> list[Row]:
    """Return a finished training's mean errors on clips of which it has no frame."""
    errors = measurement.load_errors(artefact_folder(stages[f"{measurement.PREFIX}{variant.method}"].identifier))
    rows = error_rows(stages["rig"].label, {variant.method: errors}, config.profile, "bench-training")
    names = {f"{kind}_error_mean": f"clips_{kind}_error[{variant.change}]" for kind in ("vertex", "normal")}
    means = [replace(row, table=TABLE, metric=names[row.metric]) for row in rows if row.metric in names]
    by_interval = _rows_by_interval(stages["rig"].label, folders_of(stages.values()), config, variant, errors)
    return [*means, *by_interval]


def _rows_by_interval(
    character: str, inputs: Mapping[str, Path], config: Config, variant: Variant, errors: Errors
) -> list[Row]:
    """Return the mean errors in each interval of either axis, and the means over the intervals that have a pose."""
    rig, samples = artefacts.load_rig(inputs), artefacts.load_samples(inputs)
    poses = measurement.measured_poses(samples.test_params, config.evaluation.test_poses, config.seed)
    neutral = rig.mesh.neutral[rig.landmarks]
    moved = neutral + np.asarray(samples.test_offsets[poses][:, rig.landmarks], np.float32)
    found = []
    for axis, positions in zip(AXES, (moved, without_motion(moved, neutral)), strict=True):
        interval = balance_bins(positions, config.samples.bins)
        for kind, unit, of_pose in (("vertex", "mm", errors.pose_mm), ("normal", "deg", errors.pose_deg)):
            means = {int(k): float(of_pose[interval == k].mean()) for k in np.unique(interval)}
            name = f"clips_{kind}_error_{axis}"
            found.append((f"{name}[{variant.change}]", unit, float(np.mean(list(means.values()))), len(poses)))
            found += [
                (f"{name}_{k:02}[{variant.change}]", unit, mean, int((interval == k).sum()))
                for k, mean in means.items()
            ]
    return [
        Row(
            TABLE,
            character,
            variant.method,
            metric,
            unit,
            value,
            None,
            1,
            count,
            config.profile,
            "bench-training",
        )
        for metric, unit, value, count in found
    ]


def without_motion(
    positions: Float[np.ndarray, "k l 3"], neutral: Float[np.ndarray, "l 3"]
) -> Float[np.ndarray, "k l 3"]:
    """Return the landmarks of k poses in mm, each pose after the rigid motion that brings it nearest to the neutral."""
    rotation, shift = align(positions, neutral)
    return positions @ rotation + shift[:, None]


def intervals_chart(rows: Iterable[Row], character: str, kind: str = "normal") -> "matplotlib.figure.Figure":
    """Draw the errors on clips that training lacks over the intervals of both axes, a line a training.

    kind: "normal" or "vertex". Circles grow with the number of test poses in an interval.
    """
    import matplotlib.pyplot as plt

    shown = [row for row in rows if row.table == TABLE and row.character == character]
    figure, panels = plt.subplots(1, len(AXES), figsize=(8.4, 3.2), sharey=True, layout="constrained")
    for panel, (axis, words) in zip(panels, AXES.items(), strict=True):
        for change, colour in zip(ON_CLIPS, COLOURS, strict=True):
            start, ending = f"clips_{kind}_error_{axis}_", f"[{change}]"
            line = sorted(
                (int(row.metric.removeprefix(start).removesuffix(ending)), row.value, row.poses or 0)
                for row in shown
                if row.metric.startswith(start) and row.metric.endswith(ending)
            )
            if line:
                interval, values, poses = map(np.asarray, zip(*line, strict=True))
                panel.plot(interval + 1, values, color=colour, label=ON_CLIPS[change])
                panel.scatter(interval + 1, values, 6 + 60 * poses / poses.sum(), color=colour)
        panel.set_title(words, fontsize=10)
        panel.set_xlabel("interval")
    panels[0].set_ylabel("normal error, degrees" if kind == "normal" else "distance, mm")
    panels[0].set_ylim(bottom=0)
    panels[0].legend(fontsize=9)
    return figure


def axis_rows(stages: dict[str, Stage], profile: str) -> list[Row]:
    """Return the largest correlations of controls with the samples' intervals (§3.5) as rows."""
    inputs = folders_of(stages.values())
    controls, samples = artefacts.load_rig(inputs).controls, artefacts.load_samples(inputs)
    params = np.asarray(samples.params, np.float64)
    centred, interval = params - params.mean(0), samples.bins - samples.bins.mean()
    sizes = np.linalg.norm(centred, axis=0) * np.linalg.norm(interval)
    follows = np.divide(centred.T @ interval, sizes, out=np.zeros(len(sizes)), where=sizes > 0)
    strongest = np.argsort(-np.abs(follows))[:AXIS_CONTROLS]
    facts = (None, 1, len(params), profile, "bench-training")
    label = stages["rig"].label
    return [
        Row(TABLE, label, "samples", f"interval_correlation[{controls[k].name}]", "ratio", float(follows[k]), *facts)
        for k in strongest
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose settings are changed")
    add_count(parser, "steps", STEPS, "of the short schedule")
    add_only(parser)
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    for name in split_names(options.characters):
        rows = compare(name, options)
        publish(TABLE, rows, trainings_tables(rows), command_line, in_part=bool(options.only))


def compare(character: str, options: argparse.Namespace) -> list[Row]:
    """Train all variants for a character and return their errors on validation poses, or on other clips."""
    selection = selected(variants(options.steps), options.only)
    if not has_clips(resolve(character, options.profile)):  # its poses are drawn uniformly
        selection = [variant for variant in selection if variant.change != RAW_ANIMATION and not variant.clips]
    configs = [resolve(character, options.profile, variant.overrides) for variant in selection]
    graphs = [stages_of(config, variant) for config, variant in zip(configs, selection, strict=True)]
    make_stages(TABLE, options.profile, [list(graph.values())[-1] for graph in graphs])
    rows = []
    for variant, config, graph in zip(selection, configs, graphs, strict=True):
        if variant.clips:
            rows += clip_rows(graph, config, variant)
            continue
        mm, degrees = validation_errors(artefact_folder(graph[variant.method].identifier))
        errors = {"validation_vertex_error": mm, "validation_normal_error": degrees}
        if variant.method in FLOORS:
            inputs = folders_of(graph.values())
            mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
            segments = artefacts.load_coarse_segments(inputs, mesh)
            squares = artefacts.load_squares(inputs) if variant.method == "refined" else ()
            sizes = (config.coarse.map_size, squares, config.refinement.map_size)
            errors["normal_error_over_floor"] = degrees / floor_deg(mesh, samples, segments, *sizes)
        for metric, value in errors.items():
            name, unit = f"{metric}[{variant.change}]", METRICS[metric][0]
            facts = (None, 1, config.samples.validation, config.profile, "bench-training")
            rows.append(Row(TABLE, graph["rig"].label, variant.method, name, unit, value, *facts))
        if (variant.method, variant.change) == ("coarse", BALANCED):
            rows += axis_rows(graph, config.profile)
    return rows


if __name__ == "__main__":
    sys.exit(main())
