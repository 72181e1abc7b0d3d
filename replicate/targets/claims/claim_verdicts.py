"""Verdicts on the claims: judged from rows, one for each claim and character, kept in `claims.csv`."""

from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.engine.tidy_files import Column, read_csv, write_csv
from replicate.report.results import UNITS
from replicate.targets.claims.evidence import QUANTITIES, Evidence, MissingNumber, stand_in
from replicate.targets.claims.paper_claims import CLAIMS, NETWORKS, Claim, smaller_error
from replicate.targets.claims.verdict_rules import UNITS as SIGNS
from replicate.targets.claims.verdict_rules import Comparison, decide, significant

if TYPE_CHECKING:
    import pandas

FILE = "claims.csv"
HOLDS, FAILS, NOT_TESTED = "holds", "fails", "not tested"
VERDICTS = (HOLDS, FAILS, NOT_TESTED)
KEY = ("claim", "character")
MOST_SHOWN = 2  # comparisons that a sentence repeats when all of them are satisfied


@dataclass(frozen=True)
class Verdict:
    """One claim's verdict on one character: a row of `claims.csv`.

    stands_for: the film character, "" for none. verdict, published: one of `VERDICTS`, on our numbers and by the same
    rule on the paper's own for `stands_for`; published is "" where that is nobody. comparison, unit, value, sd, limit,
    limit_sd: the comparison with the smallest margin, which decides; the claim wants `value` below `limit`. They are
    empty where nothing is tested, and the deviations for one seed too. seeds: the fewest of any number. profile, run:
    of the rows. results: the folder that they are from, "reference" for committed ones. reason: why, in sentences.
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
    """Return a claim's verdict on one character. paper: the paper's own numbers."""
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
    """Return the verdicts of all claims on the paper's four characters and the others that Table 2 has."""
    return [judge(claim, character, evidence, paper) for claim in CLAIMS for character in evidence.characters()]


def published_verdict(claim: Claim, character: str, paper: Evidence) -> str:
    """Return what a claim's rule says of the paper's own numbers for one of its characters."""
    try:
        holds, *_ = decide(claim.ways(paper, character))
    except MissingNumber:
        return NOT_TESTED
    return HOLDS if holds else FAILS


def in_words(way: Sequence[Comparison], deciding: Comparison) -> str:
    """Return the comparisons that decide: those that aren't satisfied, or all; of many only the closest."""
    failing = [comparison for comparison in way if not comparison.satisfied]
    shown = failing or (way if len(way) <= MOST_SHOWN else [deciding])
    lead = f"closest of {len(way)}, " if len(shown) < len(way) and not failing else ""
    text = lead + "; ".join(map(str, shown))
    return f"{text[0].upper()}{text[1:]}."


def remark(claim: Claim, evidence: Evidence, character: str) -> str:
    """Return what a claim says beside its verdict, or "" where a number is missing that only this needs."""
    try:
        return claim.remark(evidence, character)
    except MissingNumber:
        return ""


def line_remark(claim: Claim, evidence: Evidence, character: str) -> str:
    """Return in which of a claim's errors a straight line, `linear`, beats which of the paper's networks; or ""."""
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
    """Return the paper's networks whose mean error is larger than a straight line's, by the rule of all claims.

    kind: "vertex" or "normal". What has no row is not among them.
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
    """Write verdicts, in the order of the claims and of the paper's characters, as `judge_all` returns them."""
    write_csv(path, SCHEMA, map(astuple, verdicts), KEY)


def verdict_frame(path: Path) -> "pandas.DataFrame":
    """Read `claims.csv` as a DataFrame, a verdict a row. Raises InputError, with file and line, for anything else."""
    return read_csv(path, SCHEMA, KEY, missing="there are no such verdicts; `make claims` writes them.")


def read_verdicts(path: Path) -> list[Verdict]:
    """Read `claims.csv` as `Verdict`s. Raises InputError as `verdict_frame` does."""
    frame = verdict_frame(path).astype(object)
    names = [field.name for field in fields(Verdict)]
    lines = frame.where(frame.notna(), None)[names].itertuples(index=False, name=None)
    return [Verdict(*cells) for cells in lines]
