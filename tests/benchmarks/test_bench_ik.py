"""The times of inverse kinematics: what is timed, on models that are known, and the table."""

import os

import numpy as np

from replicate.benchmarks import bench_ik
from replicate.benchmarks.bench_ik import ik_table, timed
from replicate.report.results import Row


def test_every_way_gets_the_same_configurations_one_a_call():
    seen = {"a": [], "b": []}
    ways = {name: lambda points, own=calls: own.append(points.copy()) for name, calls in seen.items()}
    targets = np.arange(4 * 6, dtype=np.float32).reshape(4, 2, 3)
    times = timed(ways, targets, 3)
    assert {points.shape for calls in seen.values() for points in calls} == {(1, 2, 3)}
    np.testing.assert_array_equal(seen["a"], seen["b"])
    assert all(each.evaluations == 3 and each.p05 > 0 for each in times.values())


def test_jax_is_asked_for_one_thread_once_however_many_characters_there_are(monkeypatch):
    monkeypatch.setenv("NPROC", "4")
    for before, after in (("", []), ("--xla_a=1", ["--xla_a=1"])):
        monkeypatch.setenv("XLA_FLAGS", before)
        for _ in range(3):
            bench_ik.confine_jax()
        assert os.environ["XLA_FLAGS"].split() == [*after, "--xla_cpu_multi_thread_eigen=false"]
    assert os.environ["NPROC"] == "1"


def test_the_table_has_the_rig_first_and_a_line_a_method():
    def row(method, metric, unit, value):
        return Row(bench_ik.TABLE, "teen", method, metric, unit, value, None, 1, 5, "bench", "teen")

    rows = [row("dense", "ik_ms", "ms", 0.25), row("dense", "update_ms", "ms", 3.5), row("rig", "update_ms", "ms", 9.0)]
    rows += [row("dense", "solver_ms", "ms", 125.0), row("dense", "solver_over_networks", "ratio", 500.0)]
    table = ik_table(rows, "teen")
    assert [line[0] for line in table.body] == ["The rig, compiled", "Dense"]
    assert table.body[1][1] == "0.25" and "500" in table.body[1][4] and table.body[0][1] == "–"
