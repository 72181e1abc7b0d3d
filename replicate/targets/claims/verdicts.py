"""The paper's claims, each with what judges it, and the verdicts on results."""

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from replicate.base.tables import Column, read_csv, write_csv
from replicate.benchmarks.bench_training import BALANCED, RAW_ANIMATION, USUAL
from replicate.config import RigidConfig
from replicate.report.results import STANDS_FOR, UNITS
from replicate.targets.claims.rules import (
    HALF,
    HOLDS,
    MEASURED,
    NETWORKS,
    NOT_TESTED,
    PRINTED,
    QUANTITIES,
    RECIPES,
    SEGMENTS,
    VERDICTS,
    Comparison,
    Evidence,
    Judged,
    MissingNumber,
    Number,
    Ways,
    beside_other_ways,
    cnn_better_under_ik,
    cpu_beats_gpu,
    decide,
    decide_everywhere,
    dense_is_faster,
    faster_than_the_rig,
    grows_under_ik,
    moves_other_meshes,
    on_the_papers_laptop,
    other_growths,
    posed_otherwise,
    refined_everywhere,
    significant,
    stand_in,
    times_as_fast,
    verdict_of,
)
from replicate.targets.claims.rules import UNITS as SIGNS
from replicate.targets.table1.tables import CLAIM as SIZES

if TYPE_CHECKING:
    import pandas


# The paper's claims, and the comparisons that decide them.

SKINS = ("lbs16", "lbs24", "lbs32")
TAU_MM = RigidConfig().tau_mm


def no_remark(evidence: Evidence, character: str) -> str:
    """Return an empty remark."""
    return ""


@dataclass(frozen=True)
class Claim:
    """A claim of the paper's.

    name: its number in our list
    text: the claim, in a short sentence
    where: its place in the paper
    rule: what is compared, in words; `RULE` says what follows from it
    ways: (evidence, character) → the comparisons that it needs; raises MissingNumber
    remark: (evidence, character) → sentences beside the verdict, or ""; MissingNumber leaves the verdict as it is
    kinds: errors, keys of `QUANTITIES`, in which a straight line is compared with the networks, beside the verdict
    asks: what an effect must reach for the claim to hold: half of the "paper"'s own, the "direction" alone, or the
        ratio that the claim itself names; "measured": there is no verdict, and the first comparison is the number
    everywhere: whether the comparisons are those of several places, which must agree
    """

    name: str
    text: str
    where: str
    rule: str
    ways: Callable[[Evidence, str], Ways]
    remark: Callable[[Evidence, str], str] = no_remark
    kinds: tuple[str, ...] = ()
    asks: Literal["paper", "direction", "measured"] | float = "paper"
    everywhere: bool = False


def smaller_error(evidence: Evidence, character: str, method: str, other: str, kind: str) -> Comparison:
    """Compare the mean errors of two methods. Raises MissingNumber.

    method: the one that a claim wants to have the smaller error
    other: the one that it is compared with
    kind: "vertex" or "normal"
    """
    left, right = (evidence.error(character, name, kind) for name in (method, other))
    return Comparison(*QUANTITIES[kind], left, right)


def best_network(character: str) -> str:
    """Return the method with the paper's smallest normal error, for the film character that this one stands for."""
    return "dense" if stand_in(character) == "Toothless" else "refined"


def _refined_beats_coarse(evidence: Evidence, character: str) -> Ways:
    return (tuple(smaller_error(evidence, character, "refined", "coarse", kind) for kind in QUANTITIES),)


def _what_refinement_does(evidence: Evidence, character: str) -> str:
    """Return by how many percent refinement changes the coarse model's errors, in a sentence."""
    phrases = []
    for kind, (quantity, _) in QUANTITIES.items():
        coarse, refined = (evidence.error(character, method, kind).value for method in ("coarse", "refined"))
        share = f"{significant(100 * abs(1 - refined / coarse), 2)} %" if coarse else "nothing"
        label = quantity if quantity.endswith("error") else f"{quantity} error"
        phrases.append(f"takes {share} off the {label}" if refined <= coarse else f"adds {share} to the {label}")
    return f"Refinement {' and '.join(phrases)}."


