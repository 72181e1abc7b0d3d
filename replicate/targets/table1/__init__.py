"""Table 1: counts of segments and sizes of models, beside the paper's; nothing is trained for it."""

import argparse
from collections.abc import Sequence

from replicate.approximation.model_size import shape_of
from replicate.base.paths import PAPER, display_path
from replicate.cli.running import make
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.publication import CharacterResult, publish_rows, results_folder
from replicate.report.results import read_results, write_results
from replicate.report.tables import as_text
from replicate.targets.table1.tables import SizeSettings, rows_of, size_claim, table1

FILE = "table1.csv"


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that holds one character's rows."""
    config = plan.config
    shapes = map(shape_of, (config.coarse, config.refinement))
    modules = (artefacts.rig_stage, artefacts.influence_stage, artefacts.rigid_stage, artefacts.squares_stage)
    settings = SizeSettings(plan.character, config.profile, *shapes)
    return [plan.stage("table1", count, settings, *(stage(plan) for stage in modules))]


def count(context: StageContext) -> None:
    """Count one character's segments and weigh its models."""
    write_results(context.out / FILE, rows_of(context.config, context.inputs))


def run(options: argparse.Namespace) -> None:
    """Make the rows of every character, publish and print them."""
    publish(make(options, stages))


def publish(results: Sequence[CharacterResult]) -> None:
    """Write Table 1 of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    Several seeds are averaged. Results of other characters stay.
    """
    rows, folder = publish_rows("table1", results), results_folder(results[0].config.profile)
    paper = read_results(PAPER / FILE)
    print(as_text(table1(rows, paper)))
    print(size_claim(rows, paper))
    print(f"written to {display_path(folder)}: {FILE}, manifest.json, and table1.ipynb to read it in")
