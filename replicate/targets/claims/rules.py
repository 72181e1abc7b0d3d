"""How claims are judged: the evidence, and the rules that turn numbers into verdicts."""

import math
import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from data_recipes import recipe_paths
from replicate.base import paths
from replicate.benchmarks.common import PROFILE as BENCH
from replicate.config import RefinementConfig
from replicate.inverse.ik_stage import RIG as RIG_SOURCE
from replicate.report.manifest import command_of
from replicate.report.results import STANDS_FOR, Row, Seeds, joined, order_of, read_results, read_seeds, where
from replicate.targets.table2.rows import SEEDS as SINGLE_SEEDS
from replicate.targets.table3 import GPU_TABLE, beside, gpu_machine_rows
from replicate.targets.table3.rows import best_row
from replicate.targets.table4.rows import COMPARED, FRESH_ENDING, INTERVAL, OWN
from replicate.timing.single_poses import CHANGE, FAST, GPU, GRAPH, JAX, ONNX, RIG, THREADED, parted

# Effects: the ratio of two numbers, in the logarithm, with its 95 % interval.

TINY = 1e-12  # a smaller number counts as this, so that its logarithm is finite
TAIL = 0.975  # of Student's t: 2.5 % lie above


@dataclass(frozen=True)
class Spread:
    """The standard deviation of a single run's ln r, and the degrees of freedom that it is known with."""

    sd: float
    freedom: float


@dataclass(frozen=True)
class Effect:
    """A ratio r of two numbers.

    log: ln r
    half: half the width of the 95 % interval of ln r; 0 for exact numbers, infinite where no spread is known
    """

    log: float
    half: float = 0.0

    @property
    def ratio(self) -> float:
        """The ratio r."""
        return math.exp(self.log)

    @property
    def low(self) -> float:
        """The lower end of the interval of r; 0 where no spread is known."""
        return math.exp(self.log - self.half)

    @property
    def high(self) -> float:
        """The upper end of the interval of r; infinite where no spread is known."""
        return math.exp(self.log + self.half)


def log_ratio(left: float, right: float) -> float:
    """Return ln(left / right) of two numbers that are not negative; one next to nothing counts as `TINY`."""
    return math.log(max(left, TINY) / max(right, TINY))


def of_runs(logs: Sequence[float], borrowed: Spread | None = None) -> Effect:
    """Return the effect of ln r of one or more runs: their mean, with the interval of Student's t.

    borrowed: the spread from elsewhere, which takes the place of a spread of fewer than three runs; without one the
        interval has no end
    """
    mean = statistics.fmean(logs)
    spread = own_spread(logs) if len(logs) >= ENOUGH else borrowed
    return Effect(mean, half_width(spread.sd / math.sqrt(len(logs)), spread.freedom) if spread else math.inf)


def of_means(log: float, parts: Iterable[tuple[float, int]]) -> Effect:
    """Return the effect of two means that are known with their standard deviations alone, by Welch's rule.

    log: ln of their ratio
    parts: (standard deviation over the mean, number of runs), for each of the two
    """
    variances = [(share**2 / runs, runs) for share, runs in parts]
    variance = sum(each for each, _ in variances)
    if not variance:
        return Effect(log)
    freedom = variance**2 / sum(each**2 / (runs - 1) for each, runs in variances)
    return Effect(log, half_width(math.sqrt(variance), freedom))


def own_spread(logs: Sequence[float]) -> Spread | None:
    """Return the spread of ln r of several runs; None for one run."""
    return Spread(statistics.stdev(logs), len(logs) - 1) if len(logs) > 1 else None


def pooled(spreads: Iterable[Spread]) -> Spread | None:
    """Return what several spreads say together: variances are averaged by their degrees of freedom; None for none."""
    spreads = list(spreads)
    if not spreads:
        return None
    freedom = sum(spread.freedom for spread in spreads)
    return Spread(math.sqrt(sum(spread.freedom * spread.sd**2 for spread in spreads) / freedom), freedom)


