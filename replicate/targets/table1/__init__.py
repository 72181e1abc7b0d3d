"""Table 1: counts of segments and sizes of models, beside the paper's; nothing is trained for it."""

import argparse
from collections.abc import Sequence

from replicate.approximation.model_size import shape_of
from replicate.artefacts import built_rig, control_influence, refinement_squares, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.paths import PAPER, display_path
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.report.cast import cast
from replicate.report.publication import CharacterResult, alone, by_character, facts_of, readable, results_folder
from replicate.targets.options import OF_A_RUN
from replicate.targets.running import make
from replicate.targets.table1.size_numbers import SizeNumbers

ABOUT = "Table 1: counts of segments, model sizes and what brackets them, and the verdict on claim C6"
WRITES = "results/runs/<profile>/"
OPTIONS = OF_A_RUN
CHARACTERS = cast
IN_COMPARISON = True
FILE = "table1.csv"


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that holds one character's rows."""
    config = plan.config
    shapes = map(shape_of, (config.coarse, config.refinement))
    modules = (built_rig, control_influence, rigid_segments, refinement_squares)
    numbers = SizeNumbers(plan.character, config.profile, *shapes)
    return [plan.stage("table1", count, numbers, *(module.stage(plan) for module in modules))]


def count(context: StageContext) -> None:
    """Count one character's segments and weigh its models."""
    from replicate.report.results import write_results
    from replicate.targets.table1.size_rows import rows_of

    write_results(context.out / FILE, rows_of(context.config, context.inputs))


def run(options: argparse.Namespace) -> None:
    """Make the rows of every character, publish and print them."""
    publish(make(options, stages))


def publish(results: Sequence[CharacterResult]) -> None:
    """Write Table 1 of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    Of several seeds the means are written. Results of characters that are not among them stay.
    """
    from replicate.report import manifest
    from replicate.report.notebooks import run_notebook
    from replicate.report.results import over_seeds, read_results, write_results
    from replicate.report.tables import as_text
    from replicate.targets.table1.size_table import size_claim, table1

    profile = results[0].config.profile
    folder, groups = results_folder(profile), by_character(results)
    with alone(folder):
        facts = manifest.entries(folder, "table1")
        rows = readable(read_results, folder / FILE) or []
        runs = {name: {row.run for row in rows if row.character == name} for name in facts}
        facts = {name: own for name, own in facts.items() if runs[name] == {own.get("run")} and name not in groups}
        rows = [row for row in rows if row.character in facts]
        for character, each in groups.items():
            rows += over_seeds([read_results(one.folder / FILE) for one in each])
            facts[character] = facts_of(each, rows[-1].run)
        write_results(folder / FILE, rows)
        manifest.write_entries(folder, "table1", dict(sorted(facts.items())))
        run_notebook("table1", profile)
    paper = read_results(PAPER / FILE)
    print(as_text(table1(rows, paper)))
    print(size_claim(rows, paper))
    print(f"written to {display_path(folder)}: {FILE}, {manifest.NAME}, and table1.ipynb to read it in")
