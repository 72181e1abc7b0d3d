"""The paper's claims C1 to C13, each with the rule that judges it, and the verdicts on results."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.base.tables import Column, read_csv, write_csv
from replicate.benchmarks.bench_training import BALANCED, RAW_ANIMATION, USUAL
from replicate.config import RigidConfig
from replicate.report.results import UNITS
from replicate.targets.claims.rules import (
    LEAST_SPEED_UP,
    MOST_SPEED_UP,
    QUANTITIES,
    SEGMENTS,
    Comparison,
    Evidence,
    MissingNumber,
    Number,
    Ways,
    beside_other_ways,
    cnn_better_under_ik,
    cpu_beats_gpu,
    decide,
    dense_is_faster,
    faster_than_the_rig,
    moves_other_meshes,
    posed_otherwise,
    significant,
    stand_in,
    started_one_by_one,
    times_as_fast,
)
from replicate.targets.claims.rules import UNITS as SIGNS
from replicate.targets.table1.tables import CLAIM as SIZES

if TYPE_CHECKING:
    import pandas


# The paper's claims C1 to C13, and the comparisons that decide them.

NETWORKS = ("coarse", "refined", "dense")
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
    rule: when it holds, in words
    ways: (evidence, character) → the comparisons that it needs; raises MissingNumber
    remark: (evidence, character) → sentences beside the verdict, or ""; MissingNumber leaves the verdict as it is
    kinds: errors, keys of `QUANTITIES`, in which a straight line is compared with the networks, beside the verdict
    """

    name: str
    text: str
    where: str
    rule: str
    ways: Callable[[Evidence, str], Ways]
    remark: Callable[[Evidence, str], str] = no_remark
    kinds: tuple[str, ...] = ()


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
        close = Comparison(*QUANTITIES["vertex"], *distances, "matches")
        ways.append((close, smaller_error(evidence, character, "refined", skin, "normal")))
    return tuple(ways)


def _dense_normals_are_worst(evidence: Evidence, character: str) -> Ways:
    return (tuple(smaller_error(evidence, character, network, "dense", "normal") for network in ("refined", "coarse")),)


def _degrees_per_mm(evidence: Evidence, character: str) -> str:
    """Return the normal error per mm of distance, in a sentence: finer errors have more degrees per mm."""
    shares = {}
    for method in ("dense", "refined"):
        distance, normal = (evidence.error(character, method, kind).value for kind in QUANTITIES)
        shares[method] = f"{significant(normal / distance, 2)}° ({method})" if distance else f"– ({method})"
    better = all(
        smaller_error(evidence, character, "dense", other, "normal").satisfied for other in ("refined", "coarse")
    )
    lead = "Dense does not fail here: its normal error is the smallest of the three. " if better else ""
    hint = "Degrees of normal error per mm of distance, more for finer errors"
    return f"{lead}{hint}: {shares['dense']} and {shares['refined']}."


def _sizes(evidence: Evidence, character: str) -> tuple[Number, Number]:
    small = evidence.number("table1", character, "refined", "model_size", "the CNN")
    return small, evidence.number("table1", character, "dense", "model_size")


def _cnn_is_smaller(evidence: Evidence, character: str) -> Ways:
    small, dense = _sizes(evidence, character)
    least = small.times(SIZES[0], f"{SIZES[0]:g} × the CNN")
    return ((Comparison("size", "MB", least, dense, "at most"),),)


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
    return ((Comparison("distance", "mm", mean, Number("τ", TAU_MM), "at most"),),)


def _worst_rigid(evidence: Evidence, character: str) -> str:
    tails = (evidence.number(SEGMENTS, character, "attachment", f"vertex_error_{s}[rigid]") for s in ("p95", "max"))
    p95, most = (significant(number.value) for number in tails)
    return f"The 95th percentile over their vertices and the test poses is {p95} mm, the maximum {most} mm."


def _augmented_beats_raw(evidence: Evidence, character: str) -> Ways:
    if stand_in(character) == "Ray":
        raise MissingNumber(
            "This rig has no animation, as Ray's: its poses are uniform draws, and nothing is augmented."
        )
    return (_augmented_against_raw(evidence, character, "clips"),)


