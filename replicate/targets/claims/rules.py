"""How claims are judged: the evidence, and the rules that turn numbers into verdicts."""

import math
import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
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

    name: whose it is, in words
    sd: its standard deviation over several seeds; None for one seed
    rows: the rows it is computed from
    by_seed: its value for each seed, where that is known
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
    """A comparison of two numbers of the same unit that a claim needs to come out true.

    quantity: what both measure, in words
    unit: one of `UNITS`
    left: the number that the claim wants to be the smaller one
    right: the number that it is compared with
    relation: "smaller" wants `left` below `right` by more than the spread; "at most" accepts equality too; "matches"
        accepts a `left` that is larger by no more than the spread
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
        """By how much the comparison is satisfied, in its unit; negative where it fails."""
        slack = -self.spread if self.relation == "matches" else self.spread
        return self.right.value - self.left.value - slack

    @property
    def margin(self) -> float:
        """`clearance` as a share of `right`; where `right` is 0, `clearance` itself."""
        return self.clearance / (abs(self.right.value) or 1.0)

    @property
    def satisfied(self) -> bool:
        """Whether the numbers compare as the claim says."""
        return self.clearance > 0 if self.relation == "smaller" else self.clearance >= 0

    @property
    def ratio(self) -> float:
        """`left` over `right`: below 1 is what the claim wants; infinite where `right` is 0."""
        return self.left.value / self.right.value if self.right.value else math.inf

    @property
    def name(self) -> str:
        """What is compared, in a few words."""
        return f"{self.quantity}: {self.left.name} {'<' if self.relation == 'smaller' else '≤'} {self.right.name}"

    def __str__(self) -> str:
        """Return both numbers and which is larger, whatever the claim wants."""
        a, b = (f"{number.name} {text}{UNITS[self.unit]}" for number, text in zip(self._pair, self._texts, strict=True))
        sign = "=" if self.left.value == self.right.value else "<" if self.left.value < self.right.value else ">"
        return f"{self.quantity}: {a} {sign} {b}{self._difference}"

    @property
    def _difference(self) -> str:
        """Return a remark on a difference that is small beside the spread over seeds; "" for a clear one.

        Paired seeds may show a difference that is smaller than the spreads of the two numbers: then the remark says so.
        """
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


Ways = tuple[tuple[Comparison, ...], ...]  # a claim holds if all comparisons of one way are satisfied


def significant(value: float, digits: int = LEAST_DIGITS) -> str:
    """Write a number with the given count of significant digits, never with an exponent."""
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = int(f"{rounded:e}".partition("e")[2])
    return f"{rounded:,.{max(0, digits - 1 - exponent)}f}"


def decide(ways: Sequence[Sequence[Comparison]]) -> tuple[bool, Sequence[Comparison], Comparison]:
    """Return whether a claim holds, the way in which it comes closest to holding, and that way's deciding comparison.

    ways: the alternatives, one at least; in each of them all comparisons must be satisfied. The deciding comparison is
    the one with the smallest margin.
    """
    best = max(ways, key=lambda way: (all(c.satisfied for c in way), min(c.margin for c in way)))
    deciding = min(best, key=lambda comparison: (comparison.satisfied, comparison.margin))
    return deciding.satisfied, best, deciding


# The rows that claims are judged by: the run's where it has them, else the committed ones.

TABLES = (
    "table1",
    "table2",
    "table3",
    "table4",
    "figure13",
    "bench_training",
    "bench_ladder",
)  # the files, without .csv
SEGMENTS = "table2_segments"  # a second table in table2.csv
QUANTITIES = {"vertex": ("distance", "mm"), "normal": ("normal error", "deg")}


class MissingNumber(LookupError):
    """A number that a claim needs is missing; the message names it and the command that makes it."""


class Evidence:
    """Rows of results, ours or the paper's, to look up numbers in, and the folder that each table comes from."""

    def __init__(
        self, rows: Iterable[Row], places: dict[tuple[str, str], str] | None = None, seeds: Seeds | None = None
    ):
        """Take rows, at most one for each number.

        places: (table, character) → a folder's name. seeds: seed → its rows, of which some of `rows` are the means.
        """
        self.rows = {row.key: row for row in rows}
        self.places = places or {}
        self.by_seed: dict[tuple, dict[int, float]] = {}
        for seed, single in (seeds or {}).items():
            for row in single:
                self.by_seed.setdefault(row.key, {})[seed] = row.value

    def characters(self) -> list[str]:
        """Return the characters that stand for the paper's four and all others in Table 2, in the order of tables."""
        others = {row.character for row in self.rows.values() if row.table == "table2"}
        return sorted({*STANDS_FOR, *others}, key=order_of)

    def number(self, table: str, character: str, method: str, metric: str, name: str = "") -> Number:
        """Look up a number. Raises MissingNumber where there is no row.

        table, character, method, metric: the row's key
        name: what sentences call the number; by default the method's name
        """
        row = self.rows.get((table, character, method, metric))
        if row is None:
            target = "table2" if table == SEGMENTS else table
            which, whose = f"no {metric} of {method} for {character}", recipe_paths.in_command(character)
            raise MissingNumber(f"{target}.csv has {which}; `make {command_of(target)} CHARACTERS={whose}` writes it.")
        by_seed = self.by_seed.get(row.key, {})
        by_seed = by_seed if len(by_seed) == row.seeds else {}  # those of another run say nothing about this one
        return Number(name or method.replace("lbs", "LBS "), row.value, row.sd, (row,), by_seed)

    def error(self, character: str, method: str, kind: str) -> Number:
        """Return a method's mean error over the test poses. kind: "vertex", in mm, or "normal", in degrees."""
        return self.number("table2", character, method, f"{kind}_error_mean")

    def place(self, rows: Iterable[Row]) -> str:
        """Return the names of the folders that the rows come from, with commas between them."""
        keys = {(row.table.replace(SEGMENTS, "table2"), row.character) for row in rows}
        return ", ".join(sorted({self.places[key] for key in keys if key in self.places}))


