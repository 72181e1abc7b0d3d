"""How long inverse kinematics takes: one evaluation of the IK networks, a whole update while a point is dragged, and a
solver that does without networks.

`make bench-ik` trains methods, and the IK networks through each of them, where that is missing. An update is all that a
dragged point takes: IK networks, mesh with rigid segments, normals of all vertices. Rig and methods take turns on the
same configurations of control points, one a call, on one thread.
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
from replicate.benchmarks.common import (
    add_count,
    add_methods,
    answer,
    artefacts_of,
    bench_methods,
    bench_row,
    make_parser,
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
from replicate.methods.attachment import placing_attachments
from replicate.methods.method import Method
from replicate.methods.method_registry import choose, in_order, method_named
from replicate.methods.plan import Plan, reference
from replicate.report.results import Row, find
from replicate.report.tables import Table, our_value
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
    """Time the IK networks of one character, and return the rows."""
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
        of_method = {metric: by_method[method] for metric, by_method in times.items() if method in by_method}
        for metric, time in of_method.items():
            rows.append(bench_row(TABLE, plan.character, method, metric, "ms", time.median, time.evaluations))
        if "ik_ms" in of_method and "solver_ms" in of_method:
            ratio = of_method["solver_ms"].median / of_method["ik_ms"].median
            rows.append(bench_row(TABLE, plan.character, method, "solver_over_networks", "ratio", ratio, SOLVED))
    return rows


def confine_jax() -> None:
    """Have JAX, where it isn't loaded yet, work on one thread."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    os.environ["XLA_FLAGS"] = " ".join(flags if ONE_THREAD in flags else [*flags, ONE_THREAD])
    os.environ["NPROC"] = "1"  # the size of XLA's pool


def timed(ways: Mapping[str, Callable], targets: np.ndarray, rounds: int) -> dict[str, Times]:
    """Return the times of some ways by name, each call of which gets one configuration of control points."""
    with progress(rounds, "timing") as bar:
        return time_single_poses({name: Way(way) for name, way in ways.items()}, targets, rounds, bar.update)


def ways_of(
    methods: Sequence[Method], plan: Plan, inputs: Mapping[str, Path], rig: Rig
) -> tuple[dict[str, Callable], dict[str, Callable]]:
    """Return by method the IK networks, control points (1, c, 3) → parameters, and updates, → normals of a posed mesh.

    Updates have the rig too, posed by the networks of the first method.
    """
    faces, no_truth = rig.mesh.faces, np.zeros((1, 0, 3), np.float32)
    attachments = artefacts.load_attachments(inputs)
    networks: dict[str, Callable] = {m.name: ik_stage.load(inputs, m.name).solve for m in methods}

    def update(network: Callable, predict: Callable) -> Callable:
        return lambda points: fast_vertex_normals(predict(network(points))[0], faces)

    updates: dict[str, Callable] = {RIG: update(networks[methods[0].name], rig)}
    for method in methods:
        predict = fast_evaluation(method.model(inputs), rig.mesh, placing_attachments(method, attachments))
        if predict is None:
            slow = measurement.predictor(measurement.measurement_settings(method, plan.config), inputs)
            predict = partial(_without_truth, slow, no_truth)
        updates[method.name] = update(networks[method.name], predict)
    return networks, updates


def _without_truth(predict: Callable, no_truth: np.ndarray, params: np.ndarray) -> np.ndarray:
    return predict(params, no_truth)


def solvers_of(
    methods: Sequence[Method], inputs: Mapping[str, Path], rig: Rig, points: ControlPoints, section: InverseConfig
) -> dict[str, Callable]:
    """Return iterative solvers by method and for the rig itself: control points (1, c, 3) → parameters.

    methods, inputs: trained methods, and the folders of their artefacts.
    rig: the character's.
    points: the control points.
    section: the settings of inverse kinematics.
    """
    models = {RIG: ""} | {method.name: reference(method.model) for method in methods}
    facts = rig.default, rig.lower, rig.upper, parameter_ranges(rig), points.driven(), section.coordinates
    ways = {}
    for name, model in models.items():
        positions = ik_stage.positions(inputs, model, points.vertices)
        ways[name] = lambda target, positions=positions: solve(positions, target, *facts, section.regularisation)
    return ways


def ik_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's times, the rig first."""
    body = []
    for name in [RIG, *in_order({row.method for row in rows if row.character == character} - {RIG})]:
        label = "The rig, compiled" if name == RIG else method_named(name).label
        body.append((label, *(our_value(find(rows, TABLE, character, name, metric)) for metric, _ in COLUMNS)))
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
    timed_rows = partial(measure, rounds=options.rounds)
    bench_methods(TABLE, timed_rows, ik_table, options, command_line, rig_use="for vertices and derivatives")


if __name__ == "__main__":
    sys.exit(main())