def half_width(error: float, freedom: float) -> float:
    """Return half the width of the 95 % interval of Student's t. error: the standard error of what it is about."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, TAIL)) * error


# The numbers that a claim is about, and their comparisons.

UNITS = {"mm": " mm", "deg": "°", "MB": " MB", "ms": " ms", "ratio": "", "count": ""}
EXACT_UNITS = ("MB", "count")  # of numbers that come out the same in every run
PUBLISHED = "published"  # the profile of the paper's rows: it prints no spread, so they are taken as they are
ENOUGH = 3  # runs: fewer borrow the spread of other characters
LEAST_DIGITS, MOST_DIGITS = 3, 6  # significant ones in sentences: as many as tell two numbers apart


@dataclass(frozen=True)
class Number:
    """A number that a claim is about.

    name: whose it is, in words
    sd: its standard deviation over several seeds; None for one seed
    rows: the rows it is computed from; none for a constant
    by_seed: its value for each seed, where that is known
    again: of a time, its value over that of an earlier run; None where there was none
    """

    name: str
    value: float
    sd: float | None = None
    rows: tuple[Row, ...] = ()
    by_seed: dict[int, float] = field(default_factory=dict)
    again: float | None = None

    @property
    def is_exact(self) -> bool:
        """Whether the number has no spread: a constant, a size, or one that the paper prints."""
        return all(row.unit in EXACT_UNITS or row.profile == PUBLISHED for row in self.rows)

    @property
    def runs(self) -> int:
        """The number of runs behind it, one at least."""
        return min((row.seeds or 1 for row in self.rows), default=1)


@dataclass(frozen=True)
class Comparison:
    """A comparison of two numbers of the same unit that a claim needs to come out true.

    quantity: what both measure, in words
    unit: one of `UNITS`
    left: the number that the claim wants to be the smaller one
    right: the number that it is compared with
    where: in which of several places both are measured, such as a back end; "" where there is one
    """

    quantity: str
    unit: str
    left: Number
    right: Number
    where: str = ""

    @property
    def numbers(self) -> tuple[Number, Number]:
        """Both numbers, the one first that the claim wants to be smaller."""
        return self.left, self.right

    @property
    def is_exact(self) -> bool:
        """Whether neither number has a spread."""
        return all(number.is_exact for number in self.numbers)

    @property
    def runs(self) -> int:
        """The number of runs that both sides have; of exact numbers one."""
        return len(self.logs) or min((number.runs for number in self.numbers if not number.is_exact), default=1)

    @property
    def logs(self) -> list[float]:
        """The logarithm of the ratio in each seed that both sides have."""
        shared = [seed for seed in self.left.by_seed if seed in self.right.by_seed]
        return [log_ratio(self.left.by_seed[seed], self.right.by_seed[seed]) for seed in shared]

    @property
    def parts(self) -> list[tuple[float, int]]:
        """The share of each number that its standard deviation is, and its runs; a single run is left out."""
        known = (number for number in self.numbers if number.sd is not None and number.runs > 1)
        return [(number.sd / max(number.value, TINY), number.runs) for number in known]

    @property
    def spread(self) -> Spread | None:
        """What this comparison says about the spread of a single run's ln r; None for nothing."""
        if len(self.logs) >= ENOUGH:
            return own_spread(self.logs)
        if len(self.parts) == len(self.numbers) and min(runs for _, runs in self.parts) >= ENOUGH:
            return Spread(math.hypot(*(share for share, _ in self.parts)), min(runs for _, runs in self.parts) - 1)
        if self.left.again and self.right.again:
            return Spread(abs(log_ratio(self.left.again, self.right.again)) / math.sqrt(2), 1)
        return None

    def effect(self, borrowed: Spread | None = None) -> Effect:
        """Return the ratio of both numbers with its 95 % interval.

        borrowed: the spread of a single run's ln r on other characters, for a comparison of fewer than `ENOUGH` runs
        """
        log = log_ratio(self.left.value, self.right.value)
        if self.is_exact:
            return Effect(log)
        if len(self.logs) > 1:
            return of_runs(self.logs, borrowed)
        spreading = [number for number in self.numbers if not number.is_exact]
        if len(self.parts) == len(spreading) and self.runs >= ENOUGH:
            return of_means(log, self.parts)
        return of_runs(self.logs or [log], borrowed)

    @property
    def ratio(self) -> float:
        """`left` over `right`: below 1 is what the claim wants."""
        return math.exp(log_ratio(self.left.value, self.right.value))

    @property
    def key(self) -> str:
        """What is compared, in a few words, wherever it is."""
        return f"{self.quantity}: {self.left.name} < {self.right.name}"

    @property
    def name(self) -> str:
        """What is compared, in a few words."""
        return f"{self.key}, {self.where}" if self.where else self.key

    @property
    def profile(self) -> str:
        """The profiles of the rows, which a borrowed spread must share."""
        return ", ".join(sorted({row.profile for number in self.numbers for row in number.rows}))

    def __str__(self) -> str:
        """Return both numbers and which is larger, whatever the claim wants."""
        a, b = (
            f"{number.name} {text}{UNITS[self.unit]}" for number, text in zip(self.numbers, self._texts, strict=True)
        )
        sign = "=" if self.left.value == self.right.value else "<" if self.left.value < self.right.value else ">"
        return f"{self.quantity}{f' with {self.where}' if self.where else ''}: {a} {sign} {b}"

    @property
    def _texts(self) -> tuple[str, str]:
        for digits in range(LEAST_DIGITS, MOST_DIGITS + 1):
            texts = [significant(number.value, digits) for number in self.numbers]
            if texts[0] != texts[1]:
                break
        sds = ("" if number.sd is None else f" ± {significant(number.sd, 2)}" for number in self.numbers)
        first, second = (text + sd for text, sd in zip(texts, sds, strict=True))
        return first, second