def _smallest_normal_error(evidence: Evidence, character: str) -> Ways:
    best = best_network(character)
    others = (method for method in (*NETWORKS, *SKINS) if method != best)
    return (tuple(smaller_error(evidence, character, best, other, "normal") for other in others),)


def _refined_beats_skins(evidence: Evidence, character: str) -> Ways:
    return (tuple(smaller_error(evidence, character, "refined", skin, "normal") for skin in SKINS),)


def _skin_close_without_wrinkles(evidence: Evidence, character: str) -> Ways:
    ways = []
    for skin in SKINS:
        distances = (evidence.error(character, method, "vertex") for method in (skin, "refined"))
        close = Comparison(*QUANTITIES["vertex"], *distances)
        ways.append((close, smaller_error(evidence, character, "refined", skin, "normal")))
    return tuple(ways)


SPECTRUM = {
    "high_frequency_error_mean": ("error of high frequency", "mm"),
    "high_frequency_share": ("its share", "ratio"),
}


def _dense_is_noisy(evidence: Evidence, character: str) -> Ways:
    if stand_in(character) == "Toothless":
        raise MissingNumber("The paper doesn't say so of Toothless: its dense networks are the best in normals.")
    comparisons = []
    for metric, (quantity, unit) in SPECTRUM.items():
        refined, coarse, dense = (
            evidence.number("table2", character, name, metric) for name in ("refined", "coarse", "dense")
        )
        comparisons += [Comparison(quantity, unit, network, dense) for network in (refined, coarse)]
    return (tuple(comparisons),)


def _dense_normals(evidence: Evidence, character: str) -> str:
    """Return the dense networks' normal error beside the refined model's, in a sentence."""
    return f"{smaller_error(evidence, character, 'refined', 'dense', 'normal')}.".capitalize()


def _sizes(evidence: Evidence, character: str) -> tuple[Number, Number]:
    small = evidence.number("table1", character, "refined", "model_size", "the CNN")
    return small, evidence.number("table1", character, "dense", "model_size")


def _cnn_is_smaller(evidence: Evidence, character: str) -> Ways:
    return ((Comparison("size", "MB", *_sizes(evidence, character)),),)


def _times_as_large(evidence: Evidence, character: str) -> str:
    """Return the ratio of sizes in a sentence, also with the released code's widths; more than the claim's is noted."""
    small, dense = _sizes(evidence, character)
    text = f"The dense model is {significant(dense.value / small.value)} times as large as the CNN"
    if dense.value > SIZES[1] * small.value:
        text += f", beyond the claim's {SIZES[1]:g}: the CNN is even smaller, which is no failure"
    try:
        wide = evidence.number("table1", character, "dense_released", "model_size")
    except MissingNumber:
        return f"{text}."
    return f"{text}; with the widths of the released code {significant(wide.value / small.value)} times."


def _rigid_within_tau(evidence: Evidence, character: str) -> Ways:
    mean = evidence.number(SEGMENTS, character, "attachment", "vertex_error_mean[rigid]", "rigid segments, mean")
    return ((Comparison("distance", "mm", mean, Number("τ", TAU_MM)),),)


def _worst_rigid(evidence: Evidence, character: str) -> str:
    tails = (evidence.number(SEGMENTS, character, "attachment", f"vertex_error_{s}[rigid]") for s in ("p95", "max"))
    p95, most = (significant(number.value) for number in tails)
    return f"The 95th percentile over their vertices and the test poses is {p95} mm, the maximum {most} mm."


def _augmented_beats_raw(evidence: Evidence, character: str) -> Ways:
    if stand_in(character) == "Ray":
        raise MissingNumber(
            "This rig has no animation, as Ray's: its poses are uniform draws, and nothing is augmented."
        )
    try:
        return (_augmented_against_raw(evidence, character, *RARE),)
    except MissingNumber:  # of an earlier run, without intervals
        return (_augmented_against_raw(evidence, character, "clips"),)


