"""What the claims about the networks in use need of the numbers: speed (C7 to C9), posing (C10), other meshes (C13)."""

from collections.abc import Iterator

from replicate.report.cast import STANDS_FOR
from replicate.targets.claims.evidence import QUANTITIES, Evidence, MissingNumber
from replicate.targets.claims.verdict_rules import Comparison, Number, Ways, significant
from replicate.targets.table3.best_times import best_row
from replicate.targets.table3.gpu_machine import GPU_TABLE
from replicate.timing.timed_names import GPU

LEAST_SPEED_UP, MOST_SPEED_UP = 5, 17  # of the CNN over the rig, in the abstract


def _network_time(evidence: Evidence, character: str, method: str, table: str = "table3") -> Number:
    """Return milliseconds a pose: of the best evaluation of ours on all cores, or what the paper prints for its own."""
    if character in STANDS_FOR.values():
        return evidence.number("table3", character, method, "time_high_end_cpu")
    best = best_row(evidence.rows.values(), character, method, "all_cores", table)
    return evidence.number(table, character, best.method if best else method, "time_all_cores", method)


def _rig_times(evidence: Evidence, character: str) -> list[Number]:
    """Return the rig's milliseconds a pose, node by node and compiled; the paper has one number."""
    if character in STANDS_FOR.values():
        return [evidence.number("table3", character, "rig", "time_cpu_engine", "the rig")]
    names = {"rig_nodes": "the rig, node by node", "rig": "the rig, compiled"}
    return [evidence.number("table3", character, method, "time_all_cores", name) for method, name in names.items()]


def faster_than_the_rig(evidence: Evidence, character: str) -> Ways:
    """Return what C7 needs: the CNN is so many times as fast as both evaluations of the rig."""
    slow = _network_time(evidence, character, "refined").times(LEAST_SPEED_UP, f"{LEAST_SPEED_UP} × the CNN")
    return (tuple(Comparison("time", "ms", slow, rig, "at most") for rig in _rig_times(evidence, character)),)


def times_as_fast(evidence: Evidence, character: str) -> str:
    """Return how many times as fast as the rig the CNN is, by each evaluation of the rig."""
    cnn = _network_time(evidence, character, "refined")
    ratios = (
        f"{significant(rig.value / cnn.value)} times as fast as {rig.name}" for rig in _rig_times(evidence, character)
    )
    return f"The CNN is {' and '.join(ratios)}."


def dense_is_faster(evidence: Evidence, character: str) -> Ways:
    """Return what C8 needs: dense networks take less time than the coarse and the refined model."""
    pairs = (("dense", "coarse"), ("dense", "refined"))
    return (
        tuple(Comparison("time", "ms", *(_network_time(evidence, character, name) for name in pair)) for pair in pairs),
    )


def cpu_beats_gpu(evidence: Evidence, character: str) -> Ways:
    """Return what C9 needs: both take less time on a CPU. Raises MissingNumber where no GPU has run ours."""
    table, comparisons = _table_with_gpu(evidence, character), []
    for method in ("coarse", "refined"):
        graphics = _time_on_gpu(evidence, character, method, table)
        comparisons.append(Comparison("time", "ms", _time_on_cpu(evidence, character, method, table), graphics))
    return (tuple(comparisons),)


def started_one_by_one(evidence: Evidence, character: str) -> str:
    """Return what a GPU takes that is told each operation on its own, as the paper's was."""
    table = _table_with_gpu(evidence, character)
    one_by_one = evidence.number(table, character, f"refined{GPU}", "time_gpu")
    cpu = _time_on_cpu(evidence, character, "refined", table)
    recorded = _time_on_gpu(evidence, character, "refined", table)
    if recorded.value == one_by_one.value:
        return ""
    return (
        f"There the operations are recorded once and started as a whole. Started one by one they take "
        f"{significant(one_by_one.value)} ms for the refined model, {significant(one_by_one.value / cpu.value)} times "
        f"as long as on the CPU."
    )


def _table_with_gpu(evidence: Evidence, character: str) -> str:
    """Return the table with a character's times on a GPU: Table 3 where it has them, else that of another machine."""
    if character in STANDS_FOR.values():
        return "table3"
    for table in ("table3", GPU_TABLE):
        if best_row(evidence.rows.values(), character, "refined", "gpu", table):
            return table
    raise MissingNumber("Our approximations are not timed on a GPU.")


