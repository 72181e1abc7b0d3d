"""The rigs' benchmark: what its rows say that they stand on."""

import numpy as np
import pytest

from replicate.benchmarks.rig import BATCH, bench, rows


class Doubling:
    """A rig that does next to nothing."""

    def __call__(self, params):
        return 2 * params

    def run_nodes(self, params):
        return params + params + np.float32(0.5)


def test_a_row_holds_the_number_of_poses_and_ratios_are_those_of_the_times():
    found = bench(Doubling(), np.ones((BATCH, 3), np.float32), 3)
    listed = {(row.method, row.metric): row for row in rows("teen", found)}
    for way, poses in {"batched": 32, "single": 4, "nodes": 4, "nodes_batched": 32}.items():
        assert listed[way, "time_per_pose"].poses == poses
    assert listed["single/batched", "time_ratio"].poses == 4
    single, batched = (listed[way, "time_per_pose"].value for way in ("single", "batched"))
    assert listed["single/batched", "time_ratio"].value == pytest.approx(single / batched)
    difference = listed["nodes", "largest_difference"]
    assert (difference.value, difference.poses) == (0.5, 1)