RARE = ("clips", BALANCED, "augmented and balanced", "_expressions")  # every interval of expressions counts alike


def _augmented_against_raw(
    evidence: Evidence,
    character: str,
    where: str,
    change: str = BALANCED,
    name: str = "augmented and balanced",
    mean: str = "",
) -> tuple[Comparison, ...]:
    """Compare both errors of coarse networks that were trained with §3.5, or part of it, with those trained without.

    where: the poses of the errors, "clips" or "validation"
    change: the training with §3.5 as the table calls it
    name: the same in words
    mean: the ending of means over intervals, "" for means over poses
    """
    comparisons = []
    for kind, (quantity, unit) in QUANTITIES.items():
        left, right = (
            evidence.number("bench_training", character, "coarse", f"{where}_{kind}_error{mean}[{training}]", words)
            for training, words in ((change, name), (RAW_ANIMATION, "raw animation"))
        )
        comparisons.append(Comparison(quantity, unit, left, right))
    return tuple(comparisons)


def _draws_and_neighbours(evidence: Evidence, character: str) -> str:
    """Return the same comparison by other means, without balancing, and on frames next to training frames."""
    sentences = []
    rare = any(key[3].startswith("clips_normal_error_expressions[") for key in evidence.rows if key[1] == character)
    for lead, *arguments in (
        *((("In the mean over poses", "clips"),) if rare else ()),
        ("Without balancing", "clips", USUAL, "augmented", *(RARE[-1:] if rare else ())),
        ("On frames whose neighbours are in the training", "validation"),
    ):
        try:
            comparisons = _augmented_against_raw(evidence, character, *arguments)
        except MissingNumber:
            continue
        sentences.append(f"{lead}: {'; '.join(map(str, comparisons))}.")
    return " ".join(sentences)


