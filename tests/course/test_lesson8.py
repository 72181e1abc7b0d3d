"""Lesson 8's checks: they accept the solution, and say of usual mistakes what is wrong."""

import statistics
from dataclasses import replace

import numpy as np
import pytest
from lesson_source import answers

from course import lesson8
from course.checks import Wrong
from course.checks.lesson8 import check_claim, check_detectors, check_plan, check_splits

SOLVED = answers("lesson8")
CLEARANCE, JUDGE = SOLVED["clearance"], SOLVED["judge_c2"]
NEAREST, HAS_COPY = SOLVED["nearest"], SOLVED["has_copy"]


def mean(errors):
    return statistics.fmean(errors.values())


def difference(ours, other):
    return mean(other) - mean(ours)


def test_the_solved_claim_is_the_suites_on_all_characters(capsys):
    check_claim(CLEARANCE, JUDGE)
    assert "teen" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("clearance", "sentence"),
    [
        (lambda a, b: None, "returns None"),
        (lambda a, b: CLEARANCE(b, a), "wrong way round"),
        (difference, "spread is missing"),
        (
            lambda a, b: difference(a, b) - 2 * (statistics.stdev(a.values()) + statistics.stdev(b.values())),
            "both methods",
        ),
        (lambda a, b: difference(a, b) - 2 * np.std([b[s] - a[s] for s in a]), "divides by n"),
        (lambda a, b: difference(a, b) - np.std([b[s] - a[s] for s in a], ddof=1), "one standard deviation"),
        (
            lambda a, b: difference(a, b) - 2 * np.std(np.subtract([*b.values()], [*a.values()]), ddof=1),
            "by place in the dictionary",
        ),
        (lambda a, b: difference(a, b) - 2 * statistics.stdev([b[s] - a[s] for s in a]), "One seed"),
    ],
)
def test_a_wrong_clearance_is_told_why(clearance, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_claim(clearance, JUDGE)


def judged(errors, best, others, holds=None):
    values = [errors[method] for method in others if method != best]
    every = (
        all(CLEARANCE(errors[best], other) > 0 for other in values) if holds is None else holds(errors[best], values)
    )
    return every, mean(errors[best]) / min(map(mean, values))


def best_and_others(errors, character):
    best = "dense" if character == "dragon" else "refined"
    return errors[best], [errors[method] for method in lesson8.PAPERS if method != best]


def beats_the_next(errors, character):
    best, others = best_and_others(errors, character)
    return CLEARANCE(best, min(others, key=mean)) > 0 and all(mean(best) < mean(other) for other in others)


def mean_of_ratios(errors, character):
    best, others = best_and_others(errors, character)
    other = min(others, key=mean)
    return statistics.fmean(best[seed] / other[seed] for seed in best)


@pytest.mark.parametrize(
    ("judge_c2", "sentence"),
    [
        (lambda errors, name: None, "expected"),
        (lambda errors, name: ("holds", 0.5), "True or False"),
        (lambda errors, name: (JUDGE(errors, name)[0], 1 / JUDGE(errors, name)[1]), "upside down"),
        (lambda errors, name: judged(errors, "refined", errors), "straight line"),
        (lambda errors, name: judged(errors, "refined", lesson8.PAPERS), "dragon"),
        (
            lambda errors, name: judged(
                errors,
                "dense" if name == "dragon" else "refined",
                lesson8.PAPERS,
                lambda best, others: all(mean(best) < mean(other) for other in others),
            ),
            "within its spread",
        ),
        (
            lambda errors, name: judged(
                errors,
                "dense" if name == "dragon" else "refined",
                lesson8.PAPERS,
                lambda best, others: any(CLEARANCE(best, other) > 0 for other in others),
            ),
            "use all",
        ),
        (lambda errors, name: (beats_the_next(errors, name), JUDGE(errors, name)[1]), "to all five"),
        (lambda errors, name: (JUDGE(errors, name)[0], mean_of_ratios(errors, name)), "ratios seed by seed"),
        (lambda errors, name: (False, 1.0), "compared with itself"),
    ],
)
def test_a_wrong_verdict_is_told_why(judge_c2, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_claim(CLEARANCE, judge_c2)


def test_the_solved_detectors_pass(capsys):
    check_detectors(NEAREST, HAS_COPY)
    assert "scaled copy" in capsys.readouterr().out


def by_training_length(pose, training):
    distances = np.linalg.norm(training - pose, axis=1)
    return distances.min() / np.linalg.norm(training[distances.argmin()])


@pytest.mark.parametrize(
    ("nearest", "sentence"),
    [
        (lambda pose, training: None, "returns None"),
        (lambda pose, training: np.linalg.norm(training - pose, axis=1), "one number"),
        (lambda pose, training: np.linalg.norm(training - pose, axis=1).min(), "pose's own length"),
        (lambda pose, training: np.linalg.norm(training - pose, axis=1).mean() / np.linalg.norm(pose), "not the mean"),
        (lambda pose, training: np.abs(training - pose).sum(1).min() / np.abs(pose).sum(), "root of the sum"),
        (lambda pose, training: np.abs(training - pose).sum(1).min() / np.linalg.norm(pose), "root of the sum"),
        (lambda pose, training: np.linalg.norm(training - pose) / np.linalg.norm(pose), "axis=1"),
        (by_training_length, "length of the training pose"),
    ],
)
def test_a_wrong_distance_is_told_why(nearest, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_detectors(nearest, HAS_COPY)


def factors_of(pose, training):
    with np.errstate(divide="ignore", invalid="ignore"):
        return training / pose


def fits(factors, low=0.2499, high=3.0003):
    return (factors >= low) & (factors <= high)


def copies_within(pose, training, low, high):
    moves = pose != 0
    alike = training[((training != 0) == moves).all(1)]
    return bool(fits(alike[:, moves] / pose[moves], low, high).all(1).any())


@pytest.mark.parametrize(
    ("has_copy", "sentence"),
    [
        (lambda pose, training: None, "returns None"),
        (lambda pose, training: False, "misses a copy"),
        (lambda pose, training: fits(factors_of(pose, training)[:, pose != 0]).all(1).any(), "rests in its copies"),
        (lambda pose, training: fits(factors_of(pose, training)[:, pose != 0]).any(), "none has the same controls"),
        (
            lambda pose, training: any(HAS_COPY(row, pose[None]) for row in training if row.any()),
            "misses a copy",
        ),
        (
            lambda pose, training: bool(
                fits(np.abs(factors_of(pose, training[((training != 0) == (pose != 0)).all(1)])[:, pose != 0]))
                .all(1)
                .any()
            ),
            "no sign",
        ),
        (
            lambda pose, training: bool(
                fits(factors_of(pose, training[((training != 0) == (pose != 0)).all(1)])[:, pose != 0]).any(1).any()
            ),
            "not some",
        ),
        (
            lambda pose, training: bool(
                fits(factors_of(pose, training[((training != 0) == (pose != 0)).all(1)])[:, pose != 0], 0.25, 2.99)
                .all(1)
                .any()
            ),
            "exactly 3",
        ),
        (lambda pose, training: copies_within(pose, training, 0.25, 3.0), "0.01 % more"),
        (lambda pose, training: copies_within(pose, training, 0.24, 3.1), "no more than 0.01 %"),
    ],
)
def test_a_wrong_search_for_copies_is_told_why(has_copy, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_detectors(NEAREST, has_copy)


def test_the_solved_leaks_pass_and_are_what_the_detectors_see():
    check_splits(SOLVED["leaks"])
    for name, said in SOLVED["leaks"]().items():
        split = lesson8.splits()[name]
        near = np.mean([NEAREST(pose, split.training) < 0.1 for pose in split.test])
        copies = np.mean([HAS_COPY(pose, split.training) for pose in split.test])
        assert (near > 0.3) == (said == "neighbours"), name
        assert (copies > 0.3) == (said != "none"), name
        assert near in (0.0, 1.0) or near > 0.3, name


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"A": "none"}, "nearer than 0.1"),
        ({"A": "scaled copies"}, "factors near 1"),
        ({"B": "scaled copies"}, "after the split"),
        ({"C": "none"}, "last column"),
        ({"C": "neighbours"}, "what else"),
        ({"D": "maybe"}, "expected one of"),
        ({"F": "none"}, "Expected the splits"),
    ],
)
def test_wrong_leaks_are_told_why(changes, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_splits(lambda: SOLVED["leaks"]() | changes)


def test_the_solved_plan_passes_and_any_change_breaks_its_seal(capsys):
    plan = SOLVED["plan"]()
    check_plan(lambda: plan)
    assert lesson8.seal(plan) in capsys.readouterr().out
    assert lesson8.seal(replace(plan, least_effect=0.91)) != lesson8.seal(plan)


COMMAND = SOLVED["plan"]().command


@pytest.mark.parametrize(
    "changes",
    [
        {"hypothesis": "The normal error falls by 10 %, since the network need not learn the line"},
        {
            "hypothesis": "Half of the poses will increase the error because there is less to learn from",
            "least_effect": 1.2,
        },
        {"hypothesis": "Wider layers and more of them give smaller errors because they bend more"},
        {"command": COMMAND.replace(" SEED", " JOBS=2 PROFILE=laptop SEED")},
        {"command": COMMAND.replace("teen toon", "teen,toon")},
    ],
)
def test_a_plausible_plan_in_other_words_passes(changes):
    check_plan(lambda: replace(SOLVED["plan"](), **changes))


def test_the_example_in_the_plans_docstring_is_a_command_that_passes():
    (line,) = (line.strip() for line in lesson8.Plan.__doc__.splitlines() if line.strip().startswith("make table2"))
    check_plan(lambda: replace(SOLVED["plan"](), characters=("teen", "woman"), command=line))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"hypothesis": "We try a line because we can"}, "no direction"),
        ({"hypothesis": "Errors become smaller"}, "no reason"),
        ({"base": "densest"}, "a method of Table 2"),
        ({"changes": ()}, "Nothing changes"),
        ({"changes": ("a line", "wider layers")}, "2 things change at once"),
        ({"changes": ("a line")}, "needs a comma"),
        ({"metric": "error"}, "metric"),
        ({"characters": ("tiny",)}, "characters"),
        ({"seeds": (0,)}, "1 seeds show no spread"),
        ({"seeds": (0, 1, 1)}, "stands twice"),
        ({"chosen_on": "test"}, "has seen the test"),
        ({"beside": ("refined",)}, "Nothing trivial"),
        ({"least_effect": 1.1}, "smaller .* above 1"),
        ({"least_effect": 0.0}, "above 0"),
        ({"least_effect": 1.0}, "varies over seeds"),
        ({"hypothesis": "Without a line the error becomes larger because it has to learn more"}, "larger .* below 1"),
        ({"hypothesis": "The error becomes smaller because"}, "no reason"),
        ({"changes": ("half of the poses and wider layers",)}, "two things"),
        ({"chosen_on": "training"}, "learns by heart"),
        ({"command": f"{COMMAND} PROFILE=quick"}, "quick"),
        ({"command": COMMAND.replace("0 1 2", "0 1 2 3")}, "SEED has 3, which"),
        ({"command": COMMAND.replace("teen toon", "teen toon woman")}, "CHARACTERS has woman, which"),
        ({"command": COMMAND.replace("SEED", "SEEDS")}, "SEEDS is no variable"),
        ({"command": f"CHARACTERS=teen {COMMAND}"}, "variables stand behind"),
        ({"command": COMMAND[:-1]}, "quote"),
        ({"least_effect": 0.999}, "varies over seeds"),
        ({"command": "python mine.py"}, "make table2"),
        ({"command": 'make table2 METHODS="dense linear neutral mine.py" CHARACTERS=teen SEED="0 1 2"'}, "lacks toon"),
        (
            {"command": 'make table2 METHODS="dense linear neutral" CHARACTERS="teen toon" SEED="0 1 2"'},
            "one file of yours",
        ),
        ({"command": 'make table2 METHODS="standard mine.py" CHARACTERS="teen toon" SEED=0'}, "SEED lacks 1, 2"),
    ],
)
def test_a_weak_plan_is_told_why(changes, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_plan(lambda: replace(SOLVED["plan"](), **changes))


def test_a_missing_answer_says_so_itself():
    def nothing(*_):
        raise NotImplementedError

    for check, count in ((check_claim, 2), (check_detectors, 2), (check_splits, 1), (check_plan, 1)):
        with pytest.raises(NotImplementedError):
            check(*[nothing] * count)
