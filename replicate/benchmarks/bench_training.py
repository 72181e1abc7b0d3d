"""What decides the networks' errors: peak rates, the augmentation and balanced draws of §3.5, a bound on gradients.

`make bench-training` trains each method several times with one thing changed and compares the errors on the validation
poses, which are held out of the training animation; test poses are not looked at. All is tried for every method alike,
at the same short schedule. Trainings go through the cache like any stage, so that a stopped run goes on.

"Raw animation" is what §3.5 argues against (claim C12): coarse networks trained on as many poses, drawn from the
training animation as it is, each frame as likely as any other (Eq. 5 with all factors 1). Validation and test poses are
the profile's. They are frames of the animation too, often neighbours of training frames, which favours the raw
animation: poses unlike the animation's, for which the paper augments, are not among them. So the same three networks,
raw, balanced and with uniform draws, are trained once more with whole clips held out, and measured on these clips, of
which training has no frame. Nothing is chosen there. A rig without clips has no animation, and no such rows.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from replicate.artefacts import built_rig, drawn_samples, refinement_squares, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.benchmarks.common import (
    add_count,
    add_only,
    answer,
    artefacts_of,
    make_parser,
    publish,
    selected,
    split_names,
)
from replicate.benchmarks.training_table import (
    BALANCED,
    METRICS,
    RAW_ANIMATION,
    RESTART,
    TABLE,
    TWICE,
    USUAL,
    trainings_tables,
)
from replicate.config import Config, resolve
from replicate.engine.provenance import core_count, provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage, in_order
from replicate.engine.store import artefact_folder
from replicate.methods import measurement
from replicate.methods.method_registry import method_named
from replicate.methods.training_stage import LOG
from replicate.report.error_rows import error_rows
from replicate.report.results import Row
from replicate.report.training_curves import read_log

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
ON_CLIPS = (USUAL, BALANCED, RAW_ANIMATION)  # the coarse trainings that are measured on whole clips too


@dataclass(frozen=True)
class Variant:
    """One training: which method's, what is changed in words, and as overrides of the profile.

    clips: whether it has no frame of the clips that it is measured on.
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
    """Return the overrides that train a section's networks, and those that they add to, for so many steps."""
    short = {"training": {"steps": steps}}
    return {"coarse": short, section: {"training": {"steps": steps} | training}}


def stages_of(config: Config, variant: Variant) -> dict[str, Stage]:
    """Return the stages that a training, and its floor or its errors on other clips, need, by name; the last, last."""
    plan, method = Plan(config), method_named(variant.method)
    wanted = [measurement.stage(plan, method)] if variant.clips else list(method.stages(plan))
    return {stage.name: stage for stage in in_order(wanted)}


def validation_errors(stages: dict[str, Stage], method: str) -> tuple[float, float]:
    """Return a finished training's validation errors (mm, degrees): the last row of its log."""
    *_, last = read_log(artefact_folder(stages[method].identifier) / LOG)
    return last[2], last[3]


def floor_deg(stages: dict[str, Stage], config: Config, refined: bool) -> float:
    """Return the projection floor's mean normal error on the validation poses, as the log measures it."""
    from replicate.approximation.deformation_map import Floor
    from replicate.approximation.segments import segment_vertices
    from replicate.approximation.supervision import Supervision

    inputs = {name: artefact_folder(stage.identifier) for name, stage in stages.items()}
    mesh, samples = built_rig.load_mesh(inputs), drawn_samples.load(inputs)
    segments = rigid_segments.load_coarse_segments(inputs, mesh)
    squares = refinement_squares.load(inputs) if refined else ()
    floor = Floor(segments, config.coarse.map_size, squares, config.refinement.map_size)
    supervision = Supervision(mesh, samples, segment_vertices(segments), 1.0, "cpu")
    return supervision.validation()(lambda _: floor(np.asarray(samples.validation_offsets)))[1]


def has_clips(config: Config) -> bool:
    """Return whether a character's rig, which is built if it isn't there, has an animation to draw poses from."""
    return built_rig.load(artefacts_of(TABLE, config, [built_rig.stage(Plan(config))])).clips is not None


def clip_rows(stages: dict[str, Stage], config: Config, variant: Variant) -> list[Row]:
    """Return a finished training's mean errors on clips of which it has no frame."""
    errors = measurement.load_errors(artefact_folder(stages[f"{measurement.PREFIX}{variant.method}"].identifier))
    rows = error_rows(stages["rig"].label, {variant.method: errors}, config.profile, "bench-training")
    names = {f"{kind}_error_mean": f"clips_{kind}_error[{variant.change}]" for kind in ("vertex", "normal")}
    return [replace(row, table=TABLE, metric=names[row.metric]) for row in rows if row.metric in names]


def axis_rows(stages: dict[str, Stage], profile: str) -> list[Row]:
    """Return which controls the balanced intervals follow: correlations of controls with the samples' intervals."""
    inputs = {name: artefact_folder(stage.identifier) for name, stage in stages.items()}
    controls, samples = built_rig.load(inputs).controls, drawn_samples.load(inputs)
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
    parser = make_parser(TABLE, __doc__, profile="whose numbers are changed")
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
    if not has_clips(resolve(character, options.profile)):  # its poses are drawn uniformly, with any factors
        selection = [variant for variant in selection if variant.change != RAW_ANIMATION and not variant.clips]
    configs = [resolve(character, options.profile, variant.overrides) for variant in selection]
    graphs = [stages_of(config, variant) for config, variant in zip(configs, selection, strict=True)]
    facts = provenance(["make", "bench-training"], options.profile, [0], core_count())
    run([list(graph.values())[-1] for graph in graphs], facts=facts)
    rows = []
    for variant, config, graph in zip(selection, configs, graphs, strict=True):
        if variant.clips:
            rows += clip_rows(graph, config, variant)
            continue
        mm, degrees = validation_errors(graph, variant.method)
        errors = {"validation_vertex_error": mm, "validation_normal_error": degrees}
        if variant.method in FLOORS:
            errors["normal_error_over_floor"] = degrees / floor_deg(graph, config, variant.method == "refined")
        for metric, value in errors.items():
            name, unit = f"{metric}[{variant.change}]", METRICS[metric][0]
            facts = (None, 1, config.samples.validation, config.profile, "bench-training")
            rows.append(Row(TABLE, graph["rig"].label, variant.method, name, unit, value, *facts))
        if (variant.method, variant.change) == ("coarse", BALANCED):
            rows += axis_rows(graph, config.profile)
    return rows


if __name__ == "__main__":
    sys.exit(main())