BOTH = tuple(QUANTITIES)
CLAIMS = (
    Claim(
        "C1", "The refined model beats the coarse one in both errors", "Table 2",
        "The refined model's distance error and its normal error are both smaller than the coarse model's.",
        _refined_beats_coarse, _what_refinement_does, BOTH,
    ),
    Claim(
        "C2", "Refined has the smallest normal error (for Toothless: dense)", "Table 2",
        "The refined model's normal error (on the dragon, the dense model's) is smaller than those of the other rows "
        "that the paper has in Table 2. A character that stands for none of the paper's is judged as Hiccup is.",
        _smallest_normal_error, kinds=("normal",),
    ),
    Claim(
        "C3", "Refined beats every LBS in normal error", "Table 2",
        "The refined model's normal error is smaller than that of LBS with 16, 24 and 32 bones, which sees each true "
        "test mesh.",
        _refined_beats_skins, kinds=("normal",),
    ),
    Claim(
        "C4", "LBS can match the CNN in distance and still lose the wrinkles", "Table 2, Figs. 1 and 9",
        "With 16, 24 or 32 bones LBS has a smaller distance error than the refined model, and a larger normal error. "
        "The paper says that this can happen, not that it always does: the direction is enough, and so is one rig.",
        _skin_close_without_wrinkles, kinds=BOTH, asks="direction",
    ),
    Claim(
        "C5", "Dense networks leave high-frequency noise in the normals", "§5, Fig. 10",
        "What is left of the errors beyond the lowest frequencies of the mesh, in mm, is larger with dense networks "
        "than with the refined and the coarse model, and so is its share of the whole error. The paper shows pictures "
        "and prints no number: the direction is enough. It doesn't say so of Toothless.",
        _dense_is_noisy, _dense_normals, asks="direction",
    ),
    Claim(
        "C6", f"The CNN is {SIZES[0]:g} to {SIZES[1]:g} times smaller than the dense model", "Table 1",
        f"The CNN's size is at most 1/{SIZES[0]:g} of the dense model's, which has the layers that the paper's text "
        f"gives. The claim names the size itself. More than {SIZES[1]:g} times is no failure.",
        _cnn_is_smaller, _times_as_large, asks=1 / SIZES[0],
    ),
    Claim(
        "C7", "The CNN is 5 to 17 times faster than the rig on a CPU", "Table 3",
        "On all cores, the time of the refined model with the rigid step beside the rig's, which is evaluated node by "
        "node as in the paper, then compiled as one function. Of the model the best evaluation of the same weights "
        "counts (DEVIATIONS, D27). Our rig is quicker than a studio's, so there is no verdict.",
        faster_than_the_rig, times_as_fast, asks="measured",
    ),
    Claim(
        "C8", "Dense networks are faster than the CNN", "Table 3",
        "On all cores, the dense networks take less time for a pose than the coarse and the refined model do, all with "
        "the rigid step and by the same back end. Each back end has a verdict; where they don't agree on who is "
        "faster, the claim is undecided.",
        dense_is_faster, everywhere=True,
    ),
    Claim(
        "C9", "For single poses a CPU beats a GPU of its time", "Table 3",
        "The time of the refined and the coarse model for a pose on the CPU beside that on a GPU, whose operations are "
        "started one by one as in the paper, then as a whole. The paper's GPUs are of 2014 and 2016, ours of another "
        "time than its CPU, so there is no verdict. `make table3` times ours where there is a GPU.",
        cpu_beats_gpu, on_the_papers_laptop, asks="measured",
    ),
    Claim(
        "C10", "Under inverse kinematics the CNN beats the dense networks in both errors", "Table 4",
        "In the poses that inverse kinematics finds for 25 configurations of control points (`make table4`), the "
        "refined model's distance error and its normal error are both smaller than the dense model's. Both are "
        "compared with the rig at the same parameters. As in the paper, networks that are trained through the refined "
        "model give the parameters; on the dragon each model's own networks do.",
        cnn_better_under_ik, posed_otherwise,
    ),
    Claim(
        "C11", "Rigid segments follow their attachments", "§3.4",
        "Each rigid segment, as a tooth, is placed by its attachment vertices in the true test mesh. Its vertices' "
        f"distance, in the mean over vertices and poses, beside τ = {TAU_MM:g} mm, the paper's bound of what counts as "
        "rigid in the training poses. The paper prints no number for it, so there is no verdict.",
        _rigid_within_tau, _worst_rigid, asks="measured",
    ),
    Claim(
        "C12", "Augmentation with balancing beats the raw animation", "§3.5",
        "Two coarse networks are compared on clips of which their training has no frame (`make bench-training`). The "
        "one that is trained on augmented, balanced samples has both errors smaller than the one that is trained on "
        "the animation as it is. Errors are means over the 16 intervals of the landmarks' first principal component, "
        "less the head's rigid motion, so that rare expressions count as much as frequent ones; means over poses "
        "where a result has no intervals. The paper prints no number for it: the direction is enough.",
        _augmented_beats_raw, _draws_and_neighbours, asks="direction",
    ),
    Claim(
        "C13", "The networks move meshes of another topology", "§6, Fig. 13",
        "The coarse networks are read at the texture coordinates of new meshes with half and a quarter of the vertices "
        "(`make figure13`). Their errors stand beside those of deformation transfer, which moves the same mesh by the "
        "same networks' prediction on the original one; the largest of four ratios is the number. The paper shows a "
        "picture and compares with nothing, so there is no verdict.",
        moves_other_meshes, beside_other_ways, asks="measured",
    ),
    Claim(
        "C14", "Under inverse kinematics errors on Ray stay about those of Table 2", "Tables 2 and 4",
        "The errors of the refined model in the poses of Table 4 beside those in the poses of Table 2; the larger of "
        "two ratios is the number, and 1 is as claimed. The paper draws no line beyond which errors are no longer "
        "similar, so there is no verdict. Its IK networks, and ours, may leave the controls' limits; what is left of "
        "the growth within them, and how dense networks do, is said beside it.",
        grows_under_ik, other_growths, asks="measured",
    ),
    Claim(
        "C15", "Refinement everywhere would cost much more", "§3.3",
        "The multiplications of the refined model beside those of one with squares of the same size on all of its "
        "charts, each of which costs what one costs here. The paper prints no number, so there is no verdict.",
        refined_everywhere, asks="measured",
    ),
)  # fmt: skip


