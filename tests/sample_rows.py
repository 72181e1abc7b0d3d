"""Results as runs write them, with numbers that are easy to recognise: for whatever prints, draws or publishes them."""

from replicate.base.paths import PAPER
from replicate.report.results import Row, read_results

METHODS = ("coarse", "refined", "dense", "lbs16", "lbs24", "lbs32", "driven", "floor", "floor_refined", "attachment",
           "neutral")  # fmt: skip
PAPER_ROWS = read_results(PAPER / "table2.csv")
CURVE = ((100.0, 3.5, 1.25, 4.5), (200.0, 1.0, 1 / 3, 2.0))


def table2_rows(characters=("teen",), methods=METHODS) -> list[Row]:
    """Return errors of some methods: the k-th has k times 0.11 mm and 1.2 degrees on average."""
    rows = []
    for character in characters:
        for k, method in enumerate(methods):
            for kind, unit, scale in (("vertex", "mm", 0.11), ("normal", "deg", 1.2)):
                for statistic, factor in (("mean", 1), ("p95", 4), ("max", 20)):
                    value, poses = (scale * (k + 1) * factor, 100 if method == "floor" else 1234)
                    metric = f"{kind}_error_{statistic}"
                    rows.append(Row("table2", character, method, metric, unit, value, None, 1, poses, "quick", "r"))
    return rows


def mean_rows(distance=(), normal=(), character="teen", sd=None) -> list[Row]:
    """Return mean errors. distance, normal: those of methods, by name; the others have 1 mm and 1 degree.

    sd: the spread over three seeds; None for one seed.
    """
    methods = ("coarse", "refined", "dense", "lbs16", "lbs24", "lbs32")
    facts = (sd, 1 if sd is None else 3, 9, "quick", "r")
    return [
        Row("table2", character, method, f"{kind}_error_mean", unit, dict(given).get(method, 1.0), *facts)
        for kind, unit, given in (("vertex", "mm", distance), ("normal", "deg", normal))
        for method in (*methods, *(["linear"] if "linear" in dict(given) else []))
    ]


def table1_rows(character: str = "teen", small: float = 8.0, large: float = 24.0) -> list[Row]:
    """Return counts and sizes. small, large: of the refined and of the dense model, MB."""
    values = {
        ("model", "vertices", "count"): 12510,
        ("refined", "segments", "count"): 3,
        ("model", "deformable_vertices", "count"): 11210,
        ("refined", "model_size", "MB"): small,
        ("refined", "model_size_least", "MB"): 7.0,
        ("refined", "model_size_most", "MB"): 11.0,
        ("dense", "model_size", "MB"): large,
        ("dense_released", "model_size", "MB"): 2 * large,
    }
    return [Row("table1", character, *key, float(value), None, 1, None, "quick", "r") for key, value in values.items()]


def rig_report_rows(character: str = "teen") -> list[Row]:
    """Return errors of fits, a count of components of two that were asked for, a share of pairs, and two map sizes."""
    values = {("maps", f"normal_error_mean[{size}]", "deg"): 64 / size for size in (16, 32)}
    for k, method in enumerate(("basis", "products", "squares", "linear", "neutral")):
        for statistic in ("mean", "p95", "max"):
            values[method, f"vertex_error_{statistic}", "mm"] = 0.2 * k
            values[method, f"normal_error_{statistic}", "deg"] = 0.7 * k
    values["basis", "components", "count"] = 512
    values["basis", "components[0.5 degrees]", "count"] = 154
    values["pairs", "interacting_share", "ratio"] = 0.25
    return [Row("rig_report", character, *key, float(v), None, 1, 99, "quick", "r") for key, v in values.items()]


def cells_after(text: str, start: str) -> list[str]:
    """Return the cells of a printed table's line that begins with some words."""
    return next(row for row in text.splitlines() if row.startswith(start))[len(start) :].split()


def roofline_rows() -> list[Row]:
    """Return rows of the roofline: a machine's peaks, and the teen's dense networks by two ways to evaluate them."""

    def row(method, metric, unit, value):
        return Row("bench_roofline", "teen", method, metric, unit, value, None, 1, 200, "bench", "teen")

    peaks = {"multiply_adds_per_s": 50e9, "bytes_per_s[cache]": 100e9, "bytes_per_s[memory]": 10e9}
    made = [row("machine", metric, "count", value) for metric, value in peaks.items()]
    for name, ms, count, megabytes in (("dense", 4.0, 1e7, 40.0), ("dense_fast", 1.0, 1e7, 40.0)):
        made += [
            row(name, "network", "ms", ms),
            row(name, "multiplications", "count", count),
            row(name, "read", "MB", megabytes),
            row(name, "share_of_peak", "ratio", 0.2 / ms),
            row(name, "share_of_roof", "ratio", 0.4 / ms),
            row(name, "times_as_fast_as_torch", "ratio", 4.0 / ms),
        ]
    return made
