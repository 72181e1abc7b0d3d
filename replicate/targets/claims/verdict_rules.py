"""When is one number smaller than another? The rule that all verdicts come from.

Numbers of one seed are compared as they are. Of several seeds the difference of the means decides only if it is larger
than twice the summed standard deviations (`SPREADS`); a claim that needs a difference which isn't fails. Where a claim
says that one number *matches* another, a difference within that spread is a match.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from replicate.report.results import Row

SPREADS = 2.0  # of the summed standard deviations: what a difference must exceed
UNITS = {"mm": " mm", "deg": "°", "MB": " MB", "ms": " ms"}
LEAST_DIGITS, MOST_DIGITS = 3, 6  # significant ones in sentences: as many as tell two numbers apart


@dataclass(frozen=True)
class Number:
    """A number that a claim is about.

    name: whose it is, in words. sd: its standard deviation over several seeds; None for one seed. rows: what it is
    computed from.
    """

    name: str
    value: float
    sd: float | None = None
    rows: tuple[Row, ...] = ()

    def times(self, factor: float, name: str) -> "Number":
        """Return a multiple of the number, under another name."""
        sd = None if self.sd is None else factor * self.sd
        return replace(self, name=name, value=factor * self.value, sd=sd)


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
    def spread(self) -> float:
        """What a difference must exceed: twice the summed standard deviations; 0 for one seed."""
        return SPREADS * ((self.left.sd or 0.0) + (self.right.sd or 0.0))

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
        within = 0 < self.spread >= abs(self.right.value - self.left.value)
        return f"{self.quantity}: {a} {sign} {b}" + (", a difference within the spread over seeds" if within else "")

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