OF_TRAINING = ("C1", "C2", "C3", "C4", "C5", "C10")  # what the training of the paper's networks may turn


def claim_named(name: str) -> Claim:
    """Return a claim by its number, "C1"."""
    return next(claim for claim in CLAIMS if claim.name == name)


FILE = "claims.csv"
KEY = ("claim", "character", "recipe", "place")
MOST_SHOWN = 2  # comparisons that a sentence repeats when all of them are as claimed


@dataclass(frozen=True)
class Verdict:
    """One claim's verdict on one character: a row of `claims.csv`.

    claim: its name, "C1"
    character: the character's name in results
    recipe: how the paper's networks are trained, a name of `RECIPES`
    place: the back end of a verdict on one of several, "" for the verdict on all
    stands_for: the film character that it stands for, "" for none
    verdict: one of `VERDICTS`, on our numbers
    published: the verdict of the same rule on the paper's numbers for `stands_for`; "" without one
    comparison: the deciding comparison in words; like the next ten it is empty where nothing is tested
    unit: the unit of the compared numbers
    value: the number that the claim wants below `limit`
    sd: its standard deviation, empty for one seed
    limit: the number that it is compared with
    limit_sd: the limit's standard deviation, empty for one seed
    effect: the ratio of both
    low, high: the ends of its 95 % interval, empty where no spread is known
    paper: the paper's ratio, empty where it prints none
    seeds: the fewest seeds of any number
    profile: the profile of the rows
    run: the name of their run
    results: the folder of the rows, "reference" for committed ones
    reason: why, in sentences
    """

    claim: str
    character: str
    recipe: str
    place: str
    stands_for: str
    verdict: str
    published: str
    comparison: str
    unit: str
    value: float | None
    sd: float | None
    limit: float | None
    limit_sd: float | None
    effect: float | None
    low: float | None
    high: float | None
    paper: float | None
    seeds: int | None
    profile: str
    run: str
    results: str
    reason: str


NUMBERS = ("value", "sd", "limit", "limit_sd", "effect", "low", "high", "paper")
SCHEMA = (
    *map(Column, KEY[:2]),
    Column("recipe", choices=tuple(recipe.name for recipe in RECIPES)),
    Column("place", optional=True),
    Column("stands_for", optional=True),
    Column("verdict", choices=VERDICTS),
    Column("published", optional=True, choices=VERDICTS),
    Column("comparison", optional=True),
    Column("unit", optional=True, choices=UNITS),
    *(Column(name, "finite number", optional=True) for name in NUMBERS),
    Column("seeds", "whole number", optional=True),
    *(Column(name, optional=True) for name in ("profile", "run", "results")),
    Column("reason"),
)


def judge(claim: Claim, character: str, evidence: Evidence, paper: Evidence, place: str = "") -> Verdict:
    """Judge a claim on one character.

    paper: the paper's numbers
    place: the one of several places that is judged; "" for all, which must agree
    """
    theirs = stand_in(character)
    of_theirs = published_verdict(claim, theirs, paper) if theirs else ""
    try:
        ways = claim.ways(evidence, character)
        ways = tuple(tuple(each for each in way if place in ("", each.where)) for way in ways)
        verdict, way, deciding = _decide(claim, ways, character, evidence, paper)
    except MissingNumber as missing:
        return _untested(claim, character, evidence.recipe.name, theirs, of_theirs, str(missing))
    remarks = [remark(claim, evidence, character), line_remark(claim, evidence, character)]
    numbers = [number for judged in way for number in judged.comparison.numbers]
    rows = [row for number in numbers for row in number.rows]
    seeds = [row.seeds for row in rows if row.seeds]
    comparison, effect = deciding.comparison, deciding.effect
    known = math.isfinite(effect.half)
    return Verdict(
        claim.name,
        character,
        evidence.recipe.name,
        place,
        theirs,
        verdict,
        of_theirs,
        comparison.name,
        comparison.unit,
        comparison.left.value,
        comparison.left.sd,
        comparison.right.value,
        comparison.right.sd,
        effect.ratio,
        effect.low if known else None,
        effect.high if known else None,
        deciding.paper,
        min(seeds) if seeds else None,
        ", ".join(sorted({row.profile for row in rows})),
        ", ".join(sorted({row.run for row in rows})),
        evidence.place(rows),
        " ".join(filter(None, [in_words(verdict, way, deciding, claim.everywhere), *remarks])),
    )


