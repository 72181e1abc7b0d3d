"""How claims are judged: the evidence, and the rules that turn numbers into verdicts."""

import math
import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from data_recipes import recipe_paths
from replicate.base import paths
from replicate.benchmarks.common import PROFILE as BENCH
from replicate.report.manifest import command_of
from replicate.report.results import STANDS_FOR, Row, Seeds, joined, order_of, read_results, read_seeds, where
from replicate.targets.table2.rows import SEEDS as SINGLE_SEEDS
from replicate.targets.table3 import GPU_TABLE, beside, gpu_machine_rows
from replicate.targets.table3.rows import best_row
from replicate.timing.single_poses import GPU

SPREADS = 2.0  # standard deviations of a difference: what it must exceed
UNITS = {"mm": " mm", "deg": "°", "MB": " MB", "ms": " ms"}
LEAST_DIGITS, MOST_DIGITS = 3, 6  # significant ones in sentences: as many as tell two numbers apart


@dataclass(frozen=True)
class Number:
    """A number that a claim is about.

    name: whose it is, in words. sd: its standard deviation over several seeds; None for one seed. rows: what it is
    computed from. by_seed: its value for each seed, where that is known.
    """

    name: str
    value: float
    sd: float | None = None
    rows: tuple[Row, ...] = ()
    by_seed: dict[int, float] = field(default_factory=dict)

    def times(self, factor: float, name: str) -> "Number":
        """Return a multiple of the number, under another name."""
        sd = None if self.sd is None else factor * self.sd
        by_seed = {seed: factor * value for seed, value in self.by_seed.items()}
        return replace(self, name=name, value=factor * self.value, sd=sd, by_seed=by_seed)


@dataclass(frozen=True)
class Comparison:
    """What a claim needs of two numbers of the same unit, one of `UNITS`.

    quantity: what both measure, in words. relation: what `left` is to be: "smaller" than `right`; "at most" `right`,
    which differs for equal numbers alone; or such that it "matches" `right` or is smaller.
    """

    quantity: str
    unit: str
    left: Number
    right: Number
    relation: Literal["smaller", "at most", "matches"] = "smaller"

    @property
    def paired(self) -> bool:
        """Whether both numbers are known for each of the same several seeds."""
        return len(self.left.by_seed) > 1 and self.left.by_seed.keys() == self.right.by_seed.keys()

    @property
    def sd(self) -> float:
        """The standard deviation of the difference over the seeds; 0 for one seed."""
        if self.paired:
            return statistics.stdev(value - self.left.by_seed[seed] for seed, value in self.right.by_seed.items())
        return (self.left.sd or 0.0) + (self.right.sd or 0.0)

    @property
    def spread(self) -> float:
        """What a difference must exceed: twice its standard deviation over the seeds; 0 for one seed."""
        return SPREADS * self.sd

    @property
    def clearance(self) -> float:
        """By how much it is satisfied, in its unit; negative where it is not."""
        slack = -self.spread if self.relation == "matches" else self.spread
        return self.right.value - self.left.value - slack

    @property
    def margin(self) -> float:
        """Return `clearance` as a share of `right`; as it is where that is 0."""
        return self.clearance / (abs(self.right.value) or 1.0)

    @property
    def satisfied(self) -> bool:
        """Whether it is as the claim says."""
        return self.clearance > 0 if self.relation == "smaller" else self.clearance >= 0

    @property
    def ratio(self) -> float:
        """Return `left` over `right`, below 1 where the claim wants it; infinite over 0."""
        return self.left.value / self.right.value if self.right.value else math.inf

    @property
    def name(self) -> str:
        """What is compared, in a few words."""
        return f"{self.quantity}: {self.left.name} {'<' if self.relation == 'smaller' else '≤'} {self.right.name}"

    def __str__(self) -> str:
        """Return both numbers and how they compare, whether that is what the claim needs or not."""
        a, b = (f"{number.name} {text}{UNITS[self.unit]}" for number, text in zip(self._pair, self._texts, strict=True))
        sign = "=" if self.left.value == self.right.value else "<" if self.left.value < self.right.value else ">"
        return f"{self.quantity}: {a} {sign} {b}{self._difference}"

    @property
    def _difference(self) -> str:
        """Return what is to be said of a difference that two spreads hide, or that its own does."""
        size = abs(self.right.value - self.left.value)
        within = 0 < self.spread >= size
        hidden = self.paired and SPREADS * ((self.left.sd or 0.0) + (self.right.sd or 0.0)) >= size
        words = ", a difference within the spread over seeds" if within else ""
        if hidden:
            of_it = f"{significant(size, 2)} ± {significant(self.sd, 2)}{UNITS[self.unit]}"
            words += f" ({of_it})" if within else f", in each seed by about as much ({of_it})"
        return words

    @property
    def _pair(self) -> tuple[Number, Number]:
        return self.left, self.right

    @property
    def _texts(self) -> tuple[str, str]:
        for digits in range(LEAST_DIGITS, MOST_DIGITS + 1):
            texts = [significant(number.value, digits) for number in self._pair]
            if texts[0] != texts[1]:
                break
        sds = ("" if number.sd is None else f" ± {significant(number.sd, 2)}" for number in self._pair)
        first, second = (text + sd for text, sd in zip(texts, sds, strict=True))
        return first, second


Ways = tuple[tuple[Comparison, ...], ...]  # a claim holds if all comparisons of one of them are satisfied


def significant(value: float, digits: int = LEAST_DIGITS) -> str:
    """Return a number with so many significant digits, never with an exponent."""
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = int(f"{rounded:e}".partition("e")[2])
    return f"{rounded:,.{max(0, digits - 1 - exponent)}f}"


