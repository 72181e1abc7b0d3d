"""Lesson 8: a claim and its rule, leaks between training and test poses, a plan."""

import re
import shlex
import statistics
from collections.abc import Callable, Mapping

import numpy as np

from course import lesson8
from course.checks import passed, require
from replicate.methods.method_registry import methods
from replicate.report.results import order_of
from replicate.targets.claims.rules import QUANTITIES, MissingNumber

# A claim by its rule.

OURS, OTHER = {0: 1.0, 1: 1.1, 2: 1.3}, {2: 1.45, 1: 1.35, 0: 1.2}  # the second one's seeds in another order


def check_claim(clearance: Callable, judge_c2: Callable) -> None:
    """Compare a clearance with that of the rule, then the verdicts on all characters."""
    _check_clearance(clearance)
    _check_made_up(judge_c2)
    words = []
    errors = lesson8.normal_errors()
    for character in sorted(errors, key=order_of):
        holds, effect = judge_c2(errors[character], character)
        expected, ratio = _judged(errors[character], character)
        word = "holds" if expected else "fails"
        require(bool(holds) == expected, f"On {character} C2 {word} by this rule, and yours says otherwise.")
        sentence = f"On {character} the effect is {ratio:.3f}, yours {effect:.3f}: divide means over the seeds."
        require(np.isclose(effect, ratio, rtol=1e-3), sentence)
        words.append(f"{character} {word} ({ratio:.2f})")
    passed(f"your verdicts are those of the rule: {', '.join(words)}")


def _clearance(ours: Mapping[int, float], other: Mapping[int, float], spreads: float = 2.0) -> float:
    """Return the mean difference over the seeds, minus some standard deviations of it."""
    differences = [other[seed] - ours[seed] for seed in ours]
    sd = statistics.stdev(differences) if len(differences) > 1 else 0.0
    return statistics.fmean(differences) - spreads * sd


def _judged(errors: Mapping[str, Mapping[int, float]], character: str) -> tuple[bool, float]:
    """Return whether C2 holds by the lesson's rule, and its effect."""
    best = "dense" if character.partition("@")[0] == "dragon" else "refined"
    others = [errors[method] for method in lesson8.PAPERS if method != best]
    means = [statistics.fmean(each.values()) for each in (errors[best], *others)]
    return all(_clearance(errors[best], other) > 0 for other in others), means[0] / min(means[1:])


def _check_clearance(clearance: Callable) -> None:
    got = clearance(OURS, OTHER)
    require(got is not None, "clearance returns None: end it with `return`.")
    mean, right = _clearance(OURS, OTHER, 0.0), _clearance(OURS, OTHER)
    sds = [statistics.stdev(each.values()) for each in (OURS, OTHER)]
    by_place = [other - ours for ours, other in zip(OURS.values(), OTHER.values(), strict=True)]
    paired = [OTHER[seed] - OURS[seed] for seed in OURS]
    for wrong, sentence in (
        (-mean - (mean - right), "The wrong way round: other − ours is positive where ours is smaller."),
        (mean, "The spread is missing: take twice the standard deviation of the difference away."),
        (_clearance(OURS, OTHER, 1.0), "You take one standard deviation away: the rule says two."),
        (2 * mean - right, "You add the spread: a larger spread has to make it harder to hold."),
        (mean - 2 * sum(sds), "You take the spreads of both methods: take that of the difference, seed by seed."),
        (
            mean - 2 * np.hypot(*sds),
            "You add variances as if seeds were independent: take the difference's, seed by seed.",
        ),
        (
            mean - 2 * statistics.pstdev(paired),
            "Your standard deviation divides by n: over three seeds take n − 1 (ddof=1).",
        ),
        (mean - 2 * statistics.stdev(by_place), "You pair by place in the dictionary: take the same seed of both."),
    ):
        require(not np.isclose(got, wrong), sentence)
    require(np.isclose(got, right), f"For {OURS} and {OTHER} expected {right:.3f}, got {got}.")
    sentence = "One seed has no spread: return the difference itself, and take no standard deviation of one number."
    try:
        alone = clearance({0: 1.0}, {0: 1.5})
    except statistics.StatisticsError:
        alone = np.nan
    require(np.isclose(alone, 0.5), sentence)


