"""Figure 12: performance capture with a known truth: two rigs act, and their landmarks drive one character."""

import argparse
from collections.abc import Sequence
from dataclasses import replace

from replicate.approximation.training import prepare
from replicate.base.paths import display_path
from replicate.capture import landmark_rig
from replicate.cli.options import methods
from replicate.cli.running import make
from replicate.drawing.panels import save_figure
from replicate.engine.stage import Stage, StageContext
from replicate.inverse import ik_stage
from replicate.methods import artefacts, measurement, refined
from replicate.methods.measurement import reading
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference
from replicate.report.publication import CharacterResult, publish_rows, results_folder
from replicate.report.results import write_results
from replicate.report.tables import as_text
from replicate.targets.capture import section
from replicate.targets.figure12 import rows as figure12_rows
from replicate.targets.figure12.rows import CaptureTrial, ThroughMethod, capture_rows, drivers
from replicate.targets.figure12.shown import figure12, noise_curves, tables12

ACTORS = ("woman", "teen")  # the second actor is the first of these that isn't the character itself


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's figure, the slow ones that train first.

    methods: IK networks are trained through the refined model and through those of these that have a model.
    """
    through = {method.name: method for method in (refined.METHOD, *methods) if method.model and not method.oracle}
    trained = [landmark_rig.ik_stage_of(plan, method) for method in through.values()]
    other = Plan(replace(plan.config, character=actor_beside(plan)))
    acting = {stage.title: stage for stage in (figure12_rows.stage(plan), figure12_rows.stage(other))}
    settings = CaptureTrial(
        plan.character,
        tuple(dict.fromkeys((plan.character, other.character))),
        plan.config.profile,
        plan.config.seed,
        section(plan.config),
        ik_stage.section(plan),
        tuple(
            ThroughMethod(measurement.measurement_settings(method, plan.config), reference(method.model))
            for method in through.values()
        ),
    )
    shared = (
        artefacts.rig_stage,
        artefacts.samples_stage,
        artefacts.influence_stage,
        artefacts.rigid_stage,
        landmark_rig.stage,
    )
    method_stages = [stage for method in through.values() for stage in method.stages(plan)]
    needed = (*(stage(plan) for stage in shared), *method_stages, *trained)
    inputs = {stage.title: stage for stage in needed} | acting
    readers = [source for method in through.values() for source in reading(method, plan.config).sources]
    functions = ", ".join(dict.fromkeys(map(reference, (draw, *readers))))
    return [*method_stages, *trained, *acting.values(), plan.stage("figure12", functions, settings, *inputs.values())]


def actor_beside(plan: Plan) -> str:
    """Return the second actor: the configuration's, or else another character of ours."""
    character = plan.character.partition("@")[0]
    return section(plan.config).actor or next(name for name in ACTORS if name != character)


def draw(context: StageContext) -> None:
    """Measure every way to drive the character, and draw the figure and its curves."""
    prepare("cpu")
    trial, stem = context.config, f"figure12_{context.config.character}"
    every = drivers(trial, context.inputs)
    rows = capture_rows(trial, context.inputs, every, context.progress)
    write_results(context.out / "figure12.csv", rows)
    figure, words = figure12(trial, context.inputs, every[0])
    save_figure(figure, context.out / f"{stem}.png", words)
    figure, words = noise_curves(trial, rows)
    save_figure(figure, context.out / f"{stem}_noise.png", words)


def run(options: argparse.Namespace) -> None:
    """Make the figure of every character, publish and print its numbers."""
    publish(make(options, lambda plan: stages(plan, methods(options, plan.config))))


def publish(results: Sequence[CharacterResult]) -> None:
    """Write the rows and pictures of some characters to the profile's folder, and print the tables."""
    rows = publish_rows("figure12", results)
    for table in tables12(rows):
        print(as_text(table))
    folder = display_path(results_folder(results[0].config.profile))
    print(f"written to {folder}: figure12.csv, its pictures, manifest.json, and figure12.ipynb to read them in")
