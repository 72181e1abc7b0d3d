"""Table 3: milliseconds that one pose takes, of the rig and of every approximation with the rigid step (§5.2)."""

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime

from replicate.base import paths
from replicate.cli.options import configurations, methods
from replicate.cli.running import make
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts, measurement
from replicate.methods.measurement import reading
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference
from replicate.report.notebooks import rows_if_there
from replicate.report.publication import CharacterResult, by_character, results_folder
from replicate.report.results import Row
from replicate.targets.table3.rows import RigNumbers, RowsNumbers, TimingNumbers

FILE = "table3.csv"
TURNS = {"quick": 100, "laptop": 1_000, "paper": 1_000}  # evaluations of single poses


def stages(plan: Plan, methods: Sequence[Method], timing: Stage | None = None) -> list[Stage]:
    """Return the stages of one character's table, the last; those of the methods, the slow ones, come first.

    timing: the measurement of all rigs of the run, this one among them; by default of this one alone.
    """
    timing = timing or timing_stage([(plan, methods)])
    own_rows = plan.stage("table3", read_rows, RowsNumbers(_file(plan)), timing)
    return [*(stage for method in _timed(methods) for stage in method.stages(plan)), own_rows]


def timing_stage(rigs: Sequence[tuple[Plan, Sequence[Method]]], measured: str = "") -> Stage:
    """Return the stage that times some rigs and their methods together.

    measured: when the measurement is asked for, so that no earlier one is taken for it.
    """
    inputs: dict[str, Stage] = {}
    numbers, functions = [], [reference(measure)]
    for plan, chosen in rigs:
        timed = _timed(chosen)
        shared = [stage(plan) for stage in (artefacts.rig_stage, artefacts.samples_stage, artefacts.rigid_stage)]
        own = {stage.name: stage for stage in (*shared, *(stage for method in timed for stage in method.stages(plan)))}
        inputs |= {stage.title: stage for stage in own.values()}
        functions += [reference(source) for method in timed for source in reading(method, plan.config).sources]
        numbers.append(
            RigNumbers(
                plan.character,
                plan.config.profile,
                tuple(measurement.numbers_of(method, plan.config) for method in timed),
                tuple((method.name, reference(method.model)) for method in timed if method.model),
                TURNS[plan.config.profile],
                tuple((name, stage.title) for name, stage in own.items()),
                _file(plan),
            )
        )
    label = f"{len(rigs)}_rigs" if len(rigs) > 1 else rigs[0][0].character
    settings = TimingNumbers(tuple(numbers), measured)
    return Stage("timing", ", ".join(dict.fromkeys(functions)), settings, tuple(inputs.values()), label, threads=0)


def _timed(methods: Sequence[Method]) -> list[Method]:
    return [method for method in methods if not method.oracle]


def _file(plan: Plan) -> str:
    return f"{plan.character}-seed{plan.config.seed}.csv"


def measure(context: StageContext) -> None:
    """Time the rigs and all methods; the rigs on the CPU, even where JAX has a GPU."""
    import jax

    from replicate.targets.table3.rows import write_all

    with jax.default_device(jax.devices("cpu")[0]):
        write_all(context.config.rigs, context.inputs, context.progress, context.out)


def read_rows(context: StageContext) -> None:
    """Take one character's rows from the measurement."""
    from replicate.base.files import copy_file

    copy_file(context.inputs["timing"] / context.config.file, context.out / FILE)


def run(options: argparse.Namespace) -> None:
    """Make the methods of every character, time all of them together, publish the rows and print them."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    timing = timing_stage([(Plan(one), methods(options, one)) for one in configurations(options)], now)
    publish(make(options, lambda plan: stages(plan, methods(options, plan.config), timing)))


def publish(results: Sequence[CharacterResult]) -> None:
    """Write Table 3 of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    Where the folder has a Table 3 of the same characters, how far its speed-ups are from these is in the rows and
    printed too.
    """
    from replicate.base.paths import PAPER, display_path
    from replicate.report.publication import publish_rows
    from replicate.report.results import read_results
    from replicate.report.tables import as_text
    from replicate.targets.table3.shown import agreement_rows, agreement_table, tables3

    folder = results_folder(results[0].config.profile)
    own = by_character(results)
    rows = publish_rows("table3", results, agreement_rows)
    for table in tables3(rows, read_results(PAPER / FILE)):
        print(as_text(table))
    if table := agreement_table(row for row in rows if row.character in own):
        print(as_text(table))
    print(f"written to {display_path(folder)}: {FILE}, manifest.json, and table3.ipynb to read them in")


# Table 3 by a machine with a GPU: its committed rows stand apart from those of the machine that texts quote.

GPU_TABLE = "table3_gpu"  # its rows' table where they stand beside those of the other machine


def gpu_machine_rows(results: str) -> list[Row]:
    """Return Table 3 by the machine with a GPU of committed results; none for a run of yours, whose own table has it.

    results: "reference", or the profile of a run of yours.
    """
    return rows_if_there(paths.GPU_MACHINE, FILE) if results in paths.committed_folders() else []


def beside(rows: Iterable[Row]) -> list[Row]:
    """Return rows of that machine as those of a table of their own, to be looked up beside Table 3."""
    return [replace(row, table=GPU_TABLE) for row in rows]