Ways = tuple[tuple[Comparison, ...], ...]  # a claim holds if all comparisons of one way are as it says


def significant(value: float, digits: int = LEAST_DIGITS) -> str:
    """Write a number with the given count of significant digits, never with an exponent."""
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = int(f"{rounded:e}".partition("e")[2])
    return f"{rounded:,.{max(0, digits - 1 - exponent)}f}"


def difference(effect: Effect) -> str:
    """Return how much smaller or larger one number is than another, with its interval: "4.0 % ± 0.3 less"."""
    known = 0 < effect.half < math.inf
    if effect.ratio >= 2:
        ends = f" ({significant(effect.low, 2)}–{significant(effect.high, 2)})" if known else ""
        return f"{significant(effect.ratio, 2)} times as much{ends}"
    width = 50 * (effect.high - effect.low)
    spread = f" ± {significant(width, 2 if width >= 10 else 1)}" if known else ""
    return f"{significant(100 * abs(1 - effect.ratio), 2)} %{spread} {'less' if effect.log < 0 else 'more'}"


# From effects to a verdict. The weakest of several comparisons decides; of alternatives the best.

HOLDS, DIRECTION, ONE_RUN, UNDECIDED, FAILS = "holds", "direction only", "one run", "undecided", "fails"
MEASURED, NOT_TESTED = "measured", "not tested"
RANKS = (FAILS, UNDECIDED, ONE_RUN, DIRECTION, HOLDS)  # the weakest first
VERDICTS = (HOLDS, DIRECTION, ONE_RUN, UNDECIDED, FAILS, MEASURED, NOT_TESTED)
RULE = (
    "An effect is the ratio of the two numbers that a claim compares, the one on top that it wants to be smaller. Its "
    "95 % interval is that of Student's t for the logarithm over the seeds, seed by seed where both numbers have the "
    "same seeds. One or two runs borrow the spread that the same comparison has on characters of the same profile with "
    "three seeds or more, and times that of two runs of the timing; where nothing can be borrowed, there is an "
    "effect of one run and no verdict. Sizes and the paper's own numbers are taken as they are.",
    "An interval wholly above 1: the claim fails. One that includes 1: undecided. Wholly below 1: it holds if the "
    "effect is at least half of the paper's in the logarithm, else it has the direction only. The paper's effect is "
    "that of the character that ours stands for; where it has none in the claimed direction, the smallest of those "
    "that have. Where the claim itself names a size, that is asked for; where the paper prints no number, or says that "
    "something can happen, the direction is enough.",
    "Of several comparisons that a claim needs together the weakest decides; of alternatives, the best. Where the bar "
    "would be of our own making, the number is measured and there is no verdict.",
)
UNKNOWN_SPREAD = "one run or two, whose spread nothing tells"
BORROWED_SPREAD = "one run or two, with the spread of other characters"
SPREAD_OF_TIMES = "the spread is that between two runs of the timing"
HALF = 0.5  # of the paper's effect, in the logarithm: what an effect must reach to hold


