"""Effects: the ratio of two numbers, in the logarithm, with its 95 % interval."""

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

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

    borrowed: the spread from elsewhere, which takes the place of a spread of fewer than three runs
    """
    mean = statistics.fmean(logs)
    spread = own_spread(logs) if len(logs) > 2 or borrowed is None else borrowed
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
