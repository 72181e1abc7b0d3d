"""Effects: intervals of Student's t for ratios, those of few runs with a spread from elsewhere, and pooled spreads."""

import math

import pytest

from replicate.targets.claims.rules import Effect, Spread, log_ratio, of_means, of_runs, own_spread, pooled


def test_three_runs_have_the_interval_of_students_t_with_two_degrees_of_freedom():
    effect = of_runs([-0.1, -0.2, -0.3])
    assert effect.log == pytest.approx(-0.2) and effect.half == pytest.approx(4.302653 * 0.1 / math.sqrt(3))
    assert effect.low == pytest.approx(math.exp(-0.2 - effect.half))
    assert effect.ratio**2 == pytest.approx(effect.low * effect.high), "it lies in the middle of the logarithms"


def test_fewer_than_three_runs_borrow_a_spread_and_more_do_not():
    elsewhere = Spread(0.05, 4)
    assert of_runs([-0.2], elsewhere).half == pytest.approx(2.776445 * 0.05)
    assert of_runs([-0.2, -0.3], elsewhere).half == pytest.approx(2.776445 * 0.05 / math.sqrt(2))
    assert of_runs([-0.1, -0.2, -0.3], elsewhere) == of_runs([-0.1, -0.2, -0.3])
    assert of_runs([-0.2, -0.3]).half == math.inf, "two runs alone decide nothing"


def test_a_single_run_with_nothing_to_borrow_knows_no_interval():
    alone = of_runs([-0.2])
    assert math.isinf(alone.half) and alone.low == 0 and math.isinf(alone.high)


def test_two_means_with_their_standard_deviations_are_combined_by_welchs_rule():
    effect = of_means(-0.1, [(0.03, 3), (0.04, 3)])
    variance = (0.0009 + 0.0016) / 3
    freedom = variance**2 / ((0.0003**2 + (0.0016 / 3) ** 2) / 2)
    assert 2 < freedom < 4
    assert 2.776 * math.sqrt(variance) < effect.half < 4.303 * math.sqrt(variance)
    assert of_means(-0.1, []) == Effect(-0.1), "two constants"


def test_pooled_spreads_weigh_by_degrees_of_freedom():
    assert pooled([]) is None and pooled([Spread(0.1, 2)]) == Spread(0.1, 2)
    both = pooled([Spread(0.1, 1), Spread(0.2, 3)])
    assert both.freedom == 4 and both.sd == pytest.approx(math.sqrt((0.01 + 3 * 0.04) / 4))
    assert own_spread([1.0]) is None and own_spread([1.0, 2.0, 3.0]) == Spread(1.0, 2)


def test_a_ratio_of_next_to_nothing_stays_finite():
    assert log_ratio(0.0, 0.0) == 0.0 and log_ratio(2.0, 1.0) == pytest.approx(math.log(2))
    assert math.isfinite(log_ratio(0.0, 1.0)) and log_ratio(1.0, 0.0) > 20