@dataclass(frozen=True)
class Judged:
    """A comparison with its effect, the paper's effect (a ratio, None without one) and what follows."""

    comparison: Comparison
    effect: Effect
    paper: float | None
    verdict: str

    @property
    def caveat(self) -> str:
        """What a reader must know of the interval, "" for nothing."""
        if self.comparison.is_exact or self.comparison.runs >= ENOUGH:
            return ""
        if math.isinf(self.effect.half):
            return UNKNOWN_SPREAD
        if self.comparison.left.again:
            return SPREAD_OF_TIMES
        return BORROWED_SPREAD

    @property
    def rank(self) -> tuple[int, float]:
        """The place of the verdict in `RANKS`, then the larger of two effects."""
        return RANKS.index(self.verdict), -self.effect.log

    def __str__(self) -> str:
        """Return both numbers, how much they differ, and by how much they do in the paper."""
        ours = difference(self.effect) if self.effect.log else "the same"
        paper = "" if self.paper is None else f"; in the paper {difference(Effect(math.log(self.paper)))}"
        return f"{self.comparison} ({ours}{paper})"


def verdict_of(effect: Effect, least: float) -> str:
    """Return the verdict on one comparison. least: ln r that it must reach to hold, 0 if the direction is enough."""
    if math.isinf(effect.half):
        return ONE_RUN
    if abs(effect.log) <= effect.half:
        return UNDECIDED
    if effect.log > 0:
        return FAILS
    return HOLDS if effect.log <= least else DIRECTION


def decide(ways: Sequence[Sequence[Judged]]) -> tuple[str, Sequence[Judged], Judged]:
    """Return the verdict, the way in which a claim comes closest to holding, and that way's deciding comparison.

    ways: the alternatives, one at least; in each of them all comparisons must be as claimed
    """
    best = max(ways, key=lambda way: min(judged.rank for judged in way))
    deciding = min(best, key=lambda judged: judged.rank)
    return deciding.verdict, best, deciding


def decide_everywhere(way: Sequence[Judged]) -> tuple[str, Sequence[Judged], Judged]:
    """Return what `decide` does for comparisons in several places, which must agree in whom they favour."""
    places: dict[str, list[Judged]] = {}
    for judged in way:
        places.setdefault(judged.comparison.where, []).append(judged)
    deciding = [decide([each])[2] for each in places.values()]
    weakest, best = (choose(deciding, key=lambda judged: judged.rank) for choose in (min, max))
    agree = best.verdict == FAILS or RANKS.index(weakest.verdict) >= RANKS.index(DIRECTION)
    agree = agree or {judged.verdict for judged in deciding} == {ONE_RUN}
    return weakest.verdict if agree else UNDECIDED, deciding, weakest


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
NETWORKS = ("coarse", "refined", "dense")


@dataclass(frozen=True)
class Recipe:
    """A way to train the paper's networks.

    name: as in `claims.csv`
    suffix: what it adds to the names of `NETWORKS` in results
    words: what it is, for readers
    """

    name: str
    suffix: str
    words: str


BEST = Recipe("best", "", "by our recipe")
PRINTED = (
    Recipe("printed", "_printed", "as printed, controls as the rig has them, first weights of He et al."),
    Recipe("printed_ranges", "_printed_ranges", "as printed, controls in degrees and lengths like Ray's"),
    Recipe(
        "printed_code",
        "_printed_code",
        "as printed, controls in degrees and lengths like Ray's, first weights as in the released code",
    ),
    Recipe(
        "printed_unit",
        "_printed_unit",
        "as printed, controls in degrees and lengths like Ray's, offsets in the unit of its rig, 450 mm",
    ),
)
RECIPES = (BEST, *PRINTED)


class MissingNumber(LookupError):
    """A number that a claim needs is missing; the message names it and the command that makes it."""


