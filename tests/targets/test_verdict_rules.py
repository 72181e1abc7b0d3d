"""Comparisons behind verdicts: what a spread and a tie decide, which margin counts, and how numbers are told."""

import pytest

from replicate.targets.claims.rules import Comparison, Number, decide, significant


@pytest.mark.parametrize(
    ("difference", "relation", "expected"),
    [
        (0.41, "smaller", True),
        (0.39, "smaller", False),
        (0.41, "at most", True),
        (0.39, "at most", False),
        (-0.39, "matches", True),
        (-0.41, "matches", False),
    ],
)
def test_with_several_seeds_a_difference_counts_beyond_twice_the_summed_spread(difference, relation, expected):
    left, right = Number("a", 1.0, 0.05), Number("b", 1.0 + difference, 0.15)
    comparison = Comparison("distance", "mm", left, right, relation)
    assert comparison.spread == pytest.approx(0.4) and comparison.satisfied is expected
    assert ("within the spread" in str(comparison)) == (abs(difference) < 0.4)


def test_numbers_of_the_same_seeds_are_compared_seed_by_seed():
    """All of them vary by ten times what they differ by."""
    low, high = {0: 1.0, 1: 1.1, 2: 0.9}, {0: 1.01, 1: 1.11, 2: 0.91}
    left, right = (
        Number(name, 1.0 + k / 100, 0.1, by_seed=seeds)
        for k, (name, seeds) in enumerate(zip("ab", (low, high), strict=True))
    )
    same = Comparison("distance", "mm", left, right)
    assert same.paired and same.spread == pytest.approx(0, abs=1e-12) and same.satisfied
    assert "in each seed by about as much (0.010 ± 0.0" in str(same) and "within" not in str(same)
    turned = Comparison("distance", "mm", left, Number("b", 1.01, 0.1, by_seed={0: 1.11, 1: 1.01, 2: 0.91}))
    assert turned.spread == pytest.approx(0.2) and not turned.satisfied and "within the spread" in str(turned)
    other = Comparison("distance", "mm", left, Number("b", 1.01, 0.1, by_seed={0: 1.01, 1: 1.11, 3: 0.91}))
    assert not other.paired and other.spread == pytest.approx(0.4) and not other.satisfied
    doubled = Comparison("distance", "mm", left.times(2, "2 a"), right.times(2, "2 b"))
    assert doubled.paired and doubled.satisfied and doubled.right.by_seed[1] == 2.22


@pytest.mark.parametrize(("relation", "expected"), [("smaller", False), ("at most", True), ("matches", True)])
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_tie_of_one_seed_is_not_smaller(relation, expected, value):
    assert Comparison("size", "MB", Number("a", value), Number("b", value), relation).satisfied is expected


def test_the_best_way_decides_and_in_it_the_smallest_margin():
    def comparison(left):
        return Comparison("distance", "mm", Number(f"{left}", left), Number("limit", 1.0))

    holds, way, deciding = decide([[comparison(0.1), comparison(1.1)], [comparison(0.8), comparison(0.9)]])
    assert holds and len(way) == 2 and deciding.left.value == 0.9
    holds, _, deciding = decide([[comparison(0.1), comparison(1.5)], [comparison(1.2)]])
    assert not holds and deciding.left.value == 1.2


def test_numbers_in_sentences_have_the_digits_that_tell_them_apart():
    assert str(Comparison("distance", "mm", Number("a", 0.33351), Number("b", 0.33352))).startswith(
        "distance: a 0.33351 mm < b 0.33352 mm"
    )
    assert [significant(value) for value in (0.0, 0.0760084, 0.9996, 12.345, 1234.5)] == [
        "0.00",
        "0.0760",
        "1.00",
        "12.3",
        "1,230",
    ]
