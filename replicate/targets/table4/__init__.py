"""Make Table 4: the methods' errors in poses that inverse kinematics finds for dragged control points (§5.3.1)."""

import argparse
from collections.abc import Sequence

from replicate.base.paths import PAPER, display_path
from replicate.cli.running import make_rows
from replicate.engine.stage import Stage, StageContext
from replicate.inverse import ik_stage
from replicate.methods import artefacts, measurement
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference
from replicate.report.publication import CharacterResult, publish_rows, results_folder
from replicate.report.results import STANDS_FOR, read_results
from replicate.report.tables import as_text
from replicate.targets.shown_records import posing_stage
from replicate.targets.table4.rows import PosingSettings, Source, write_all
from replicate.targets.table4.tables import tables4

FILE = "table4.csv"
OWN_GRADIENTS = ("Toothless",)  # film characters whose IK networks are trained through each method itself


def stages(plan: Plan, methods: Sequence[Method]) -> list[Stage]:
    """Return the stages of one character's table, those of the methods, the slow ones, first and the table last."""
    predicting = [method for method in methods if not method.oracle]
    differentiable = [method for method in predicting if method.model]
    through_rig = ik_stage.stage(plan, None)  # takes longest, and needs none of the methods' networks
    trained = [*(ik_stage.stage(plan, method) for method in differentiable), through_rig]
    sources = [Source(method.name, reference(method.model)) for method in differentiable]
    base = plan.character.partition("@")[0]
    settings = PosingSettings(
        plan.character,
        plan.config.profile,
        plan.config.seed,
        ik_stage.section(plan),
        tuple(measurement.measurement_settings(method, plan.config) for method in predicting),
        (*sources, Source(ik_stage.RIG, "")),
        STANDS_FOR.get(base) in OWN_GRADIENTS,
    )
    shared = (
        stage(plan)
        for stage in (artefacts.rig_stage, artefacts.samples_stage, artefacts.influence_stage, artefacts.rigid_stage)
    )
    method_stages = [stage for method in predicting for stage in method.stages(plan)]
    # Table 2's measurement finds a method that fails before all are evaluated together
    checks = [measurement.stage(plan, method) for method in predicting]
    inputs = (*shared, *method_stages, *checks, *trained)
    last = posing_stage(plan, "table4", pose, settings, predicting, inputs)
    return [*method_stages, through_rig, *checks, *trained, last]


def pose(context: StageContext) -> None:
    """Find poses for the configurations of control points and measure every method in them."""
    write_all(context.config, context.inputs, context.files, context.progress, context.out)


def run(options: argparse.Namespace) -> None:
    """Make the rows of every character, publish and print them.

    Raises RunError for methods that failed, after it has published the other rows.
    """
    make_rows(options, lambda rigs: [stages(plan, chosen) for plan, chosen in rigs], publish)


def publish(results: Sequence[CharacterResult]) -> None:
    """Write Table 4 of some characters to the profile's folder, print it, and execute its notebook if it is stale."""
    rows = publish_rows("table4", results)
    for table in tables4(rows, read_results(PAPER / FILE)):
        print(as_text(table))
    print(f"written to {display_path(results_folder(results[0].config.profile))}: {FILE}, manifest.json")
