"""The rigs' benchmark: what its rows say that they stand on."""

import numpy as np
import pytest
from plain_rig import PlainRig

from replicate.benchmarks.bench_rig import BATCH, bench, rows, shares, tables, time_nodes


class Doubling(PlainRig):
    """A rig that does next to nothing, in two nodes."""

    def __call__(self, params):
        return 2 * params

    def node_steps(self, params):
        yield "first", params
        yield "second", params + np.zeros((4, *params.shape), np.float32).sum(0)

    def run_nodes(self, params):
        return params + params + np.float32(0.5)


@pytest.fixture(scope="module")
def measurement():
    return bench(Doubling(), np.ones((BATCH, 3), np.float32), 3)


def test_a_row_holds_the_number_of_poses_and_ratios_are_those_of_the_times(measurement):
    by_metric = {(row.method, row.metric): row for row in rows("teen", measurement)}
    for way, poses in {"batched": BATCH, "single": 4, "nodes": 4, "nodes_batched": BATCH}.items():
        assert by_metric[way, "time_per_pose"].poses == poses
    assert by_metric["single/batched", "time_ratio"].poses == 4
    single, batched = (by_metric[way, "time_per_pose"].value for way in ("single", "batched"))
    assert by_metric["single/batched", "time_ratio"].value == pytest.approx(single / batched)
    assert by_metric["batched", "time_for_50000_poses"].value == pytest.approx(50_000 * batched)
    difference = by_metric["nodes", "largest_difference"]
    assert (difference.value, difference.poses) == (0.5, 1)


def test_the_shares_of_the_nodes_are_those_of_their_times(measurement):
    by_metric = {(row.method, row.metric): row for row in rows("teen", measurement)}
    for way in ("nodes", "nodes_batched"):
        assert sum(shares(measurement, way).values()) == pytest.approx(1)
        first, second = (by_metric[way, f"time_per_pose[{name}]"].value for name in ("first", "second"))
        assert by_metric[way, "time_share[second]"].value == pytest.approx(second / (first + second))
        assert second > first


def test_each_node_gets_the_time_that_it_took():
    import time

    class Slow(PlainRig):
        def node_steps(self, params):
            yield "quick", None
            time.sleep(0.05)
            yield "slow", None

    seconds = {}
    time_nodes(Slow(), np.zeros((1, 3)), seconds)
    time_nodes(Slow(), np.zeros((1, 3)), seconds)
    assert seconds["slow"] >= 0.1 and seconds["slow"] > seconds["quick"]


def test_a_node_that_a_rig_lacks_has_no_numbers_of_it(measurement):
    fewer = [row for row in rows("teen@1", measurement) if "[second]" not in row.metric]
    _, nodes = tables([*rows("teen", measurement), *fewer], 3)
    second, first = nodes.body
    assert second[0] == "second" and second[5:] == ("–",) * 4 and "–" not in second[:5]
    assert "–" not in first and len(second) == len(first)


def test_the_printed_tables_have_every_character_and_every_node(measurement):
    speeds, nodes = tables([*rows("teen", measurement), *rows("woman", measurement)], 3)
    assert [line[0] for line in speeds.body] == ["teen", "woman"]
    assert [line[0] for line in nodes.body] == ["second", "first"]
    assert all(len(line) == len(nodes.headers[1]) == 1 + 2 * 4 for line in nodes.body)
    assert all(len(line) == len(speeds.headers[0]) for line in speeds.body)
