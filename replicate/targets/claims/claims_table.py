"""The verdicts, printed: claims against characters, and why."""

from collections.abc import Sequence
from pathlib import Path

from replicate.report.cast import STANDS_FOR, characters_of, order_of
from replicate.report.notebooks import folder_of
from replicate.report.results import Row, seeds_in_words
from replicate.report.tables import Table
from replicate.targets.claims.claim_verdicts import (
    FAILS,
    HOLDS,
    NOT_TESTED,
    Verdict,
    beaten_by_line,
    judge,
    judge_all,
    read_verdicts,
)
from replicate.targets.claims.evidence import Evidence, MissingNumber, gather, published
from replicate.targets.claims.paper_claims import CLAIMS, Claim, claim_named, smaller_error
from replicate.targets.claims.verdict_rules import SPREADS, significant

OF_TABLE2 = ("C1", "C2", "C3", "C4", "C5")
CLOSE = 0.02  # share of a limit: a verdict of one seed that is nearer to it is marked
NARROW = 0.05  # share of a limit: any verdict that is nearer to it is marked
NARROW_TIME = 0.1  # the same of times, which repeat less exactly


def claims_table(verdicts: Sequence[Verdict], evidence: Evidence, claims: Sequence[Claim] = CLAIMS) -> Table:
    """Return a line for each claim and a column for each character, with footnotes on what qualifies a verdict.

    Variants of a character, as teen@one_face, are left out. evidence: what the verdicts are from, for the line. claims:
    those that are shown.
    """
    names = [claim.name for claim in claims]
    by_key = {(one.claim, one.character): one for one in verdicts if "@" not in one.character and one.claim in names}
    characters = sorted({character for _, character in by_key}, key=order_of)
    cells = {key: cell(one) for key, one in by_key.items()}
    body = tuple(
        (f"{claim.name} {claim.text}", *(cells.get((claim.name, character), "–") for character in characters))
        for claim in claims
    )
    marks = "".join(cells.values())
    notes = [about(list(by_key.values()))]
    if "†" in marks:
        notes.append("† By the same rule the paper's own numbers fail too, for the character that it stands for.")
    if "‡" in marks:
        share = f"{CLOSE:.0%}".replace("%", " %")
        notes.append(f"‡ Decided by less than {share} on a single seed or run of times: another may turn it.")
    if "≈" in marks:
        shares = f"{NARROW:.0%}, times by less than {NARROW_TIME:.0%}".replace("%", " %")
        notes.append(f"≈ Narrowly: the two numbers that decide differ by less than {shares}.")
    notes += line_notes(evidence, characters)
    if "–" in cells.values():
        notes.append("–: not tested; `claims.csv` has the reason of each.")
    header = ("", *(_heading(name, list(by_key.values())) for name in characters))
    title = "What the paper claims, on our characters"
    return Table(title, (header,), body, tuple(notes), text_columns=len(header))


def _heading(character: str, verdicts: Sequence[Verdict]) -> str:
    """Return a column's heading: whom a character stands for, or on which profile it was run where others ran on more.

    A short training decides less than a long one, so that a reader must see which it was.
    """
    if character in STANDS_FOR:
        return f"{character} ({STANDS_FOR[character]})"
    own, every = (
        {one.profile for one in verdicts if one.verdict != NOT_TESTED and one.character in who}
        for who in ([character], [one.character for one in verdicts])
    )
    return f"{character} ({', '.join(sorted(own))})" if own and own != every else character


def verdicts_of_table2(name: str) -> Table:
    """Return the verdicts on the claims about Table 2, C1 to C5, judged on some results' own rows.

    name: "reference", or the profile of a run; its `claims.csv` need not be there.
    """
    evidence = gather([folder_of(name)])
    claims = [claim for claim in CLAIMS if claim.name in OF_TABLE2]
    characters = {row.character for row in evidence.rows.values() if row.table == "table2"}
    verdicts = [one for one in judge_all(evidence, published()) if one.character in characters]
    return claims_table(verdicts, evidence, claims)