def _time_on_cpu(evidence: Evidence, character: str, method: str, table: str) -> Number:
    """Return milliseconds a pose on a CPU, on one core or on all: small networks may be quicker on one."""
    rows = [best_row(evidence.rows.values(), character, method, where, table) for where in ("one_core", "all_cores")]
    best = min((row for row in rows if row), key=lambda row: row.value, default=None)
    if best is None:
        return _network_time(evidence, character, method, table)
    return evidence.number(table, character, best.method, best.metric, method)


def _time_on_gpu(evidence: Evidence, character: str, method: str, table: str) -> Number:
    words = f"{method} on a GPU"
    if character in STANDS_FOR.values():
        return evidence.number(table, character, method, "time_high_end_gpu", words)
    best = best_row(evidence.rows.values(), character, method, "gpu", table)
    return evidence.number(table, character, best.method if best else method, "time_gpu", words)


def _posed(evidence: Evidence, character: str, suffix: str = "") -> Ways:
    comparisons = []
    for kind, (quantity, unit) in QUANTITIES.items():
        metric = f"{kind}_error_mean{suffix}"
        pair = (evidence.number("table4", character, name, metric) for name in ("refined", "dense"))
        comparisons.append(Comparison(quantity, unit, *pair))
    return (tuple(comparisons),)


def cnn_better_under_ik(evidence: Evidence, character: str) -> Ways:
    """Return what C10 needs: by the paper's protocol, both errors of the CNN are smaller than those of dense."""
    return _posed(evidence, character)


def posed_otherwise(evidence: Evidence, character: str) -> str:
    """Return how both compare in poses that favour neither, and at parameters within their controls' limits.

    What is as near to the rig without any network, a straight line or the unmoved face, is named first.
    """
    sentences = list(_nearer_without_networks(evidence, character))
    for suffix, words in (
        ("[rig]", "In poses of IK networks that are trained through the rig itself, which favour neither"),
        ("_limited", "With each parameter within the limits of its control"),
    ):
        try:
            (comparisons,) = _posed(evidence, character, suffix)
        except MissingNumber:
            continue
        sentences.append(f"{words}: {'; '.join(map(str, comparisons))}.")
    return " ".join(sentences)


def _nearer_without_networks(evidence: Evidence, character: str) -> Iterator[str]:
    """Yield a sentence for each way without networks that has a smaller normal error than the CNN in its poses."""
    for method, words in (("linear", "A straight line"), ("neutral", "Even the unmoved face")):
        try:
            pair = [evidence.number("table4", character, name, "normal_error_mean") for name in (method, "refined")]
        except MissingNumber:
            continue
        if pair[0].value < pair[1].value:
            own, of_cnn = (significant(number.value) for number in pair)
            yield f"{words} has a smaller normal error there: {own}° against {of_cnn}°."


def moves_other_meshes(evidence: Evidence, character: str) -> Ways:
    """Return what C13 needs: on new meshes both errors are smaller than those of deformation transfer."""
    comparisons = []
    for mesh, words in (("half", "on half of the vertices"), ("quarter", "on a quarter")):
        for kind, (quantity, unit) in QUANTITIES.items():
            read, followed = (
                evidence.number("figure13", character, method, f"{kind}_error_mean[{mesh}]", name)
                for method, name in (
                    ("coarse", f"{words}, maps read anew"),
                    ("deformation_transfer_coarse", "deformation transfer"),
                )
            )
            comparisons.append(Comparison(quantity, unit, read, followed))
    return (tuple(comparisons),)


def beside_other_ways(evidence: Evidence, character: str) -> str:
    """Return the errors of the prediction carried over, and of transfer from the truth, on half of the vertices."""
    carried, of_truth = (
        " mm and ".join(
            significant(evidence.number("figure13", character, method, f"{kind}_error_mean[half]").value)
            for kind in QUANTITIES
        )
        for method in ("coarse_carried", "deformation_transfer")
    )
    return (
        f"Carried from the original's vertices the same prediction has {carried}° on half of them. "
        f"Deformation transfer that sees the true mesh of each pose has {of_truth}°."
    )