def folders_of(name: str) -> list[Path]:
    """Return the folders where evidence is looked for, in order. name: "reference", or the profile of a run."""
    if name == "reference":
        return [paths.REFERENCE]
    return [paths.run_folder(name), paths.run_folder(BENCH), paths.REFERENCE]


def gather(folders: Sequence[Path]) -> Evidence:
    """Collect, for each table and character, the rows of the first folder that has some, and each seed's where known.

    The committed results bring the times of the machine with a GPU along, as a separate table. Raises InputError for a
    file that is no table of results.
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


@cache
def published() -> Evidence:
    """Return the paper's own numbers, by the names of its characters; a process reads them once."""
    printed = ("table1", "table2", "table3", "table4")
    return Evidence(row for table in printed for row in read_results(paths.PAPER / f"{table}.csv"))


def stand_in(character: str) -> str:
    """Return the film character that a character, or the variant of one, stands for, or "" for none.

    The paper's characters stand for themselves.
    """
    name = character.partition("@")[0]
    return name if name in STANDS_FOR.values() else STANDS_FOR.get(name, "")


# The comparisons behind the claims about the networks in use: speed (C7 to C9), posing (C10), other meshes (C13).

LEAST_SPEED_UP, MOST_SPEED_UP = 5, 17  # of the CNN over the rig, in the abstract


def _network_time(evidence: Evidence, character: str, method: str, table: str = "table3") -> Number:
    """Return milliseconds a pose: our best evaluation on all cores, or what the paper prints for its characters."""
    if character in STANDS_FOR.values():
        return evidence.number("table3", character, method, "time_high_end_cpu")
    best = best_row(evidence.rows.values(), character, method, "all_cores", table)
    return evidence.number(table, character, best.method if best else method, "time_all_cores", method)


def _rig_times(evidence: Evidence, character: str) -> list[Number]:
    """Return the rig's milliseconds a pose, node by node and compiled; for the paper's characters its one number."""
    if character in STANDS_FOR.values():
        return [evidence.number("table3", character, "rig", "time_cpu_engine", "the rig")]
    names = {"rig_nodes": "the rig, node by node", "rig": "the rig, compiled"}
    return [evidence.number("table3", character, method, "time_all_cores", name) for method, name in names.items()]


def faster_than_the_rig(evidence: Evidence, character: str) -> Ways:
    """Return what C7 needs: the CNN is at least `LEAST_SPEED_UP` times as fast as either evaluation of the rig."""
    slow = _network_time(evidence, character, "refined").times(LEAST_SPEED_UP, f"{LEAST_SPEED_UP} × the CNN")
    return (tuple(Comparison("time", "ms", slow, rig, "at most") for rig in _rig_times(evidence, character)),)


def times_as_fast(evidence: Evidence, character: str) -> str:
    """Return how many times as fast as each evaluation of the rig the CNN is, in a sentence."""
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
    """Return what C9 needs: the coarse and the refined model take less time on a CPU than on a GPU.

    Raises MissingNumber where our networks were not timed on a GPU.
    """
    table, comparisons = _table_with_gpu(evidence, character), []
    for method in ("coarse", "refined"):
        graphics = _time_on_gpu(evidence, character, method, table)
        comparisons.append(Comparison("time", "ms", _time_on_cpu(evidence, character, method, table), graphics))
    return (tuple(comparisons),)


def started_one_by_one(evidence: Evidence, character: str) -> str:
    """Return how long a GPU takes when each operation is started on its own, as in the paper, in words."""
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
    """Return the table with a character's times on a GPU: Table 3 where it has them, else the GPU machine's."""
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
    """Return how the CNN and dense compare in poses that favour neither, and with parameters within their limits.

    If a straight line or the unmoved face has a smaller normal error than the CNN, that is said first.
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
    """Yield a sentence for the straight line and for the unmoved face if its normal error is below the CNN's."""
    for method, words in (("linear", "A straight line"), ("neutral", "Even the unmoved face")):
        try:
            pair = [evidence.number("table4", character, name, "normal_error_mean") for name in (method, "refined")]
        except MissingNumber:
            continue
        if pair[0].value < pair[1].value:
            without, of_cnn = (significant(number.value) for number in pair)
            yield f"{words} has a smaller normal error there: {without}° against {of_cnn}°."


def moves_other_meshes(evidence: Evidence, character: str) -> Ways:
    """Return what C13 needs: on new meshes both errors of the coarse networks are below deformation transfer's."""
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
    """Return two other errors on half of the vertices, in words.

    They are those of the original's prediction carried over to them, and of deformation transfer from the true mesh.
    """
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
