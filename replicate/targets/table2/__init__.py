"""Table 2: approximation errors of every method on held-out poses, beside the paper's; with Figures 9 and 10."""

import argparse
from collections.abc import Sequence

from replicate.artefacts.plan import Plan
from replicate.engine.exceptions import RunError
from replicate.engine.stage import Stage, StageContext
from replicate.methods.method import Method
from replicate.targets.options import OF_A_RUN
from replicate.targets.running import make_rows
from replicate.targets.shown_records import record_stages
from replicate.targets.table2.table_numbers import TableNumbers

ABOUT = "Table 2: approximation errors of every method on held-out poses, beside the paper's; Figures 9 and 10"
WRITES = "results/runs/<profile>/"
OPTIONS = (*OF_A_RUN, "methods", "numbers-only")
IN_COMPARISON = True


def stages(plan: Plan, methods: Sequence[Method]) -> list[Stage]:
    """Return the stages of one character's table, the last; those of the methods, the slow ones, come first."""
    numbers = TableNumbers(plan.character, plan.config.profile, plan.config.seed)
    return record_stages(plan, methods, "table2", write_table, numbers)


def write_table(context: StageContext) -> None:
    """Gather one character's rows, the curves of its trainings and the poses that figures show."""
    from replicate.targets.table2.character_part import write_all

    write_all(context.config, context.inputs, context.out)


def run(options: argparse.Namespace) -> None:
    """Make the errors of every method on every character, publish and print them.

    Raises RunError at the end for methods that failed: the other rows are published then.
    """
    from replicate.targets.table2.publishing import publish

    results, missing = make_rows(options, stages)
    publish(results, not options.numbers_only)
    if missing:
        raise RunError("; ".join(missing))