def _made_up(**errors: float) -> dict[str, dict[int, float]]:
    """Return errors seed by seed, all methods' but some at 3 degrees."""
    values = dict.fromkeys((*lesson8.PAPERS, "linear"), 3.0) | errors
    return {method: {seed: value + 0.01 * seed for seed in range(3)} for method, value in values.items()}


def _check_made_up(judge_c2: Callable) -> None:
    answer = judge_c2(_made_up(refined=1.0, dense=2.0), "teen")
    require(isinstance(answer, tuple) and len(answer) == 2, "judge_c2: expected (whether it holds, the effect).")
    holds, effect = answer
    require(isinstance(holds, bool | np.bool_), f"Expected True or False as the verdict, got {holds!r}.")
    require(not np.isclose(effect, 1), "An effect of 1 is that of the best one compared with itself: leave it out.")
    require(holds, "With refined at 1°, dense at 2° and the others at 3° C2 holds on the teen.")
    require(not np.isclose(effect, 2.01 / 1.01), "The effect is upside down: below 1 is what the claim wants.")
    uneven = _made_up()
    uneven["refined"], uneven["dense"] = {0: 1.0, 1: 1.5, 2: 2.0}, {0: 2.0, 1: 2.6, 2: 3.1}
    _, of_uneven = judge_c2(uneven, "teen")
    require(
        not np.isclose(of_uneven, np.mean([1 / 2, 1.5 / 2.6, 2 / 3.1])),
        "You take the mean of ratios seed by seed: divide the mean of the best by the smallest mean of the others.",
    )
    require(np.isclose(effect, 1.01 / 2.01), f"With 1.01° against 2.01° expected an effect of 0.502, got {effect:.3f}.")
    require(
        judge_c2(_made_up(refined=1.0, linear=0.5), "teen")[0],
        "The straight line is not among the paper's methods: it decides no claim, so go through lesson8.PAPERS.",
    )
    on_dragon = [judge_c2(_made_up(**{best: 1.0}), "dragon")[0] for best in ("dense", "refined")]
    require(on_dragon == [True, False], "On the dragon the rule wants dense to be the best one.")
    require(
        not judge_c2(_made_up(refined=1.0, lbs24=0.9), "woman")[0],
        "One method below the best is enough to fail: use all.",
    )
    wide = _made_up(refined=1.0)
    wide["coarse"] = {0: 1.0, 1: 1.3, 2: 1.1}
    require(
        not judge_c2(wide, "toon")[0],
        "A smaller mean is not enough: where the difference is within its spread, the claim fails.",
    )
    noisy = _made_up(refined=1.0, dense=2.0)
    noisy["coarse"] = {0: 1.5, 1: 9.0, 2: 2.0}
    require(
        not judge_c2(noisy, "teen")[0],
        "The other with the smallest mean may be clear of the best one while a noisier one is not: apply clearance to "
        "all five.",
    )


# Leaks.


def check_detectors(nearest: Callable, has_copy: Callable) -> None:
    """Try both detectors on poses that are near, scaled, or neither; then on the animation."""
    rng = np.random.default_rng(4)
    training = rng.normal(size=(50, 6)).astype(np.float32)
    training[:, 5] = 0
    pose = training[7] * np.float32(1.1) + np.float32(0.01)
    got = nearest(pose, training)
    require(got is not None, "nearest returns None: end it with `return`.")
    require(np.ndim(got) == 0, f"nearest: expected one number, got the shape {np.shape(got)}: the smallest of all.")
    lengths = np.linalg.norm(training - pose, axis=1)
    require(not np.isclose(got, lengths.min()), "nearest: divide the distance by the pose's own length.")
    require(
        not np.isclose(got, lengths.mean() / np.linalg.norm(pose)), "nearest: take the smallest distance, not the mean."
    )
    require(
        not np.isclose(got, np.linalg.norm(training - pose) / np.linalg.norm(pose), rtol=1e-4),
        "nearest: this is the length of all differences together: a distance for each row needs axis=1.",
    )
    sums = np.abs(training - pose).sum(1).min()
    require(
        not any(np.isclose(got, sums / by, rtol=1e-4) for by in (1, np.abs(pose).sum(), np.linalg.norm(pose))),
        "nearest: you add absolute values: a Euclidean length is the root of the sum of squares.",
    )
    require(
        not np.isclose(got, lengths.min() / np.linalg.norm(training[lengths.argmin()]), rtol=1e-4),
        "nearest: you divide by the length of the training pose: divide by that of the pose which is asked about.",
    )
    right = lengths.min() / np.linalg.norm(pose)
    require(
        np.isclose(got, right, rtol=1e-4),
        f"nearest: expected {right:.4f} for a pose beside a training pose, got {got:.4f}.",
    )
    _check_copies(has_copy, training)
    split = lesson8.splits()["C"]
    copied = [pose for pose in split.test if has_copy(pose, split.training)]
    require(copied, "On the animation has_copy finds nothing: compare with all training poses, control by control.")
    far = float(np.median([nearest(pose, split.training) for pose in copied]))
    passed(
        f"both are right; on split C, {len(copied)} of {len(split.test)} test poses have a scaled copy, at a "
        f"median distance of {far:.2f}"
    )


