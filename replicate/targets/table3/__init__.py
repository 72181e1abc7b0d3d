"""Make Table 3: the milliseconds that one pose takes, by the rig and by every approximation with the rigid step."""

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime

from replicate.base import paths
from replicate.base.files import copy_file
from replicate.base.paths import PAPER, display_path
from replicate.cli.running import make_rows
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts, measurement
from replicate.methods.measurement import reading
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference
from replicate.report.notebooks import rows_if_there
from replicate.report.publication import CharacterResult, by_character, publish_rows, results_folder
from replicate.report.results import Row, read_results
from replicate.report.tables import as_text
from replicate.targets.table3.rows import RigSettings, RowsSettings, TimingSettings, write_all
from replicate.targets.table3.shown import agreement_rows, agreement_table, tables3

FILE = "table3.csv"
TURNS = {"quick": 100, "laptop": 1_000, "paper": 1_000}  # evaluations of single poses (§5.2), by profile


def stages(plan: Plan, methods: Sequence[Method], timing: Stage | None = None) -> list[Stage]:
    """Return the stages of one character's table, those of the methods, the slow ones, first and the table last.

    timing: the measurement of all rigs of the run, which include this one; by default of this one alone.
    """
    timing = timing or timing_stage([(plan, methods)])
    rows = plan.stage("table3", read_rows, RowsSettings(_file(plan)), timing)
    return [*(stage for method in _timed(methods) for stage in (*method.stages(plan), _check(plan, method))), rows]


def timing_stage(rigs: Sequence[tuple[Plan, Sequence[Method]]], measured: str = "") -> Stage:
    """Return the stage that times some rigs and their methods together.

    measured: the time of the request, so that no earlier measurement is reused.
    """
    inputs: dict[str, Stage] = {}
    timed_rigs, functions = [], [reference(measure)]
    for plan, chosen in rigs:
        timed = _timed(chosen)
        shared = [stage(plan) for stage in (artefacts.rig_stage, artefacts.samples_stage, artefacts.rigid_stage)]
        needed = {
            stage.name: stage for stage in (*shared, *(stage for method in timed for stage in method.stages(plan)))
        }
        inputs |= {stage.title: stage for stage in (*needed.values(), *(_check(plan, method) for method in timed))}
        functions += [reference(source) for method in timed for source in reading(method, plan.config).sources]
        timed_rigs.append(
            RigSettings(
                plan.character,
                plan.config.profile,
                tuple(measurement.measurement_settings(method, plan.config) for method in timed),
                tuple((method.name, reference(method.model)) for method in timed if method.model),
                TURNS[plan.config.profile],
                tuple((name, stage.title) for name, stage in needed.items()),
                _file(plan),
            )
        )
    label = f"{len(rigs)}_rigs" if len(rigs) > 1 else rigs[0][0].character
    settings = TimingSettings(tuple(timed_rigs), measured)
    return Stage("timing", ", ".join(dict.fromkeys(functions)), settings, tuple(inputs.values()), label, threads=0)


def _timed(methods: Sequence[Method]) -> list[Method]:
    return [method for method in methods if not method.oracle]


def _check(plan: Plan, method: Method) -> Stage:
    """Return Table 2's measurement of a method, by which one that fails is found before all are timed together."""
    return measurement.stage(plan, method)


def _file(plan: Plan) -> str:
    return f"{plan.character}-seed{plan.config.seed}.csv"


def measure(context: StageContext) -> None:
    """Time the rigs and all methods. The rigs run on the CPU, even where JAX has a GPU."""
    import jax

    with jax.default_device(jax.devices("cpu")[0]):
        write_all(context.config.rigs, context.inputs, context.progress, context.out)


def read_rows(context: StageContext) -> None:
    """Copy one character's rows from the measurement."""
    copy_file(context.inputs["timing"] / context.config.file, context.out / FILE)


def run(options: argparse.Namespace) -> None:
    """Make the methods of every character, time all of them together, publish the rows and print them.

    Raises RunError for methods that failed, after it has published the other rows.
    """
    now = datetime.now(UTC).isoformat(timespec="seconds")

    def graphs(rigs: Sequence[tuple[Plan, Sequence[Method]]]) -> list[list[Stage]]:
        timing = timing_stage(rigs, now)
        return [stages(plan, chosen, timing) for plan, chosen in rigs]

    make_rows(options, graphs, publish)


def publish(results: Sequence[CharacterResult]) -> None:
    """Write Table 3 of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    If the folder had a Table 3 of the same characters, the change of the speed-ups is written and printed too.
    """
    folder = results_folder(results[0].config.profile)
    published = by_character(results)
    rows = publish_rows("table3", results, agreement_rows)
    for table in tables3(rows, read_results(PAPER / FILE)):
        print(as_text(table))
    if table := agreement_table(row for row in rows if row.character in published):
        print(as_text(table))
    print(f"written to {display_path(folder)}: {FILE}, manifest.json, and table3.ipynb to read them in")


# The committed Table 3 of a machine with a GPU, apart from that of the machine that texts quote.

GPU_TABLE = "table3_gpu"  # the table of the GPU machine's rows when they are looked up beside Table 3's


def gpu_machine_rows(results: str) -> list[Row]:
    """Return the committed rows of the machine with a GPU; none for a run of yours, whose own Table 3 has its GPU.

    results: "reference", or the profile of a run of yours.
    """
    return rows_if_there(paths.GPU_MACHINE, FILE) if results in paths.committed_folders() else []


def beside(rows: Iterable[Row]) -> list[Row]:
    """Return the rows of the machine with a GPU under the table `GPU_TABLE`, to look them up beside Table 3's."""
    return [replace(row, table=GPU_TABLE) for row in rows]