class Evidence:
    """Rows of results, ours or the paper's, to look up numbers in, and the folder that each table comes from."""

    def __init__(
        self,
        rows: Iterable[Row],
        places: dict[tuple[str, str], str] | None = None,
        seeds: Seeds | None = None,
        recipe: Recipe = BEST,
    ):
        """Take rows, at most one for each number.

        places: (table, character) → a folder's name
        seeds: seed → its rows, of which some of `rows` are the means
        recipe: whose networks are meant where one of `NETWORKS` is asked for
        """
        self.rows = {row.key: row for row in rows}
        self.places = places or {}
        self.recipe = recipe
        self._spreads: dict[Callable, dict[tuple[str, str], Spread | None]] = {}
        self.by_seed: dict[tuple, dict[int, float]] = {}
        for seed, single in (seeds or {}).items():
            for row in single:
                self.by_seed.setdefault(row.key, {})[seed] = row.value

    def trained(self, recipe: Recipe) -> "Evidence":
        """Return the same evidence, with the networks of a recipe where one of `NETWORKS` is asked for."""
        other = Evidence(self.rows.values(), self.places, recipe=recipe)
        other.by_seed = self.by_seed
        return other

    def borrowed(self, ways: "Callable[[Evidence, str], Ways]", comparison: Comparison) -> Spread | None:
        """Return the spread of a comparison on all characters of its profile where it is known; None where on none.

        ways: the claim's comparisons for a character
        """
        if ways not in self._spreads:
            found: dict[tuple[str, str], list[Spread]] = {}
            for character in self.characters():
                with suppress(MissingNumber):
                    for each in {each.name: each for way in ways(self, character) for each in way}.values():
                        if spread := each.spread:
                            found.setdefault((each.name, each.profile), []).append(spread)
            self._spreads[ways] = {key: pooled(spreads) for key, spreads in found.items()}
        return self._spreads[ways].get((comparison.name, comparison.profile))

    def characters(self) -> list[str]:
        """Return the characters that stand for the paper's four and all others in Table 2, in the order of tables."""
        others = {row.character for row in self.rows.values() if row.table == "table2"}
        return sorted({*STANDS_FOR, *others}, key=order_of)

    def number(self, table: str, character: str, method: str, metric: str, name: str = "") -> Number:
        """Look up a number. Raises MissingNumber where there is no row.

        table, character, method, metric: the row's key
        name: what sentences call the number; by default the method's name
        """
        name = name or method.replace("lbs", "LBS ")
        method += self.recipe.suffix if method in NETWORKS else ""
        row = self.rows.get((table, character, method, metric))
        if row is None:
            target = "table2" if table == SEGMENTS else table
            which, whose = f"no {metric} of {method} for {character}", recipe_paths.in_command(character)
            raise MissingNumber(f"{target}.csv has {which}; `make {command_of(target)} CHARACTERS={whose}` writes it.")
        by_seed = self.by_seed.get(row.key, {})
        by_seed = by_seed if len(by_seed) == row.seeds else {}  # those of another run say nothing about this one
        again = self.rows.get((table, character, parted(method)[0], f"{CHANGE}{metric}[{RIG}]"))
        return Number(name, row.value, row.sd, (row,), by_seed, again and again.value)

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

BACK_ENDS = {"PyTorch": ("",), "compiled code": (FAST,), "JAX": (JAX,), "ONNX Runtime": (ONNX, *THREADED)}


def _network_time(evidence: Evidence, character: str, method: str, table: str = "table3") -> Number:
    """Return milliseconds a pose: our best evaluation on all cores, or what the paper prints for its characters."""
    if character in STANDS_FOR.values():
        return evidence.number("table3", character, method, "time_high_end_cpu")
    best = best_row(evidence.rows.values(), character, method, "all_cores", table)
    return evidence.number(table, character, best.method if best else method, "time_all_cores", method)


def _rig_times(evidence: Evidence, character: str) -> list[Number]:
    """Return the rig's milliseconds a pose, node by node and compiled; for the paper's characters its one number."""
    if character in STANDS_FOR.values():
        return [evidence.number("table3", character, "rig", "time_cpu_engine", "the rig, node by node")]
    names = {"rig_nodes": "the rig, node by node", "rig": "the rig, compiled"}
    return [evidence.number("table3", character, method, "time_all_cores", name) for method, name in names.items()]