def overview(file: Path) -> Table:
    """Return the table of a folder's `claims.csv`. Raises InputError for a file that holds no verdicts."""
    return claims_table(read_verdicts(file), gather([file.parent]))


def cell(one: Verdict) -> str:
    """Return a verdict with the marks of its notes."""
    if one.verdict == NOT_TESTED:
        return "–"
    marks = [one.verdict]
    if one.verdict == one.published == FAILS:
        marks.append("†")
    share = abs(one.limit - one.value) / abs(one.limit) if one.limit else 1.0
    if one.seeds == 1 and share < CLOSE:
        marks.append("‡")
    elif share < (NARROW_TIME if one.unit == "ms" else NARROW):
        marks.append("≈")
    return " ".join(marks)


def about(verdicts: Sequence[Verdict]) -> str:
    """Return which profile the verdicts are of, and on how many seeds they stand."""
    tested = [one for one in verdicts if one.verdict != NOT_TESTED]
    if not tested:
        return "Nothing is tested yet."
    seeds = [one.seeds for one in tested if one.seeds]
    if max(seeds, default=1) == 1:
        how = "one seed: numbers are compared as they are"
    else:
        count = seeds_in_words(seeds)
        how = (
            f"{count}: a difference counts if it is larger than {SPREADS:g} times its standard deviation over the seeds"
        )
    return f"Profile {', '.join(sorted({one.profile for one in tested}))}; {how}."


def line_notes(evidence: Evidence, characters: Sequence[str]) -> list[str]:
    """Return on which characters a straight line has smaller normal errors than which of the paper's networks."""
    notes = []
    for character in characters:
        if beaten := beaten_by_line(evidence, character, "normal"):
            line, *networks = (
                significant(evidence.error(character, name, "normal").value) for name in ("linear", *beaten)
            )
            others = ", ".join(f"{value}° ({name})" for name, value in zip(beaten, networks, strict=True))
            subject = "A straight line (ridge regression) has smaller normal errors"
            notes.append(f"{subject} on {character}: {line}° against {others}.")
    return notes


def claim_text(name: str) -> str:
    """Return a claim, where the paper has it, and when it holds, in Markdown. name: "C1"."""
    claim = claim_named(name)
    return f"**{claim.text}** ({claim.where}). *It holds if:* {claim.rule}"


def reasons_table(verdicts: Sequence[Verdict], claim: str) -> Table:
    """Return one claim's verdicts with their reasons, a character a line, the paper's own verdict beside ours."""
    body = tuple((one.character, one.verdict, _of_the_paper(one), one.reason) for one in verdicts if one.claim == claim)
    header = ("", "verdict", "paper's numbers", "why")
    return Table(f"{claim}, character by character", (header,), body, text_columns=4)


def verdict_on_rows(rows: Sequence[Row], claim: str) -> Table:
    """Return the verdict on one claim for each character that some rows of a table are about, with its reason."""
    evidence, paper = Evidence(rows), published()
    verdicts = [judge(claim_named(claim), character, evidence, paper) for character in characters_of(rows)]
    return reasons_table(verdicts, claim)


def comparison_table(evidence: Evidence, method: str, other: str, kind: str) -> Table:
    """Return whether one method's mean error is smaller than another's, by the rule of the claims, for each character.

    kind: "vertex" or "normal". What lacks a number is not tested.
    """
    body = []
    for character in evidence.characters():
        try:
            comparison = smaller_error(evidence, character, method, other, kind)
            body.append((character, HOLDS if comparison.satisfied else FAILS, f"{comparison}"))
        except MissingNumber as missing:
            body.append((character, NOT_TESTED, f"{missing}"))
    return Table(f"Is {method} below {other}?", (("", "verdict", "why"),), tuple(body), text_columns=3)


def _of_the_paper(one: Verdict) -> str:
    return f"{one.published} ({one.stands_for})" if one.published in (HOLDS, FAILS) else "–"