def decide(ways: Sequence[Sequence[Comparison]]) -> tuple[bool, Sequence[Comparison], Comparison]:
    """Return whether a claim holds, the best of its ways, and the comparison of that with the smallest margin.

    ways: in how many ways the claim can hold, one at least; in each of them all comparisons must be satisfied.
    """
    best = max(ways, key=lambda way: (all(c.satisfied for c in way), min(c.margin for c in way)))
    deciding = min(best, key=lambda comparison: (comparison.satisfied, comparison.margin))
    return deciding.satisfied, best, deciding


# The rows that claims are judged by: of a run where it has them, else of the committed results.

TABLES = (
    "table1",
    "table2",
    "table3",
    "table4",
    "figure13",
    "bench_training",
    "bench_ladder",
)  # the files, without .csv
SEGMENTS = "table2_segments"  # a table of its own in table2.csv
QUANTITIES = {"vertex": ("distance", "mm"), "normal": ("normal error", "deg")}


class MissingNumber(LookupError):
    """There is no row of a number that a claim needs; the message is a sentence that names it and what makes it."""


class Evidence:
    """The rows of some characters, ours or the paper's, to be looked up, and the folder that each table is from."""

    def __init__(
        self, rows: Iterable[Row], places: dict[tuple[str, str], str] | None = None, seeds: Seeds | None = None
    ):
        """Take rows, of which no two are of the same number.

        places: (table, character) → a folder's name. seeds: seed → the rows that some of these are the means of.
        """
        self.rows = {row.key: row for row in rows}
        self.places = places or {}
        self.by_seed: dict[tuple, dict[int, float]] = {}
        for seed, single in (seeds or {}).items():
            for row in single:
                self.by_seed.setdefault(row.key, {})[seed] = row.value

    def characters(self) -> list[str]:
        """Return those that stand for the paper's four, and the others that Table 2 has, in the order of tables."""
        others = {row.character for row in self.rows.values() if row.table == "table2"}
        return sorted({*STANDS_FOR, *others}, key=order_of)

    def number(self, table: str, character: str, method: str, metric: str, name: str = "") -> Number:
        """Return a number; name: what sentences call it, else as the method. Raises MissingNumber without a row."""
        row = self.rows.get((table, character, method, metric))
        if row is None:
            target = "table2" if table == SEGMENTS else table
            which, whose = f"no {metric} of {method} for {character}", character
            if is_from_elsewhere(character):
                whose = f"<recipe or folder of {character}>"
            raise MissingNumber(f"{target}.csv has {which}; `make {command_of(target)} CHARACTERS={whose}` writes it.")
        by_seed = self.by_seed.get(row.key, {})
        by_seed = by_seed if len(by_seed) == row.seeds else {}  # those of another run say nothing about this one
        return Number(name or method.replace("lbs", "LBS "), row.value, row.sd, (row,), by_seed)

    def error(self, character: str, method: str, kind: str) -> Number:
        """Return a method's mean error over the test poses. kind: "vertex", in mm, or "normal", in degrees."""
        return self.number("table2", character, method, f"{kind}_error_mean")

    def place(self, rows: Iterable[Row]) -> str:
        """Return the names of the folders that some rows are from."""
        keys = {(row.table.replace(SEGMENTS, "table2"), row.character) for row in rows}
        return ", ".join(sorted({self.places[key] for key in keys if key in self.places}))


def is_from_elsewhere(character: str) -> bool:
    """Return whether a character of some results has no recipe here: it is named by its folder, not by this name."""
    name, _ = recipe_paths.split_character(character)
    return name not in STANDS_FOR and not recipe_paths.recipe_file(name).is_file()


def folders_of(name: str) -> list[Path]:
    """Return where evidence of some results is looked for, in order. name: "reference", or the profile of a run."""
    if name == "reference":
        return [paths.REFERENCE]
    return [paths.run_folder(name), paths.run_folder(BENCH), paths.REFERENCE]


def gather(folders: Sequence[Path]) -> Evidence:
    """Return, for each table and character, the rows of the first folder that has some, and each seed's where known.

    With the committed results come the times by the machine with a GPU, as a table of their own. Raises InputError for
    a file that is no table of results.
    """
    rows: list[Row] = []
    places: dict[tuple[str, str], str] = {}
    seeds: dict[int, list[Row]] = {}
    for table in TABLES:
        for folder in folders:
            file = folder / f"{table}.csv"
            new = read_results(file) if file.is_file() else []
            new = [row for row in new if (table, row.character) not in places]
            characters = dict.fromkeys(row.character for row in new)  # in their order, so that pages repeat exactly
            rows += new
            places |= {(table, character): folder.name for character in characters}
            single = folder / SINGLE_SEEDS
            if table == "table2" and characters and single.is_file():
                seeds = joined(seeds, where(read_seeds(single), characters.__contains__))
    if paths.REFERENCE in folders:
        on_gpu = beside(gpu_machine_rows("reference"))
        rows += on_gpu
        places |= {(GPU_TABLE, row.character): paths.GPU_MACHINE for row in on_gpu}
    return Evidence(rows, places, seeds)


def published() -> Evidence:
    """Return the paper's own numbers, by the names of its characters."""
    printed = ("table1", "table2", "table3", "table4")
    return Evidence(row for table in printed for row in read_results(paths.PAPER / f"{table}.csv"))


def stand_in(character: str) -> str:
    """Return the film character that one stands for, variants too, or "" for none; the paper's stand for themselves."""
    name = character.partition("@")[0]
    return name if name in STANDS_FOR.values() else STANDS_FOR.get(name, "")


# What the claims about the networks in use need of the numbers: speed (C7 to C9), posing (C10), other meshes (C13).

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