def faster_than_the_rig(evidence: Evidence, character: str) -> Ways:
    """Return what C7 measures: the CNN's time beside the rig's, node by node as in the paper, then compiled."""
    cnn = replace(_network_time(evidence, character, "refined"), name="the CNN")
    return (tuple(Comparison("time", "ms", cnn, rig) for rig in _rig_times(evidence, character)),)


def times_as_fast(evidence: Evidence, character: str) -> str:
    """Return how many times as fast as each evaluation of the rig the CNN is, in a sentence."""
    cnn = _network_time(evidence, character, "refined")
    ratios = (
        f"{significant(rig.value / cnn.value)} times as fast as {rig.name}" for rig in _rig_times(evidence, character)
    )
    return f"The CNN is {' and '.join(ratios)}."


def dense_is_faster(evidence: Evidence, character: str) -> Ways:
    """Return what C8 needs with each back end: dense networks take less time than the coarse and the refined model.

    A back end that runs in several ways counts with each method's quickest one. The paper has one back end.
    """
    pairs = (("dense", "coarse"), ("dense", "refined"))
    if character in STANDS_FOR.values():
        return (
            tuple(Comparison("time", "ms", *(_network_time(evidence, character, m) for m in pair)) for pair in pairs),
        )
    comparisons = []
    for words, endings in BACK_ENDS.items():
        with suppress(MissingNumber):
            times = {name: _back_ends_time(evidence, character, name, endings) for name in NETWORKS}
            comparisons += [Comparison("time", "ms", *(times[name] for name in pair), words) for pair in pairs]
    if not comparisons:
        _network_time(evidence, character, "dense")  # says what is missing
        raise MissingNumber("No back end evaluates all three networks.")
    return (tuple(comparisons),)


def _back_ends_time(evidence: Evidence, character: str, method: str, endings: Sequence[str]) -> Number:
    rows = (evidence.rows.get(("table3", character, method + ending, "time_all_cores")) for ending in endings)
    best = min(filter(None, rows), key=lambda row: row.value, default=None)
    return evidence.number("table3", character, best.method if best else method + endings[0], "time_all_cores", method)


NO_GPU = "Our approximations are not timed on a GPU."


def cpu_beats_gpu(evidence: Evidence, character: str) -> Ways:
    """Return what C9 measures: the refined and the coarse model's time on a CPU beside that on a GPU.

    First come those whose GPU operations are started one by one, as in the paper. Raises MissingNumber where our
    networks were not timed on a GPU.
    """
    table, comparisons = _table_with_gpu(evidence, character), []
    published_one = character in STANDS_FOR.values()
    for ending, words in ((GPU, "operations started one by one"), (GRAPH, "operations started as a whole")):
        for method in ("refined", "coarse"):
            name = f"{method} on a GPU, {words}"
            key = (method, "time_high_end_gpu") if published_one else (f"{method}{ending}", "time_gpu")
            if (table, character, *key) in evidence.rows and not (published_one and ending == GRAPH):
                graphics = evidence.number(table, character, *key, name)
                comparisons.append(Comparison("time", "ms", _time_on_cpu(evidence, character, method, table), graphics))
    if not comparisons:
        raise MissingNumber(NO_GPU)
    return (tuple(comparisons),)


def on_the_papers_laptop(evidence: Evidence, character: str) -> str:
    """Return where the paper's own laptop has the refined model faster on its GPU, in a sentence, or ""."""
    film = stand_in(character)
    times = [published().number("table3", film, "refined", f"time_consumer_{where}").value for where in ("cpu", "gpu")]
    if times[0] <= times[1]:
        return ""
    cpu, gpu = map(significant, times)
    return f"On the paper's laptop {film}'s refined model is faster on the GPU: {cpu} ms on the CPU, {gpu} ms there."


def _table_with_gpu(evidence: Evidence, character: str) -> str:
    """Return the table with a character's times on a GPU: Table 3 where it has them, else the GPU machine's."""
    if character in STANDS_FOR.values():
        evidence.number("table3", character, "refined", "time_high_end_gpu")
        return "table3"
    for table in ("table3", GPU_TABLE):
        if best_row(evidence.rows.values(), character, "refined", "gpu", table):
            return table
    raise MissingNumber(NO_GPU)


