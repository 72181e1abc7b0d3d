"""How hard is a rig? What simple regressions, few components, small maps and sums of controls miss of its poses."""

import argparse
from collections.abc import Sequence

from replicate.artefacts import built_rig, control_influence, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.report.cast import cast
from replicate.targets.options import OF_A_RUN
from replicate.targets.rig_report import control_pairs, map_resolution, regressions
from replicate.targets.rig_report.report_numbers import ReportNumbers
from replicate.targets.running import make

ABOUT = "how hard each rig is: held-out errors of simple fits, components, interacting controls, map sizes"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
CHARACTERS = cast


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that holds one character's rows and figure, behind those that measure it."""
    measured = [module.stage(plan) for module in (regressions, control_pairs, map_resolution)]
    shared = (module.stage(plan) for module in (built_rig, control_influence, rigid_segments))
    numbers = ReportNumbers(plan.character, plan.config.profile, plan.config.seed)
    return [*measured, plan.stage("rig_report", write_report, numbers, *shared, *measured)]


def write_report(context: StageContext) -> None:
    """Write one character's rows, its strongest pairs of controls and its figure."""
    from replicate.targets.rig_report.character_report import write_all

    write_all(context.config, context.inputs, context.out)


def run(options: argparse.Namespace) -> None:
    """Measure every character, publish and print the report."""
    from replicate.targets.rig_report.report_publication import publish

    publish(make(options, stages))