def _augmented_against_raw(
    evidence: Evidence, character: str, where: str, change: str = BALANCED, name: str = "augmented and balanced"
) -> tuple[Comparison, ...]:
    """Compare both errors of coarse networks that were trained with §3.5, or part of it, with those trained without.

    where: the poses of the errors, "clips" or "validation"
    change: the training with §3.5 as the table calls it
    name: the same in words
    """
    comparisons = []
    for kind, (quantity, unit) in QUANTITIES.items():
        left, right = (
            evidence.number("bench_training", character, "coarse", f"{where}_{kind}_error[{training}]", words)
            for training, words in ((change, name), (RAW_ANIMATION, "raw animation"))
        )
        comparisons.append(Comparison(quantity, unit, left, right))
    return tuple(comparisons)


def _draws_and_neighbours(evidence: Evidence, character: str) -> str:
    """Return the same comparison without balancing, and on frames next to training frames, in sentences."""
    sentences = []
    for lead, *arguments in (
        ("Without balancing", "clips", USUAL, "augmented"),
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
        "The refined model's distance error and its normal error are both smaller.",
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
        "With 16, 24 or 32 bones LBS has a distance error no larger than the refined model's, and a larger normal "
        "error. The paper says that this can happen, not that it always does.",
        _skin_close_without_wrinkles, kinds=BOTH,
    ),
    Claim(
        "C5", "Dense networks leave high-frequency noise in the normals", "§5, Fig. 10",
        "The dense networks' normal error is larger than the refined and the coarse model's. Coarse maps lose fine "
        "detail, so whoever is worse than they are adds wrong detail. A mean can't show frequency; the heatmaps of "
        "Figure 10 can.",
        _dense_normals_are_worst, _degrees_per_mm, ("normal",),
    ),
    Claim(
        "C6", f"The CNN is {SIZES[0]:g} to {SIZES[1]:g} times smaller than the dense model", "Table 1",
        f"The dense model, with the layers that the paper's text gives, is at least {SIZES[0]:g} times as large as the "
        f"CNN. More than {SIZES[1]:g} times is no failure.",
        _cnn_is_smaller, _times_as_large,
    ),
    Claim(
        "C7", f"The CNN is {LEAST_SPEED_UP} to {MOST_SPEED_UP} times faster than the rig on a CPU", "Table 3",
        f"On all cores, the refined model with the rigid step is at least {LEAST_SPEED_UP} times as fast as the rig. "
        "Our rigs are evaluated node by node, and compiled as one function; the claim must hold for both. Of the model "
        "the best evaluation of the same weights counts (DEVIATIONS, D27). "
        f"More than {MOST_SPEED_UP} times is no failure.",
        faster_than_the_rig, times_as_fast,
    ),
    Claim(
        "C8", "Dense networks are faster than the CNN", "Table 3",
        "On all cores, the dense networks take less time for a pose than the coarse and the refined model do, all "
        "with the rigid step, each by the best evaluation of its weights (DEVIATIONS, D27).",
        dense_is_faster,
    ),
    Claim(
        "C9", "For single poses a CPU beats a GPU of its time", "Table 3",
        "The coarse and the refined model take less time for a pose on the CPU than on a GPU, each by the best "
        "evaluation of its weights. The paper's GPUs are of 2014 and 2016. `make table3` times ours where there is a "
        "GPU.",
        cpu_beats_gpu, started_one_by_one,
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
        "C11", f"Rigid segments follow their attachments to within {TAU_MM:g} mm", "§3.4",
        "Each rigid segment, as a tooth, is placed by its attachment vertices in the true test mesh. Its vertices are "
        f"then at most τ = {TAU_MM:g} mm off, in the mean over vertices and poses. The paper prints no number for it.",
        _rigid_within_tau, _worst_rigid,
    ),
    Claim(
        "C12", "Augmentation with balancing beats the raw animation", "§3.5",
        "Two coarse networks are compared on clips of which their training has no frame (`make bench-training`). The "
        "one that is trained on augmented, balanced samples has both errors smaller than the one that is trained on "
        "the animation as it is. The paper prints no number for it.",
        _augmented_beats_raw, _draws_and_neighbours,
    ),
    Claim(
        "C13", "The networks move meshes of another topology", "§6, Fig. 13",
        "The coarse networks are read at the texture coordinates of new meshes with half and a quarter of the vertices "
        "(`make figure13`). Both errors there are smaller than those of deformation transfer, which moves the same "
        "mesh by the same networks' prediction on the original one. The paper shows a picture and prints no number.",
        moves_other_meshes, beside_other_ways,
    ),
)  # fmt: skip


def claim_named(name: str) -> Claim:
    """Return a claim by its number, "C1"."""
    return next(claim for claim in CLAIMS if claim.name == name)


