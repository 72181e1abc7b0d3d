"""When is one number smaller than another? The rule that all verdicts come from.

Numbers of one seed are compared as they are. Of several seeds the difference of the means decides only if it is larger
than twice its spread (`SPREADS`); a claim that needs a difference which isn't fails. Where a claim says that one number
*matches* another, a difference within that spread is a match.

Two methods of one seed are trained on the same samples and measured on the same poses, and the refined networks stand
on the coarse ones, so that their errors rise and fall together from seed to seed. The spread of a difference is
therefore the standard deviation of the seeds' differences. Where single seeds are not known it is the sum of both
standard deviations, which is at least as large.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from replicate.report.results import Row

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
