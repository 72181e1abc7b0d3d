"""Comparisons behind verdicts: where their spread comes from, what their effect decides, and how numbers are told."""

import math
from dataclasses import replace

import pytest

from replicate.report.results import Row
from replicate.targets.claims.rules import (
    Comparison,
    Effect,
    Evidence,
    Judged,
    Number,
    decide,
    decide_everywhere,
    difference,
    significant,
    verdict_of,
)

HALF_OF_PAPER = 0.5 * math.log(0.8)  # where the paper takes off 20 %


def number(name: str, value: float, sd: float | None = None, seeds: int = 1, by_seed=None, **fields) -> Number:
    row = Row("table2", "teen", name, "m", "deg", value, sd, seeds, 9, "laptop", "r")
    return Number(name, value, sd, (replace(row, **fields),), by_seed or {})


@pytest.mark.parametrize(
    ("log", "half", "expected"),
    [
        (-0.12, 0.1, "holds"),
        (-0.12, 0.13, "undecided"),
        (-0.12, 0.12, "undecided"),
        (-0.11, 0.1, "direction only"),
        (-0.11, 0.0, "direction only"),
        (0.11, 0.1, "fails"),
        (0.11, 0.12, "undecided"),
        (0.0, 0.0, "undecided"),
        (-9.0, math.inf, "one run"),
        (9.0, math.inf, "one run"),
    ],
)
def test_an_interval_and_half_of_the_papers_effect_decide(log, half, expected):
    assert verdict_of(Effect(log, half), HALF_OF_PAPER) == expected


def test_the_direction_is_enough_where_no_size_is_asked_for():
    assert verdict_of(Effect(-0.01, 0.005), 0.0) == "holds" and verdict_of(Effect(0.01, 0.005), 0.0) == "fails"


def test_numbers_of_the_same_seeds_are_compared_seed_by_seed():
    """All of them vary by ten times what they differ by."""
    low, high = {0: 1.0, 1: 1.1, 2: 0.9}, {0: 1.01, 1: 1.11, 2: 0.91}
    left, right = number("a", 1.0, 0.1, 3, low), number("b", 1.01, 0.1, 3, high)
    same = Comparison("distance", "mm", left, right).effect()
    assert same.log < 0 and same.half < 0.004
    turned = Comparison("distance", "mm", left, number("b", 1.01, 0.1, 3, {0: 1.11, 1: 1.01, 2: 0.91})).effect()
    assert turned.half > 0.1
    apart = Comparison("distance", "mm", left, number("b", 1.01, 0.1, 3)).effect()
    assert apart.half > 0.2 and verdict_of(apart, 0.0) == "undecided", "unpaired, the spreads of both count"
    two = Comparison("distance", "mm", left, number("b", 1.01, 0.1, 3, {0: 1.01, 1: 1.11, 3: 0.91}))
    assert len(two.logs) == two.runs == 2, "only seeds that both have are pairs"


def test_a_size_a_constant_and_what_the_paper_prints_have_no_spread():
    for left, right in (
        (number("a", 1.0, unit="MB"), number("b", 2.0, unit="MB")),
        (number("a", 1.0, profile="published"), number("b", 2.0, profile="published")),
    ):
        effect = Comparison("size", "MB", left, right).effect()
        assert effect.log == pytest.approx(-math.log(2)) and effect.half == 0
    beside = Comparison("distance", "mm", number("a", 1.0, 0.01, 3), Number("τ", 2.0)).effect()
    assert 0 < beside.half < 0.1


def test_a_single_run_borrows_the_spread_of_other_characters_of_its_profile():
    def rows(character, seeds, profile="laptop"):
        facts = seeds, 9, profile, "r"
        return [
            Row("table2", character, name, "normal_error_mean", "deg", value, 0.01 if seeds > 1 else None, *facts)
            for name, value in (("refined", 1.0), ("coarse", 2.0))
        ]

    def ways(evidence, character):
        return ((Comparison("e", "deg", *(evidence.error(character, m, "normal") for m in ("refined", "coarse"))),),)

    def effect(rows):
        evidence = Evidence(rows)
        ((comparison,),) = ways(evidence, "teen")
        return comparison.effect(evidence.borrowed(ways, comparison))

    spread = math.hypot(0.01, 0.005)
    assert math.isinf(effect(rows("teen", 1)).half)
    assert effect(rows("teen", 1) + rows("woman", 3)).half == pytest.approx(4.302653 * spread)
    assert effect(rows("teen", 1) + rows("woman", 3) + rows("toon", 3)).half == pytest.approx(2.776445 * spread)
    assert math.isinf(effect(rows("teen", 1) + rows("woman", 3, "quick")).half), "another training, another spread"
    assert math.isinf(effect(rows("teen", 1) + rows("woman", 2)).half), "two seeds are no spread to lend"


def test_times_have_the_spread_of_two_runs():
    fast, slow = number("a", 1.0), number("b", 2.0)
    times = Comparison("time", "ms", replace(fast, again=1.1), replace(slow, again=1.0))
    assert times.spread.freedom == 1 and times.spread.sd == pytest.approx(math.log(1.1) / math.sqrt(2))
    assert Comparison("time", "ms", fast, slow).spread is None


def judged(log: float, verdict: str, where: str = "") -> Judged:
    return Judged(Comparison("distance", "mm", Number("a", 1.0), Number("b", 1.0), where), Effect(log), None, verdict)


def test_of_several_comparisons_the_weakest_decides_and_of_alternatives_the_best():
    holds, direction, undecided, fails = (
        judged(log, word)
        for log, word in ((-0.3, "holds"), (-0.1, "direction only"), (0.0, "undecided"), (0.2, "fails"))
    )
    assert decide([[holds, direction]])[0] == "direction only"
    assert decide([[holds, undecided, direction]])[0] == "undecided"
    assert decide([[holds, undecided, fails]])[2] is fails
    verdict, way, deciding = decide([[holds, fails], [direction, holds]])
    assert verdict == "direction only" and len(way) == 2 and deciding is direction
    close = judged(-0.2, "holds")
    assert decide([[holds, close]])[2] is close, "of equals the one with the smaller effect"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("holds", "holds"), "holds"),
        (("holds", "direction only"), "direction only"),
        (("fails", "fails"), "fails"),
        (("holds", "fails"), "undecided"),
        (("holds", "undecided"), "undecided"),
        (("fails", "undecided"), "undecided"),
    ],
)
def test_back_ends_must_agree(words, expected):
    verdict, each, _ = decide_everywhere([judged(0.0, word, f"{k}") for k, word in enumerate(words)])
    assert verdict == expected and [one.verdict for one in each] == [*words]


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


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        (Effect(math.log(0.99), 0.01), "1.0 % ± 1 less"),
        (Effect(math.log(1.25)), "25 % more"),
        (Effect(math.log(3.0), 0.1), "3.0 times as much (2.7–3.3)"),
        (Effect(math.log(0.5), math.inf), "50 % less"),
    ],
)
def test_an_effect_is_told_in_percent_or_times(effect, expected):
    assert difference(effect) == expected