FILE = "claims.csv"
HOLDS, FAILS, NOT_TESTED = "holds", "fails", "not tested"
VERDICTS = (HOLDS, FAILS, NOT_TESTED)
KEY = ("claim", "character")
MOST_SHOWN = 2  # comparisons that a sentence repeats when all of them are satisfied


@dataclass(frozen=True)
class Verdict:
    """One claim's verdict on one character: a row of `claims.csv`.

    claim: its name, "C1"
    character: the character's name in results
    stands_for: the film character that it stands for, "" for none
    verdict: one of `VERDICTS`, on our numbers
    published: the verdict of the same rule on the paper's numbers for `stands_for`; "" without one
    comparison: the deciding comparison in words; like the next five it is empty where nothing is tested
    unit: the unit of the compared numbers
    value: the number that the claim wants below `limit`
    sd: its standard deviation, empty for one seed
    limit: the number that it is compared with
    limit_sd: the limit's standard deviation, empty for one seed
    seeds: the fewest seeds of any number
    profile: the profile of the rows
    run: the name of their run
    results: the folder of the rows, "reference" for committed ones
    reason: why, in sentences
    """

    claim: str
    character: str
    stands_for: str
    verdict: str
    published: str
    comparison: str
    unit: str
    value: float | None
    sd: float | None
    limit: float | None
    limit_sd: float | None
    seeds: int | None
    profile: str
    run: str
    results: str
    reason: str


SCHEMA = (
    *map(Column, KEY),
    Column("stands_for", optional=True),
    Column("verdict", choices=VERDICTS),
    Column("published", optional=True, choices=VERDICTS),
    Column("comparison", optional=True),
    Column("unit", optional=True, choices=UNITS),
    *(Column(name, "finite number", optional=True) for name in ("value", "sd", "limit", "limit_sd")),
    Column("seeds", "whole number", optional=True),
    *(Column(name, optional=True) for name in ("profile", "run", "results")),
    Column("reason"),
)


def judge(claim: Claim, character: str, evidence: Evidence, paper: Evidence) -> Verdict:
    """Judge a claim on one character. paper: the paper's numbers."""
    theirs = stand_in(character)
    head = (claim.name, character, theirs)
    published = published_verdict(claim, theirs, paper) if theirs else ""
    try:
        holds, way, deciding = decide(claim.ways(evidence, character))
    except MissingNumber as missing:
        return Verdict(*head, NOT_TESTED, published, "", "", None, None, None, None, None, "", "", "", str(missing))
    remarks = [remark(claim, evidence, character), line_remark(claim, evidence, character)]
    rows = [row for comparison in way for number in (comparison.left, comparison.right) for row in number.rows]
    seeds = [row.seeds for row in rows if row.seeds]
    return Verdict(
        *head,
        HOLDS if holds else FAILS,
        published,
        deciding.name,
        deciding.unit,
        deciding.left.value,
        deciding.left.sd,
        deciding.right.value,
        deciding.right.sd,
        min(seeds) if seeds else None,
        ", ".join(sorted({row.profile for row in rows})),
        ", ".join(sorted({row.run for row in rows})),
        evidence.place(rows),
        " ".join(filter(None, [in_words(way, deciding), *remarks])),
    )


def judge_all(evidence: Evidence, paper: Evidence) -> list[Verdict]:
    """Judge all claims on the stand-ins for the paper's four characters and all others in Table 2."""
    return [judge(claim, character, evidence, paper) for claim in CLAIMS for character in evidence.characters()]


def published_verdict(claim: Claim, character: str, paper: Evidence) -> str:
    """Judge a claim on the paper's numbers for one of its characters."""
    try:
        holds, *_ = decide(claim.ways(paper, character))
    except MissingNumber:
        return NOT_TESTED
    return HOLDS if holds else FAILS


def in_words(way: Sequence[Comparison], deciding: Comparison) -> str:
    """Return the comparisons that fail, in words, or else all of them; where there are many, the closest alone."""
    failing = [comparison for comparison in way if not comparison.satisfied]
    shown = failing or (way if len(way) <= MOST_SHOWN else [deciding])
    lead = f"closest of {len(way)}, " if len(shown) < len(way) and not failing else ""
    text = lead + "; ".join(map(str, shown))
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
    """Return the paper's networks whose mean error is clearly larger than a straight line's.

    kind: "vertex" or "normal". Networks without a row are left out.
    """
    beaten = []
    for network in NETWORKS:
        try:
            if smaller_error(evidence, character, "linear", network, kind).satisfied:
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