def _time_on_cpu(evidence: Evidence, character: str, method: str, table: str) -> Number:
    """Return milliseconds a pose on a CPU, on one core or on all: small networks may be quicker on one."""
    rows = [best_row(evidence.rows.values(), character, method, where, table) for where in ("one_core", "all_cores")]
    best = min((row for row in rows if row), key=lambda row: row.value, default=None)
    name = f"{method} on a CPU"
    if best is None:
        return replace(_network_time(evidence, character, method, table), name=name)
    return evidence.number(table, character, best.method, best.metric, name)


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
    return " ".join([*sentences, *_in_fresh_drags(evidence, character)])


def _in_fresh_drags(evidence: Evidence, character: str) -> Iterator[str]:
    """Yield a sentence for each way to pose: the CNN's errors over those of dense in fresh drags, with intervals."""
    ways = {OWN: "each model's own", "refined": "the CNN's", RIG_SOURCE: "the rig's"}
    for way, whose in ways.items():
        ratios = []
        for kind, (quantity, _) in QUANTITIES.items():
            metric = f"{kind}_error_ratio{FRESH_ENDING}"
            with suppress(MissingNumber):
                value, low, high = (
                    evidence.number("table4", character, COMPARED[0], f"{metric}{ending}[{way}]").value
                    for ending in ("", *INTERVAL)
                )
                ratios.append(f"{quantity} × {value:.2f} ({low:.2f} to {high:.2f} over drags)")
        if ratios:
            listed = "; ".join(ratios)
            yield f"In fresh drags within limits, posed by {whose} IK networks, the CNN over dense: {listed}."


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


def grows_under_ik(evidence: Evidence, character: str) -> Ways:
    """Return what C14 measures: errors of the refined model under IK beside Table 2's, the one that grows more first.

    Raises MissingNumber for a character that doesn't stand for Ray, whose poses are those that the claim is about.
    """
    if stand_in(character) != "Ray":
        raise MissingNumber("The claim is about Ray, whose training poses are uniform draws.")
    comparisons = [_growth(evidence, character, "refined", kind, "") for kind in QUANTITIES]
    return (tuple(sorted(comparisons, key=lambda comparison: -comparison.ratio)),)


def other_growths(evidence: Evidence, character: str) -> str:
    """Return in words how errors of dense networks grow under IK, and those of both within the controls' limits."""

    def growths(method: str, limited: str) -> str:
        each = (_growth(evidence, character, method, kind, limited).ratio for kind in QUANTITIES)
        return " and ".join(significant(ratio, 2) for ratio in each)

    return (
        f"Dense networks have {growths('dense', '')} times as much in distance and normals. Within the controls' "
        f"limits the refined model has {growths('refined', '_limited')} times as much, dense networks "
        f"{growths('dense', '_limited')}."
    )


def _growth(evidence: Evidence, character: str, method: str, kind: str, limited: str) -> Comparison:
    """Compare a method's error in the poses of Table 4 with that in the poses of Table 2.

    limited: "_limited" for poses within the controls' limits, "" for those that IK networks give
    """
    quantity, unit = QUANTITIES[kind]
    posed = evidence.number("table4", character, method, f"{kind}_error_mean{limited}", f"{method} under IK")
    return Comparison(quantity, unit, posed, replace(evidence.error(character, method, kind), name="on test poses"))


def refined_everywhere(evidence: Evidence, character: str) -> Ways:
    """Return what C15 measures: the multiplications of the refined model beside those with squares on all charts."""
    counts = [evidence.number("table1", character, name, "segments") for name in ("coarse", "refined")]
    coarse, refined = (evidence.number("table3", character, name, "multiplications") for name in ("coarse", "refined"))
    charts, squares = (number.value for number in counts)
    each = (refined.value - coarse.value) / squares
    whole = coarse.value + each * charts / RefinementConfig().square ** 2
    everywhere = Number("squares on all charts", whole, rows=(*coarse.rows, *refined.rows))
    return ((Comparison("multiplications", "count", replace(refined, name="the refined model"), everywhere),),)


def moves_other_meshes(evidence: Evidence, character: str) -> Ways:
    """Return what C13 measures: errors of coarse networks on new meshes beside deformation transfer's, worst first."""
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
    return (tuple(sorted(comparisons, key=lambda comparison: -comparison.ratio)),)


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