def _check_copies(has_copy: Callable, training: np.ndarray) -> None:
    def planted(copy: np.ndarray) -> object:
        return has_copy(pose, np.concatenate([training, copy.astype(np.float32)[None]]))

    pose = np.array([0.4, -0.2, 0.0, 0.6, 0.0, 0.1], np.float32)
    factors = np.array([0.3, 2.9, 1.0, 1.4, 1.0, 0.26])
    found = planted(pose * factors)
    require(found is not None, "has_copy returns None: end it with `return`.")
    require(np.ndim(found) == 0, f"has_copy: expected True or False, got the shape {np.shape(found)}.")
    require(found, "has_copy misses a copy: each control has a factor of its own, from 0.25 to 3.")
    require(
        not has_copy(pose, training), "has_copy sees a copy among poses of which none has the same controls at rest."
    )
    for changed, sentence in (
        (
            pose * 0.2,
            "has_copy: a factor of 0.2 is not Eq. 5's, which begins at 0.25 (training over test, not the reverse).",
        ),
        (pose * 3.5, "has_copy: a factor of 3.5 is beyond Eq. 5's 3."),
        (pose * np.array([1, 1, 1, 1, 1, 9]), "has_copy: all controls need a fitting factor, not some."),
        (pose * np.array([1, -1, 1, 1, 1, 1]), "has_copy: Eq. 5 turns no sign."),
        (pose + np.array([0, 0, 0.3, 0, 0, 0]), "has_copy: a control that rests in the pose rests in its copies."),
        (pose * np.array([1, 1, 1, 0, 1, 1]), "has_copy: a control that moves in the pose moves in its copies."),
        (0 * pose, "has_copy: the pose at rest is no copy of one that moves."),
    ):
        require(not planted(changed), sentence)
    halves = np.array([1.0, 1, 1, 1, 1, 9]), np.array([9.0, 1, 1, 1, 1, 1])
    rows = np.concatenate([training, *[(pose * half).astype(np.float32)[None] for half in halves]])
    require(
        not has_copy(pose, rows),
        "has_copy: a single training pose has to fit in all controls: all over controls, then any.",
    )
    require(
        planted(pose * 3), "has_copy: a factor of exactly 3, stored as float32, is still Eq. 5's: allow 0.01 % more."
    )
    require(
        planted(pose * (3 * 1.00005)) and planted(pose * (0.25 * 0.99995)),
        "has_copy: allow the factors 0.01 % more at both ends: 3 times 1.00005 is still a copy.",
    )
    require(
        not planted(pose * 3.003) and not planted(pose * 0.2497),
        "has_copy: allow no more than 0.01 % at both ends: a factor of 3.003 or 0.2497 is none of Eq. 5's.",
    )


MADE = {"A": "neighbours", "B": "none", "C": "scaled copies", "D": "none", "E": "neighbours"}
HINTS = {
    ("neighbours", "none"): "many of its test poses have a training pose nearer than 0.1",
    ("neighbours", "scaled copies"): "its test poses have neighbours, which explain the copies: factors near 1",
    ("none", "neighbours"): "none of its test poses has a training pose nearer than 0.1",
    ("none", "scaled copies"): "no test pose has a copy; training that is augmented after the split leaks nothing",
    ("scaled copies", "none"): "its nearest poses are far away, but look at the last column",
    ("scaled copies", "neighbours"): "none of its test poses has a near one, so what else is it?",
}