def _untested(claim: Claim, character: str, recipe: str, theirs: str, of_theirs: str, why: str) -> Verdict:
    nothing = dict.fromkeys(NUMBERS)
    words = dict.fromkeys(("comparison", "unit", "profile", "run", "results"), "")
    head = {"claim": claim.name, "character": character, "recipe": recipe, "place": "", "stands_for": theirs}
    return Verdict(**head, verdict=NOT_TESTED, published=of_theirs, **words, **nothing, seeds=None, reason=why)


def _decide(
    claim: Claim, ways: Ways, character: str, evidence: Evidence, paper: Evidence
) -> tuple[str, Sequence[Judged], Judged]:
    """Return the verdict, the way that is closest to holding and its deciding comparison, as `decide` does."""
    judged = [[_judged(claim, each, character, evidence, paper) for each in way] for way in ways]
    if claim.asks == MEASURED:
        (way,) = judged
        return MEASURED, way, way[0]
    return decide_everywhere(judged[0]) if claim.everywhere else decide(judged)


def _judged(claim: Claim, comparison: Comparison, character: str, evidence: Evidence, paper: Evidence) -> Judged:
    effect = comparison.effect(evidence.borrowed(claim.ways, comparison))
    theirs = papers_effects(claim, paper)
    own = theirs.get(stand_in(character), {}).get(comparison.key)
    claimed = [ratio for each in theirs.values() if (ratio := each.get(comparison.key, 1.0)) < 1]
    if claim.asks == "paper":
        model = own if own is not None and own < 1 else max(claimed, default=1.0)
        least = HALF * math.log(model)
    else:
        least = 0.0 if isinstance(claim.asks, str) else math.log(claim.asks)
    return Judged(comparison, effect, own, verdict_of(effect, least))


def papers_effects(claim: Claim, paper: Evidence) -> dict[str, dict[str, float]]:
    """Return the paper's ratios for a claim: its character → a comparison's `key` → ratio."""
    found = {}
    for character in STANDS_FOR.values():
        with suppress(MissingNumber):
            ways = claim.ways(paper, character)
            found[character] = {each.key: each.ratio for way in ways for each in way}
    return found


def judge_all(evidence: Evidence, paper: Evidence) -> list[Verdict]:
    """Judge all claims on the stand-ins for the paper's four characters and all others in Table 2.

    Claims about trained networks are judged for the recipes as printed too, where these have been trained, and claims
    about several places for each of them.
    """
    verdicts = []
    trained = [evidence.trained(recipe) for recipe in PRINTED]
    for claim in CLAIMS:
        for character in evidence.characters():
            verdicts.append(judge(claim, character, evidence, paper))
            if claim.everywhere and verdicts[-1].verdict != NOT_TESTED:
                places = dict.fromkeys(each.where for way in claim.ways(evidence, character) for each in way)
                verdicts += [judge(claim, character, evidence, paper, place) for place in places]
            if claim.name in OF_TRAINING:
                printed = (judge(claim, character, each, paper) for each in trained)
                verdicts += [verdict for verdict in printed if verdict.verdict != NOT_TESTED]
    return verdicts


def papers_effect(claim: Claim, character: str, paper: Evidence) -> float | None:
    """Return the ratio that decides a claim on the paper's numbers for one of its characters, or None."""
    try:
        return _decide(claim, claim.ways(paper, character), character, paper, paper)[2].effect.ratio
    except MissingNumber:
        return None


