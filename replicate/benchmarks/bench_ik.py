"""How long inverse kinematics takes: one evaluation of the IK networks, a whole update while a point is dragged, and a
solver that does without networks.

`make bench-ik` makes what is missing of the methods and of the IK networks that are trained through each. An update is
what a dragged point costs: IK networks, mesh with rigid segments, normals of all vertices. Rig and methods take turns
on the same configurations of control points, one a call, on one thread.
"""

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from data_recipes.rig import Rig
from replicate.base.progress import progress
from replicate.benchmarks.common import (  # fmt: skip
    PROFILE,
    add_count,
    add_methods,
    answer,
    artefacts_of,
    bench_methods,
    make_parser,
    placing_attachments,
)
from replicate.config import Config
from replicate.inference.fast_evaluation import fast_evaluation
from replicate.inference.vertex_normals import fast_vertex_normals
from replicate.inverse import ik_stage
from replicate.inverse.configurations import configurations
from replicate.inverse.control_points import ControlPoints, InverseConfig, control_points
from replicate.inverse.ik_network import parameter_ranges
from replicate.inverse.solver import solve
from replicate.methods import artefacts, measurement
from replicate.methods.method import Method
from replicate.methods.method_registry import choose, in_order, method_named
from replicate.methods.plan import Plan, reference
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off
from replicate.timing.single_poses import Times, Way, time_single_poses

ABOUT = "milliseconds of inverse kinematics: the networks, a whole update while dragging, and a solver"
WRITES = "results/runs/bench/bench_ik.csv"
TABLE = "bench_ik"
RIG = "rig"
ROUNDS = 50
ONE_THREAD = "--xla_cpu_multi_thread_eigen=false"
SOLVED = 5  # configurations that the solver is timed on
COLUMNS = (
    ("ik_ms", "IK networks, ms"),
    ("update_ms", "update, ms"),
    ("solver_ms", "solver, ms"),
    ("solver_over_networks", "solver over networks"),
)


def measure(config: Config, words: Sequence[str], rounds: int) -> list[Row]:
    """Make what is missing of one character's IK networks, time them, and return the rows."""
    confine_jax()
    plan = Plan(config)
    methods = [method for method in choose(words, config) if method.model and not method.oracle]
    stages = [measurement.stage(plan, method) for method in methods]
    stages += [ik_stage.stage(plan, method) for method in methods]
    inputs = artefacts_of(TABLE, config, stages)
    rig = artefacts.load_rig(inputs)
    points = control_points(rig, artefacts.load_influence(inputs))
    targets = configurations(rig, points, stream=TABLE, count=rounds)
    with threadpool_limits(1):
        networks, updates = ways_of(methods, plan, inputs, rig)
        times = {"ik_ms": timed(networks, targets, rounds), "update_ms": timed(updates, targets, rounds)}
        solvers = solvers_of(methods, inputs, rig, points, ik_stage.section(plan))
        times["solver_ms"] = timed(solvers, targets[:SOLVED], min(SOLVED, rounds))
    rows = []
    for method in updates:
        medians = {metric: each[method].median for metric, each in times.items() if method in each}
        numbers = [(metric, "ms", value) for metric, value in medians.items()]
        if "ik_ms" in medians and "solver_ms" in medians:
            numbers.append(("solver_over_networks", "ratio", medians["solver_ms"] / medians["ik_ms"]))
        for metric, unit, value in numbers:
            count = times[metric][method].evaluations if metric in times else SOLVED
            facts = (value, None, 1, count, PROFILE, plan.character)
            rows.append(Row(TABLE, plan.character, method, metric, unit, *facts))
    return rows


def confine_jax() -> None:
    """Have JAX, where it isn't loaded yet, work on one thread."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    os.environ["XLA_FLAGS"] = " ".join(flags if ONE_THREAD in flags else [*flags, ONE_THREAD])
    os.environ["NPROC"] = "1"  # the size of XLA's pool


def timed(ways: Mapping[str, Callable], targets: np.ndarray, rounds: int) -> dict[str, Times]:
    """Return the times of some ways, by name, one configuration of control points a call."""
    with progress(rounds, "timing") as bar:
        return time_single_poses({name: Way(way) for name, way in ways.items()}, targets, rounds, bar.update)


def ways_of(
    methods: Sequence[Method], plan: Plan, inputs: Mapping[str, Path], rig: Rig
) -> tuple[dict[str, Callable], dict[str, Callable]]:
    """Return by method (control points (1, c, 3) → parameters) and (the same → mesh and normals), the rig's last too.

    The rig's update takes the networks of the first method.
    """
    faces, nothing = rig.mesh.faces, np.zeros((1, 0, 3), np.float32)
    attachments = artefacts.load_attachments(inputs)
    networks: dict[str, Callable] = {m.name: ik_stage.load(inputs, m.name).solve for m in methods}

    def update(network: Callable, predict: Callable) -> Callable:
        return lambda points: fast_vertex_normals(predict(network(points))[0], faces)

    updates: dict[str, Callable] = {RIG: update(networks[methods[0].name], rig)}
    for method in methods:
        predict = fast_evaluation(method.model(inputs), rig.mesh, placing_attachments(method, attachments))
        if predict is None:
            slow = measurement.predictor(measurement.numbers_of(method, plan.config), inputs)
            predict = lambda params, own=slow: own(params, nothing)  # noqa: E731
        updates[method.name] = update(networks[method.name], predict)
    return networks, updates


def solvers_of(
    methods: Sequence[Method], inputs: Mapping[str, Path], rig: Rig, points: ControlPoints, section: InverseConfig
) -> dict[str, Callable]:
    """Return by method, and for the rig itself, (control points (1, c, 3) → parameters) by iteration."""
    models = {RIG: ""} | {method.name: reference(method.model) for method in methods}
    facts = rig.default, rig.lower, rig.upper, parameter_ranges(rig), points.driven(), section.coordinates
    ways = {}
    for name, model in models.items():
        positions = ik_stage.positions(inputs, model, points.vertices)
        ways[name] = lambda target, own=positions: solve(own, target, *facts, section.regularisation)
    return ways


def ik_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's times, the rig first."""
    own = [row for row in rows if row.character == character]
    body = []
    for name in [RIG, *in_order({row.method for row in own} - {RIG})]:
        cells = [find(own, TABLE, character, name, metric) for metric, _ in COLUMNS]
        label = "The rig, compiled" if name == RIG else method_named(name).label
        body.append((label, *(round_off(cell.value, cell.unit) if cell else "–" for cell in cells)))
    notes = (
        "One configuration of control points a call, on one thread; medians over turns.",
        "An update is what a dragged point costs: IK networks, mesh with rigid segments, by the fast evaluation "
        "where there is one, and normals of all vertices, compiled.",
        "The solver minimises Eq. 8 for each configuration anew (L-BFGS), through the method or the rig itself.",
    )
    return Table(f"Inverse kinematics: {character}", (("", *(words for _, words in COLUMNS)),), tuple(body), notes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time inverse kinematics.", profile="whose trainings are timed")
    add_methods(parser, "table4")
    add_count(parser, "rounds", ROUNDS, "configurations that each is timed on")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    own = partial(measure, rounds=options.rounds)
    bench_methods(TABLE, own, ik_table, options, command_line, "for vertices and derivatives")


if __name__ == "__main__":
    sys.exit(main())