def check_splits(leaks: Callable) -> None:
    """Compare what is said of the splits with how they were made."""
    answer = leaks()
    require(isinstance(answer, Mapping), f"Expected a dictionary of splits, got {type(answer).__name__}.")
    require(set(answer) == set(MADE), f"Expected the splits {', '.join(MADE)}, got {', '.join(map(str, answer))}.")
    for name, said in answer.items():
        require(said in lesson8.LEAKS, f"Split {name}: expected one of {', '.join(lesson8.LEAKS)}, got {said!r}.")
        require(said == MADE[name], f"Split {name}: {HINTS.get((MADE[name], said), '')}.")
    passed("A is random frames, E every tenth frame; C was augmented before it was split, B after; D is whole clips")


# A plan.

TUPLES = ("changes", "characters", "seeds", "beside")
SMALLER = re.compile(
    r"\b(smaller|lower(s|ed)?|falls?|fell|drops?|decreases?|shrinks?|reduces?|better|halves?|below)\b",
    re.I,
)
LARGER = re.compile(r"\b(larger|higher|raises?|rises?|increases?|grows?|worse|doubles?|above)\b", re.I)
OTHER_WORDS = re.compile(r"\b(less|more|fewer)\b", re.I)  # of errors or of what changes
REASON = re.compile(r"\b(because|since|due to|owing to)\b(.*)", re.I | re.S)
TWO_THINGS = re.compile(r"\b(and|plus|as well as)\b|[&+]", re.I)
FEWEST_SEEDS = 3
TRIVIAL = ("linear", "neutral", "squares")  # no network
VARIABLES = ("METHODS", "CHARACTERS", "SEED", "PROFILE", "JOBS", "DEVICE", "CONFIG", "SPLIT", "CLUSTER")


def check_plan(plan: Callable) -> None:
    """Read a plan as a referee would; then say its rule and its seal."""
    made = plan()
    require(isinstance(made, lesson8.Plan), f"Expected a lesson8.Plan, got {type(made).__name__}.")
    for name in TUPLES:
        value = getattr(made, name)
        require(
            isinstance(value, tuple | list), f"{name}: expected a tuple, got {value!r}; one entry needs a comma: (x,)."
        )
    _check_hypothesis(made.hypothesis)
    known = methods()
    require(made.base in known, f"base: expected a method of Table 2, such as dense, got {made.base!r}.")
    require(made.changes, "Nothing changes: what does mine.py do otherwise than the base?")
    sentence = f"{len(made.changes)} things change at once: whatever comes out, you won't know which of them it was."
    require(len(made.changes) == 1, sentence)
    both = TWO_THINGS.search(made.changes[0])
    sentence = "Your one change reads like two things, joined by “{}”: change one of them, or say it without that word."
    require(not both, sentence.format(both and both.group()))
    metrics = {f"{kind}_error_mean": kind for kind in QUANTITIES}
    require(made.metric in metrics, f"metric: expected one of {', '.join(metrics)}, got {made.metric!r}.")
    there = [name for name in lesson8.evidence().characters() if "@" not in name]
    for name in made.characters:
        require(name in there, f"characters: expected some of {', '.join(there)}, got {name!r}.")
    require(made.characters, "No character: on which of Table 2's shall it hold?")
    seeds = set(made.seeds)
    require(len(seeds) == len(made.seeds), "A seed stands twice in the plan: it gives the same numbers twice.")
    sentence = f"{len(seeds)} seeds show no spread to speak of: take at least {FEWEST_SEEDS}."
    require(len(seeds) >= FEWEST_SEEDS, sentence)
    sentence = (
        "What is chosen on the test poses has seen the test: choose on validation poses, and look at the test once."
    )
    require(made.chosen_on != "test", sentence)
    sentence = "What is chosen by its training error is what learns by heart best: choose on validation poses."
    require(made.chosen_on != "training", sentence)
    require(made.chosen_on == "validation", f'chosen_on: expected "validation", got {made.chosen_on!r}.')
    sentence = f"Nothing trivial stands beside: name one of {', '.join(TRIVIAL)}, to know what a ratio is worth."
    require(set(made.beside) & set(TRIVIAL), sentence)
    _check_effect(made, metrics[made.metric])
    _check_command(made)
    bound = "at most" if made.least_effect < 1 else "at least"
    where, seeds = " and ".join(made.characters), ", ".join(map(str, made.seeds))
    passed(
        f"it holds if your {made.metric} is {bound} {made.least_effect:g} × that of {made.base} on {where}, and the "
        f"difference exceeds twice its spread over seeds {seeds}; seal {lesson8.seal(made)}"
    )


