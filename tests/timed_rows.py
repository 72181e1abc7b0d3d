"""Rows of Table 3 with round numbers."""

from replicate.report.results import Row

MS = {
    "rig_nodes": 60.0, "rig": 6.0, "coarse": 4.0, "coarse_plain": 8.0, "dense": 2.0, "dense_fast": 1.0,
    "dense_half": 0.5, "rigid_step": 0.25,
}  # fmt: skip
DIFFERENCES = {"_fast": 2e-4, "_half": 0.004}


def timed_rows(character="teen", p95=1.2):
    """Return rows as a run of Table 3 writes them, whose 95th percentiles are p95 times the medians."""

    def row(table, method, metric, unit, value, poses=1_000):
        return Row(table, character, method, metric, unit, value, None, 1, poses, "laptop", "r")

    made = [row("table3", "rig", "cores", "count", 2.0, None)]
    for name, ms in MS.items():
        for cores, share in (("all_cores", 1.0), ("one_core", 1.5)):
            kinds = {"time": ms, "median": ms, "p05": 0.9 * ms, "p95": p95 * ms}
            made += [row("table3", name, f"{kind}_{cores}", "ms", share * value) for kind, value in kinds.items()]
    made += [row("table3", f"dense{way}", "largest_difference", "mm", mm, 20) for way, mm in DIFFERENCES.items()]
    made += [row("table3", "coarse", "multiplications", "count", 5e7, None)]
    made += [row("table3", name, "model_size", "MB", 5.0, None) for name in ("coarse", "dense")]
    return [*made, *(row("table2", name, "normal_error_mean", "deg", 1.0) for name in ("coarse", "dense"))]