def published_verdict(claim: Claim, character: str, paper: Evidence) -> str:
    """Judge a claim on the paper's numbers for one of its characters."""
    try:
        return _decide(claim, claim.ways(paper, character), character, paper, paper)[0]
    except MissingNumber:
        return NOT_TESTED


def in_words(verdict: str, way: Sequence[Judged], deciding: Judged, everywhere: bool) -> str:
    """Return the comparisons that decide, in words: those that fall short or else all; where there are many, one.

    everywhere: whether `way` has one of each place; then all are said, each with its verdict
    """
    if everywhere and len({judged.comparison.where for judged in way}) > 1:
        lead = "Depends on the back end: " if len({judged.verdict for judged in way}) > 1 else ""
        text = lead + "; ".join(f"{judged.comparison.where} {judged.verdict}, {judged}" for judged in way)
    else:
        short = [judged for judged in way if judged.verdict == deciding.verdict and verdict not in (HOLDS, MEASURED)]
        shown = short or (way if len(way) <= MOST_SHOWN else [deciding])
        shown = sorted(shown, key=lambda judged: judged.rank)[:MOST_SHOWN] if len(shown) > MOST_SHOWN else shown
        shown = way if verdict == MEASURED else shown
        lead = f"closest of {len(way)}, " if len(shown) < len(way) and not short else ""
        text = lead + "; ".join(map(str, shown))
    caveats = dict.fromkeys(judged.caveat for judged in way if judged.caveat and verdict != MEASURED)
    text += "".join(f"; {caveat}" for caveat in caveats)
    return f"{text[0].upper()}{text[1:]}."


def remark(claim: Claim, evidence: Evidence, character: str) -> str:
    """Return a claim's remark, or "" where a number for it is missing."""
    try:
        return claim.remark(evidence, character)
    except MissingNumber:
        return ""


def line_remark(claim: Claim, evidence: Evidence, character: str) -> str:
    """Return which of the paper's networks a straight line (`linear`) beats in the claim's errors, or ""."""
    sentences = []
    for kind in claim.kinds:
        beaten = beaten_by_line(evidence, character, kind)
        if beaten:
            quantity, unit = QUANTITIES[kind]
            value = significant(evidence.error(character, "linear", kind).value)
            names = " and ".join(filter(None, [", ".join(beaten[:-1]), beaten[-1]]))
            sentences.append(f"A straight line has a smaller {quantity} than {names}: {value}{SIGNS[unit]}.")
    return " ".join(sentences)


def beaten_by_line(evidence: Evidence, character: str, kind: str) -> list[str]:
    """Return the paper's networks whose mean error is larger than a straight line's, by the whole interval.

    kind: "vertex" or "normal". Networks without a row are left out; of single runs the numbers are taken as they are.
    """
    beaten = []
    for network in NETWORKS:
        try:
            effect = smaller_error(evidence, character, "linear", network, kind).effect()
            if effect.log + (effect.half if math.isfinite(effect.half) else 0.0) < 0:
                beaten.append(network)
        except MissingNumber:
            continue
    return beaten


def write_verdicts(path: Path, verdicts: Iterable[Verdict]) -> None:
    """Write verdicts in the order of `judge_all`: by claim, then by character."""
    write_csv(path, SCHEMA, map(astuple, verdicts), KEY)


def verdict_frame(path: Path) -> "pandas.DataFrame":
    """Read `claims.csv` as a DataFrame, one verdict a row. Raises InputError, with file and line, for other files."""
    return read_csv(path, SCHEMA, KEY, missing="there are no such verdicts; `make claims` writes them.")


def read_verdicts(path: Path) -> list[Verdict]:
    """Read `claims.csv` as `Verdict`s. Raises InputError as `verdict_frame` does."""
    frame = verdict_frame(path).astype(object)
    names = [field.name for field in fields(Verdict)]
    lines = frame.where(frame.notna(), None)[names].itertuples(index=False, name=None)
    return [Verdict(*cells) for cells in lines]