def _check_hypothesis(hypothesis: str) -> None:
    reason = REASON.search(hypothesis)
    require(
        reason and len(reason.group(2).split()) > 1,
        "The hypothesis gives no reason: what is it because of? (“because” or “since”, and some words.)",
    )
    claimed = REASON.sub("", hypothesis)
    require(
        any(words.search(claimed) for words in (SMALLER, LARGER, OTHER_WORDS)),
        "The hypothesis has no direction: say what becomes smaller or larger, falls or rises, before you say why.",
    )


def _check_effect(plan: lesson8.Plan, kind: str) -> None:
    effect = plan.least_effect
    require(effect > 0, f"least_effect: expected your error over the base's, above 0, got {effect}.")
    claimed = REASON.sub("", plan.hypothesis)
    smaller, larger = (bool(words.search(claimed)) for words in (SMALLER, LARGER))
    require(
        not (smaller and not larger and effect > 1),
        f"Your hypothesis says smaller and your least_effect {effect} is above 1, larger: which is it?",
    )
    require(
        not (larger and not smaller and effect < 1),
        f"Your hypothesis says larger and your least_effect {effect} is below 1, smaller: which is it?",
    )
    for character in plan.characters:
        try:
            number = lesson8.evidence().error(character, plan.base, kind)
        except MissingNumber:
            continue
        require(
            number.sd is not None,
            f"Table 2 has one run of {plan.base} on {character}, so nobody knows its spread: take a base with several.",
        )
        spread = 2 * number.sd / number.value
        require(
            abs(1 - effect) > spread,
            f"An effect of {abs(1 - effect):.1%} is less than {plan.base} varies over seeds on {character}, "
            f"{spread:.1%}: ask for more.",
        )


def _check_command(plan: lesson8.Plan) -> None:
    try:
        words = shlex.split(plan.command)
    except ValueError:
        words = []
    require(words, f"command: expected a line with each quote closed, got {plan.command!r}.")
    require("=" not in words[0], "command: variables stand behind make table2, not before it.")
    require(words[:2] == ["make", "table2"], f"command: expected make table2 …, got {plan.command!r}.")
    given = dict(word.split("=", 1) for word in words[2:] if "=" in word)
    for name in given:
        require(name in VARIABLES, f"command: {name} is no variable of make table2: expected {', '.join(VARIABLES)}.")
    require(
        given.get("PROFILE") != "quick",
        "command: PROFILE=quick is for finding mistakes: its networks have learnt too little to answer anything.",
    )
    for variable, wanted in (
        ("METHODS", (plan.base, *plan.beside)),
        ("CHARACTERS", plan.characters),
        ("SEED", tuple(map(str, plan.seeds))),
    ):
        values = given.get(variable, "").replace(",", " ").split()
        standard = variable == "METHODS" and "standard" in values
        missing = [each for each in wanted if each not in values and not standard]
        sentence = f'command: {variable} lacks {", ".join(missing)}; several values stand in quotes, {variable}="a b".'
        require(not missing, sentence)
        more = [each for each in values if each not in wanted and variable != "METHODS"]
        sentence = (
            f"command: {variable} has {', '.join(more)}, which the plan does not name: you could pick afterwards."
        )
        require(not more, sentence)
    own = [word for word in given["METHODS"].replace(",", " ").split() if word.endswith(".py")]
    require(len(own) == 1, f"command: expected one file of yours in METHODS, such as mine.py, got {len(own)}.")
