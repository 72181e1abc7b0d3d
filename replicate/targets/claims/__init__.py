"""Judge the paper's claims for every character by their effects, with the numbers that decide."""

import argparse
import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.base.exceptions import InputError
from replicate.base.paths import REFERENCE, display_path
from replicate.config import PROFILES, check_profile
from replicate.drawing.panels import DPI, WIDTH, Words, tidy
from replicate.engine.provenance import as_lines
from replicate.methods.method_registry import method_named
from replicate.report import notebooks
from replicate.report.notebooks import folder_of, provenance_text, run_notebook
from replicate.report.publication import alone, results_folder
from replicate.report.results import STANDS_FOR, Row, characters_of, order_of, seeds_in_words
from replicate.report.tables import Table, as_latex, as_text, unbroken
from replicate.targets.claims.rules import (
    BEST,
    DIRECTION,
    ENOUGH,
    FAILS,
    HOLDS,
    MEASURED,
    NETWORKS,
    NOT_TESTED,
    ONE_RUN,
    PRINTED,
    RANKS,
    RECIPES,
    RULE,
    UNDECIDED,
    Comparison,
    Effect,
    Evidence,
    MissingNumber,
    Recipe,
    difference,
    folders_of,
    gather,
    published,
    significant,
    stand_in,
    verdict_of,
)
from replicate.targets.claims.verdicts import (
    CLAIMS,
    FILE,
    Claim,
    Verdict,
    beaten_by_line,
    claim_named,
    judge,
    judge_all,
    papers_effect,
    read_verdicts,
    smaller_error,
    verdict_frame,
    write_verdicts,
)
from replicate.targets.table3 import GPU_TABLE

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas


def run(options: argparse.Namespace) -> None:
    """Judge the claims on a profile's results, and on the committed ones where it has none; write and print them."""
    check_profile(options.profile)
    publish(options.profile, options.latex)


# `make claims`: the verdicts on a profile's results, in its folder and printed.


def publish(profile: str, latex: bool = False) -> None:
    """Judge the claims, write the verdicts to the profile's folder, print them, and execute their notebook if stale.

    latex: print the table as LaTeX, without reasons. Raises InputError for a file that is no table of results.
    """
    evidence = gather(folders_of(profile))
    folder = results_folder(profile)
    with alone(folder):
        verdicts = write_claims(folder, evidence)
        run_notebook("claims", profile)
    table = claims_table(verdicts, evidence)
    if latex:
        print(as_latex(table))
        return
    print(as_text(for_terminal(table)))
    profiles = _profiles(verdicts)
    for verdict in verdicts:
        if verdict.verdict != NOT_TESTED:
            whose = _with_profile(verdict.character, verdict.profile, profiles)
            whose += "" if verdict.recipe == BEST.name else f", {_recipe(verdict).words}"
            whose += f", {verdict.place}" if verdict.place else ""
            print(_in_lines(f"{verdict.claim} {whose}: {verdict.verdict}. {verdict.reason}"))
    print(f"\n{_in_lines(origin(verdicts))}")
    print(f"written to {display_path(folder)}: {FILE}, and claims.ipynb to read it in")


def write_claims(folder: Path, evidence: Evidence) -> list[Verdict]:
    """Judge all claims, write the verdicts to a folder and return them."""
    verdicts = judge_all(evidence, published())
    write_verdicts(folder / FILE, verdicts)
    return verdicts


def origin(verdicts: list[Verdict]) -> str:
    """Return which folders of results the verdicts come from, and for which characters, in words."""
    folders: dict[str, list[str]] = {}
    for verdict in verdicts:
        if verdict.results:
            folders.setdefault(verdict.results, []).append(verdict.character)
    lines = (f"{name}: {', '.join(dict.fromkeys(characters))}" for name, characters in sorted(folders.items()))
    committed = f" ({REFERENCE.name} is what the project comes with)" if REFERENCE.name in folders else ""
    return f"numbers from {'; '.join(lines)}{committed}" if folders else "no numbers to judge by are there yet"


# For the notebook about the claims: the verdicts of a folder of results, the numbers behind them, their origin.


@dataclass(frozen=True)
class OpenClaims:
    """The verdicts of some results, as objects and as a DataFrame, and the evidence: our numbers and the paper's."""

    verdicts: list[Verdict]
    frame: "pandas.DataFrame"
    ours: Evidence
    paper: Evidence


def open_claims(name: str) -> OpenClaims:
    """Open the verdicts of some results. name: "reference", or the profile of a run.

    Raises InputError, with the target that writes them, where there are none.
    """
    file = folder_of(name) / FILE
    return OpenClaims(read_verdicts(file), verdict_frame(file), gather(folders_of(name)), published())


def show_claims_provenance(name: str) -> None:
    """Show where the numbers behind the verdicts come from: the folder of each table, and what its manifest says."""
    places = gather(folders_of(name)).places
    tables: dict[tuple[str, str], list[str]] = {}
    for (table, character), place in places.items():
        tables.setdefault((table, place), []).append(character)
    texts = [as_lines({f"{table}, {place}": ", ".join(names) for (table, place), names in tables.items()})]
    for table, place in tables:
        try:
            target = "table3" if table == GPU_TABLE else table
            texts.append(f"{table}, {place}\n{provenance_text(place, target)}")
        except InputError:  # rows without a manifest: their column `run` names the run
            continue
    line = (
        f"Where these numbers come from: {len(tables)} tables in {' and '.join(dict.fromkeys(p for _, p in tables))}."
    )
    notebooks.show_origin(
        line if tables else "No numbers to judge by are there yet.", "\n\n".join(texts), folder_of(name)
    )


# The verdicts, printed: claims against characters, and why.

OF_TABLE2 = ("C1", "C2", "C3", "C4", "C5")


def claims_table(verdicts: Sequence[Verdict], evidence: Evidence, claims: Sequence[Claim] = CLAIMS) -> Table:
    """Return a line for each claim and a column for each character, with footnotes to single verdicts.

    A character whose numbers have several profiles gets a column for each, so that none mixes two. Variants of a
    character, such as teen@one_face, are left out. evidence: the rows, for the note on the straight line.
    """
    names = [claim.name for claim in claims]
    shown = [each for each in of_recipe(verdicts) if "@" not in each.character and each.claim in names]
    characters = sorted({verdict.character for verdict in shown}, key=order_of)
    columns = [(character, profile) for character in characters for profile in _profiles(shown, character) or [""]]
    cells = {(verdict.claim, verdict.character, verdict.profile): cell(verdict) for verdict in shown}
    body = tuple(
        (f"{claim.name} {claim.text}", *(cells.get((claim.name, *column), "–") for column in columns))
        for claim in claims
    )
    marks = "".join(cells.values())
    notes = [about(shown)]
    if any(verdict.verdict == MEASURED for verdict in shown):
        notes.append("A number: measured, the ratio of two numbers, without a verdict.")
    if "†" in marks:
        notes.append("† By the same rule the paper's own numbers fail too, for the character that it stands for.")
    if "‡" in marks:
        notes.append(f"‡ {FEW_RUNS}.")
    notes += line_notes(evidence, characters)
    if "–" in cells.values():
        notes.append("–: not tested; `claims.csv` has the reason of each.")
    header = ("", *(_heading(*column, shown) for column in columns))
    title = "What the paper claims, on our characters"
    return Table(title, (header,), body, tuple(notes), text_columns=len(header))


FEW_RUNS = "One run or two: the interval is that of the spread on other characters, or of no spread that is known"


def of_recipe(verdicts: Iterable[Verdict], recipe: Recipe = BEST) -> list[Verdict]:
    """Return the verdicts on networks that are trained by a recipe, without those on single back ends."""
    return [verdict for verdict in verdicts if verdict.recipe == recipe.name and not verdict.place]


def _recipe(verdict: Verdict) -> Recipe:
    return next(recipe for recipe in RECIPES if recipe.name == verdict.recipe)


LINE_LETTERS, CLAIM_LETTERS = 120, 24  # a terminal's width, and what a claim's column keeps of it at least


def for_terminal(table: Table) -> Table:
    """Return the table of claims for a terminal: claims and notes in lines, what is in brackets below a heading."""
    headings = [heading.replace(" (", "\n(", 1).partition("\n") for heading in table.headers[0]]
    headers = tuple(heading[0] for heading in headings), tuple(heading[2] for heading in headings)
    _, *columns = zip(*headers, *table.body, strict=True)
    room = max(CLAIM_LETTERS, LINE_LETTERS - sum(2 + max(map(len, column)) for column in columns))
    body = []
    for claim, *cells in table.body:
        start, *more = _in_lines(claim, room).split("\n")
        body += [(start, *cells), *((line, *("" for _ in cells)) for line in more)]
    shown = headers if any(headers[1]) else headers[:1]
    return replace(table, headers=shown, body=tuple(body), notes=tuple(map(_in_lines, table.notes)))


def _in_lines(text: str, letters: int = LINE_LETTERS) -> str:
    """Return a text in lines of so many letters, all but the first indented; none ends beside a ±."""
    lines = textwrap.fill(unbroken(text), letters, subsequent_indent="    ", break_on_hyphens=False)
    return lines.replace("\u00a0", " ")


def _profiles(verdicts: Iterable[Verdict], *characters: str) -> list[str]:
    """Return the profiles behind the verdicts on some characters, or on all, the shortest training first."""
    found = {
        verdict.profile
        for verdict in verdicts
        if verdict.profile and (not characters or verdict.character in characters)
    }
    return sorted(found, key=lambda name: (list(PROFILES).index(name) if name in PROFILES else len(PROFILES), name))


def _heading(character: str, profile: str, verdicts: Sequence[Verdict]) -> str:
    """Return a column's heading: the character, with its profile where profiles differ, else with its film character.

    A short training decides less than a long one, so a reader must see which it was. If all stand-ins for the paper's
    characters have the same profile, only the headings of the other characters name theirs.
    """
    if character in STANDS_FOR and len(_profiles(verdicts, *STANDS_FOR)) < 2:
        return f"{character} ({STANDS_FOR[character]})"
    return _with_profile(character, profile, _profiles(verdicts))


def _with_profile(character: str, profile: str, profiles: Sequence[str]) -> str:
    """Return a character's name, with its profile where there are several in a table."""
    return f"{character} ({profile})" if profile and len(profiles) > 1 else character


def verdicts_of_table2(name: str) -> Table:
    """Judge the claims about Table 2, C1 to C5, on the rows of one folder alone; it needs no `claims.csv`.

    name: "reference", or the profile of a run.
    """
    evidence = gather([folder_of(name)])
    claims = [claim for claim in CLAIMS if claim.name in OF_TABLE2]
    characters = {row.character for row in evidence.rows.values() if row.table == "table2"}
    verdicts = [verdict for verdict in judge_all(evidence, published()) if verdict.character in characters]
    return claims_table(verdicts, evidence, claims)


def overview(file: Path) -> Table:
    """Return the table of a folder's `claims.csv`. Raises InputError for a file that holds no verdicts."""
    return claims_table(read_verdicts(file), gather([file.parent]))


SYMBOLS = {HOLDS: "✅", DIRECTION: "◔", ONE_RUN: "1×", UNDECIDED: "?", FAILS: "❌", NOT_TESTED: "–"}
PAGE_SYMBOLS = SYMBOLS | {HOLDS: "✔", FAILS: "✘"}  # any font has these, also on a machine without colour emojis
MIXED = "◐"
KINDS = (
    "holds, {} direction only (less than half of the paper's effect), {} undecided (the interval includes 1, or back "
    "ends disagree), {} one run, whose spread nothing tells (and its effect), {} fails"
)
EFFECT = "Effect: the ratio of the two numbers that decide; below 1 is as claimed"
NUMBERED = "①②③④"


def claims_in_brief(file: Path) -> Table:
    """Return a line for each claim: a symbol for each of the paper's stand-ins, and the effect here and in the paper.

    file: a folder's `claims.csv`. The effect is the ratio of the two numbers that decide, from the smallest to the
    largest of the characters. Each recipe as printed has a column, once something is trained by it.
    """
    verdicts = read_verdicts(file)
    readings = _printed(verdicts)
    body = []
    for claim in CLAIMS:
        symbols = [_symbol(each) for each in stand_ins(of_recipe(verdicts), claim.name)]
        printed = (stand_ins(of_recipe(verdicts, recipe), claim.name) for recipe in readings)
        more = [" ".join(map(_symbol, each)) or "–" for each in printed]
        body.append((f"{claim.name} {claim.text}", *symbols, *more, *effects(verdicts, claim)))
    text = KINDS.format(*(SYMBOLS[word] for word in (DIRECTION, UNDECIDED, ONE_RUN, FAILS)))
    notes = (f"✅ {text}, a number: measured, without a verdict, – not tested; ‡ one run or two. {EFFECT}.",)
    header = ("", *STANDS_FOR, *_headings(readings), "effect here", "in the paper")
    return Table(
        "The paper's claims on our characters",
        (header,),
        tuple(body),
        (*notes, *_readings_note(readings, verdicts)),
        text_columns=len(header),
    )


def _printed(verdicts: Iterable[Verdict]) -> list[Recipe]:
    """Return the recipes as printed that something is judged for."""
    there = {verdict.recipe for verdict in verdicts}
    return [recipe for recipe in PRINTED if recipe.name in there]


def _headings(readings: Sequence[Recipe]) -> list[str]:
    return [f"as printed {NUMBERED[PRINTED.index(recipe)]}" for recipe in readings]


def _readings_note(readings: Sequence[Recipe], verdicts: Sequence[Verdict]) -> list[str]:
    words = []
    for recipe in readings:
        whose = dict.fromkeys(each.character for each in of_recipe(verdicts, recipe) if each.verdict != NOT_TESTED)
        name = recipe.words.removeprefix("as printed, ")
        words.append(f"{NUMBERED[PRINTED.index(recipe)]} {name}, on {', '.join(whose)}")
    return [f"As printed, by what the text leaves open: {'; '.join(words)}."] if words else []


def _symbol(verdict: Verdict) -> str:
    if verdict.verdict == ONE_RUN:
        return f"{SYMBOLS[ONE_RUN]} {verdict.effect:.2f}"
    return cell(verdict).replace(verdict.verdict, SYMBOLS.get(verdict.verdict, "")).replace(" ", "").replace("†", "")


def claims_at_a_glance(verdicts: Sequence[Verdict]) -> Table:
    """Return a line for each claim: its verdict in a few words, and the effect here and in the paper.

    It sums up what `claims_in_brief` has by character.
    """
    readings = _printed(verdicts)
    body = tuple(
        (
            f"{claim.name} {claim.text}",
            outcome(stand_ins(of_recipe(verdicts), claim.name)),
            *(outcome(stand_ins(of_recipe(verdicts, recipe), claim.name)) for recipe in readings),
            *effects(verdicts, claim),
        )
        for claim in CLAIMS
    )
    text = KINDS.format(*(PAGE_SYMBOLS[word] for word in (DIRECTION, UNDECIDED, ONE_RUN, FAILS)))
    notes = (
        f"✔ {text}, ◐ it depends on the character; ‡ one run or two. {EFFECT}.",
        *_readings_note(readings, verdicts),
    )
    header = ("", "on our characters", *_headings(readings), "effect here", "in the paper")
    return Table("The paper's claims at a glance", (header,), body, notes, text_columns=2 + len(readings))


def stand_ins(verdicts: Sequence[Verdict], claim: str) -> list[Verdict]:
    """Return a claim's verdicts on the paper's stand-ins; where none of these has numbers, on all whole rigs."""
    tested = {verdict.character for verdict in verdicts if verdict.verdict != NOT_TESTED}
    chosen = [verdict for verdict in verdicts if verdict.claim == claim and "@" not in verdict.character]
    if tested and not tested & set(STANDS_FOR):
        return [verdict for verdict in chosen if verdict.character in tested]
    by_character = {verdict.character: verdict for verdict in chosen}
    return [by_character[character] for character in STANDS_FOR if character in by_character]


def outcome(verdicts: Sequence[Verdict]) -> str:
    """Return some characters' verdicts on one claim in a few words: "✔ holds", or which it is on whom."""
    tested = [verdict for verdict in verdicts if verdict.verdict != NOT_TESTED]
    if not tested:
        return "– not tested"
    words = sorted({verdict.verdict for verdict in tested}, key=lambda word: -RANKS.index(word) if word in RANKS else 0)
    whose = {word: [verdict.character for verdict in tested if verdict.verdict == word] for word in words}
    single = " ‡" if all("‡" in cell(verdict) for verdict in tested) else ""
    if len(words) == 1:
        on = "" if len(tested) == len(verdicts) else f" on {', '.join(whose[words[0]])}"
        effect = f": {_range([verdict.effect for verdict in tested])}" if words == [ONE_RUN] else ""
        return f"{PAGE_SYMBOLS.get(words[0], '')} {words[0]}{on}{effect}{single}".strip()
    parts = (f"{word} on {', '.join(whose[word])}" for word in words)
    return f"{MIXED} {'; '.join(parts)}{single}"


def effects(verdicts: Sequence[Verdict], claim: Claim) -> tuple[str, str]:
    """Return the ratios of the two numbers that decide a claim, as "0.40–0.90": ours, and the paper's of the same.

    Where we have none that the paper has too, its own deciding ones.
    """
    ours = stand_ins(of_recipe(verdicts), claim.name)
    if claim.everywhere:
        shown = {verdict.character for verdict in ours}
        ours = [each for each in verdicts if each.claim == claim.name and each.place and each.character in shown]
    here = [verdict.effect for verdict in ours if verdict.effect is not None]
    theirs = [verdict.paper for verdict in ours] if here else []
    if not any(theirs):
        theirs = [papers_effect(claim, character, published()) for character in STANDS_FOR.values()]
    return _range(here), _range([effect for effect in theirs if effect is not None])


def effect_in_words(verdict: Verdict, short: bool = False) -> str:
    """Return a verdict's effect in words: "teen 0.4 % ± 0.1 less (Hiccup: 25 % less)".

    short: leave out the names and the paper's effect
    """
    high = math.inf if verdict.high is None else verdict.high
    log = math.log(verdict.effect)
    here = difference(Effect(log, math.log(high) - log))
    if short:
        return here
    if verdict.paper is None:
        return f"{verdict.character} {here}"
    return f"{verdict.character} {here} ({verdict.stands_for}: {difference(Effect(math.log(verdict.paper)))})"


def effects_in_words(verdicts: Sequence[Verdict]) -> str:
    """Return the effects of some characters' verdicts on one claim in a sentence, by what is compared; "" for none."""
    groups: dict[str, list[str]] = {}
    for verdict in verdicts:
        if verdict.effect is not None:
            groups.setdefault(verdict.comparison.replace(" < ", " beside "), []).append(effect_in_words(verdict))
    return " ".join(f"{what[0].upper()}{what[1:]}: {', '.join(each)}." for what, each in groups.items())


def _range(ratios: Sequence[float]) -> str:
    if not ratios:
        return "–"
    ends = [f"{end:.2f}" for end in (min(ratios), max(ratios))]
    return "–".join(dict.fromkeys(ends))


def cell(verdict: Verdict) -> str:
    """Return a verdict as the table shows it, with the marks of its footnotes; what is measured as its ratio."""
    if verdict.verdict == NOT_TESTED:
        return "–"
    marks = [f"{verdict.effect:.2f}" if verdict.verdict == MEASURED else verdict.verdict]
    if verdict.verdict == verdict.published == FAILS:
        marks.append("†")
    is_exact = verdict.unit == "MB" or (verdict.verdict == MEASURED and verdict.low is not None)
    if (verdict.seeds or ENOUGH) < ENOUGH and not is_exact:
        marks.append("‡")
    return " ".join(marks)


def about(verdicts: Sequence[Verdict]) -> str:
    """Return the profile and the number of seeds behind the verdicts, as a note."""
    tested = [verdict for verdict in verdicts if verdict.verdict != NOT_TESTED]
    if not tested:
        return "Nothing is tested yet."
    seeds = seeds_in_words([verdict.seeds for verdict in tested if verdict.seeds])
    profiles = ", ".join(sorted({verdict.profile for verdict in tested}))
    return f"Profile {profiles}; {seeds or 'one seed'}; verdicts by 95 % intervals of effects."


def line_notes(evidence: Evidence, characters: Sequence[str]) -> list[str]:
    """Return a note for each character on which a straight line has smaller normal errors than some network."""
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


def show_rule() -> None:
    """Show in a notebook how an effect becomes a verdict."""
    notebooks.show_text("\n\n".join(RULE))


def show_claim(opened: OpenClaims, name: str) -> None:
    """Show a claim in a notebook: its verdict, its chart, and the reasons folded. name: "C1"."""
    _show_verdict(opened.verdicts, name)
    if chart := claim_chart(opened.ours, opened.paper, name):
        notebooks.show(*chart)
    if name == OF_FREQUENCY and (chart := frequency_chart(opened.ours)):
        notebooks.show(*chart)
    _show_reasons(opened.verdicts, name)


def show_verdict(rows: Sequence[Row], name: str) -> None:
    """Judge one claim for each character in some rows, and show the verdict in a notebook, with the reasons folded."""
    evidence, paper = Evidence(rows), published()
    verdicts = [judge(claim_named(name), character, evidence, paper) for character in characters_of(rows)]
    _show_verdict(verdicts, name)
    _show_reasons(verdicts, name)


def _show_verdict(verdicts: Sequence[Verdict], name: str) -> None:
    claim = claim_named(name)
    theirs = effects(verdicts, claim)[1]
    lines = [f"**{name}, {claim.text}** ({claim.where})"]
    for recipe in (BEST, *_printed(verdicts)):
        chosen = stand_ins(of_recipe(verdicts, recipe), name)
        if recipe == BEST or any(verdict.verdict != NOT_TESTED for verdict in chosen):
            lead = "" if recipe == BEST else f"{recipe.words[0].upper()}{recipe.words[1:]}: "
            sizes = "" if claim.everywhere else effects_in_words(chosen)  # those have a table
            lines.append(f"{lead}**{outcome(chosen)}**. {sizes}".strip())
    lines[0] += f": {lines.pop(1)}{' The paper prints no number.' if theirs == '–' else ''}"
    notebooks.show_text("\n\n".join(lines))
    if table := places_table(verdicts, name):
        notebooks.show_table(table)


def _show_reasons(verdicts: Sequence[Verdict], name: str) -> None:
    table = reasons_table(verdicts, name)
    lines = [f"{who}: {verdict}. {reason}" for who, verdict, _, reason in table.body]
    theirs = [f"the paper's numbers: {paper}" for _, _, paper, _ in table.body if paper != "–"]
    rule = f"The rule: {claim_named(name).rule}"
    notebooks.show_folded(
        f"The rule of {name}, and why, character by character", [rule, *lines, *dict.fromkeys(theirs)]
    )


def places_table(verdicts: Sequence[Verdict], name: str) -> Table | None:
    """Return a claim's verdicts place by place, a character a column; None for a claim about a single place."""
    chosen = [each for each in verdicts if each.claim == name and each.place and "@" not in each.character]
    if not chosen:
        return None
    characters = sorted({verdict.character for verdict in chosen}, key=order_of)
    words = {(each.place, each.character): f"{cell(each)}, {effect_in_words(each, short=True)}" for each in chosen}
    places = dict.fromkeys(verdict.place for verdict in chosen)
    body = tuple((place, *(words.get((place, character), "–") for character in characters)) for place in places)
    notes = (
        f"Less and more: the time of {chosen[0].comparison.partition(': ')[2].partition(' <')[0]}, beside the other's.",
    )
    return Table(f"{name}, by back end", (("", *characters),), body, notes, text_columns=1 + len(characters))


def reasons_table(verdicts: Sequence[Verdict], claim: str) -> Table:
    """Return one claim's verdicts with their reasons, one character a line, the verdict on the paper beside ours."""
    chosen = [verdict for verdict in verdicts if verdict.claim == claim and not verdict.place]
    profiles = _profiles(chosen)
    body = tuple(
        (
            _with_profile(verdict.character, verdict.profile, profiles)
            + ("" if verdict.recipe == BEST.name else f", {_recipe(verdict).words}"),
            verdict.verdict,
            _of_the_paper(verdict),
            verdict.reason,
        )
        for verdict in chosen
    )
    header = ("", "verdict", "paper's numbers", "why")
    return Table(f"{claim}, character by character", (header,), body, text_columns=4)


def comparison_table(evidence: Evidence, method: str, other: str, kind: str) -> Table:
    """Return for each character whether one method's mean error is smaller than another's: the direction alone.

    kind: "vertex" or "normal". A character that lacks a number is not tested; variants of a character are left out.
    """

    def ways(evidence: Evidence, character: str) -> tuple[tuple[Comparison, ...], ...]:
        return ((smaller_error(evidence, character, method, other, kind),),)

    body = []
    for character in (name for name in evidence.characters() if "@" not in name):
        try:
            ((comparison,),) = ways(evidence, character)
            effect = comparison.effect(evidence.borrowed(ways, comparison))
            body.append((character, verdict_of(effect, 0.0), f"{comparison} ({difference(effect)})"))
        except MissingNumber as missing:
            body.append((character, NOT_TESTED, f"{missing}"))
    return Table(f"Is {method} below {other}?", (("", "verdict", "why"),), tuple(body), text_columns=3)


def _of_the_paper(verdict: Verdict) -> str:
    return f"{verdict.published} ({verdict.stands_for})" if verdict.published in RANKS else "–"


# A claim's numbers as a chart: ours beside the paper's, as ratios that the claim wants below 1.

OURS, THEIRS = "#1F6FB4", "#333333"
PANELS = 4  # in a row
ROW, TITLE, FRAME = 0.3, 1.0, 0.8  # inches: a comparison, what is around a row of panels, and around all of them
LETTERS, LINE = 30, 0.2  # in a line of what is compared; inches that each further line takes
SIZE_PT, TITLE_PT = 12, 11  # of letters; a panel's names are as wide as it
FEW_DECADES, MOST_DECADES = 1.35, 2.5  # up to them the numbers of `TICKS` and of `FEW_TICKS` have room
LEAST = 0.02  # a smaller ratio stands at the left end of its panel, as an arrow with its bound
TICKS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20)
FEW_TICKS = (0.05, 0.2, 1, 5, 20)
NARROW_TICKS = (0.8, 1, 1.25)  # where fewer than two of these have room

Pairs = dict[str, tuple[Comparison | None, Comparison | None]]


def claim_chart(evidence: Evidence, paper: Evidence, claim: str) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): a panel for each character, our ratios as dots and the paper's as rings.

    claim: its number, "C1". A ratio divides the number that the claim wants to be smaller by the other; one below
    `LEAST` becomes an arrow, so that it takes no room from the others. Characters with different comparisons get
    separate rows of panels. None where neither we nor the paper have numbers.
    """
    from matplotlib.figure import Figure

    names = [name for name in evidence.characters() if "@" not in name]  # variants are in the reasons alone
    panels = {character: pairs_of(evidence, paper, claim, character) for character in names}
    rows = _rows({character: pairs for character, pairs in panels.items() if pairs})
    if not rows:
        return None
    quantity = _shared_quantity([name for names, _ in rows for name in names])
    lines = [[textwrap.fill(name.removeprefix(f"{quantity}: "), LETTERS) for name in names] for names, _ in rows]
    heights = [len(each) * (ROW + LINE * max(label.count("\n") for label in each)) + TITLE for each in lines]
    figure = Figure((WIDTH, sum(heights) + FRAME), dpi=DPI, layout="constrained")
    grid = figure.add_gridspec(
        len(rows), min(PANELS, max(3, *(len(shown) for _, shown in rows))), height_ratios=heights
    )
    ratios = [c.ratio for pairs in panels.values() for pair in pairs.values() for c in pair if c]
    small = any(ratio < LEAST for ratio in ratios)
    limits = min([r for r in ratios if r >= LEAST] + [0.8]) / (3 if small else 1.35), max([*ratios, 1.25]) * 1.35
    has = [any(pair[k] for pairs in panels.values() for pair in pairs.values()) for k in (0, 1)]
    phrases = []
    for r, (names, shown) in enumerate(rows):
        for c, character in enumerate(shown):
            axes = figure.add_subplot(grid[r, c])
            ways = claim_named(claim).ways
            ours = {name: pair[0] for name, pair in panels[character].items() if pair[0]}
            bars = {name: each.effect(evidence.borrowed(ways, each)) for name, each in ours.items()}
            phrases += _draw(axes, names, panels[character], bars, character, limits)
            axes.set_title(_title(panels[character], character, has[1]), fontsize=TITLE_PT, loc="left")
            axes.set_yticks(range(len(names)), lines[r] if c == 0 else [])
            axes.tick_params(labelsize=SIZE_PT)
    _legend(figure, has)
    of_what = f"{quantity.removesuffix('s')}s" if quantity else "the two numbers"
    figure.supxlabel(f"ratio of {of_what}; in grey, against the claim", fontsize=SIZE_PT)
    about = f"ratios, dots ours{', rings the paper’s' if has[1] else ''}; the claim wants them left of 1"
    about += f"; an arrow is one below {LEAST:g}" if small else ""
    alt = f"Dots and rings of ratios for claim {claim}. Ours: {'; '.join(phrases) or 'none yet'}."
    return figure, Words(alt, f"{claim}: {about}.")


def _rows(panels: dict[str, Pairs]) -> list[tuple[list[str], list[str]]]:
    """Return (names of comparisons, characters) for each row of panels, whose characters share all comparisons."""
    groups: dict[frozenset[str], list[str]] = {}
    for character, pairs in panels.items():
        groups.setdefault(frozenset(pairs), []).append(character)
    parts = [members[k : k + PANELS] for members in groups.values() for k in range(0, len(members), PANELS)]
    return [(list(panels[part[0]]), part) for part in parts]


def _shared_quantity(names: list[str]) -> str:
    """Return the quantity that all comparisons share, or "" where they differ."""
    quantities = {name.partition(": ")[0] for name in names}
    return quantities.pop() if len(quantities) == 1 else ""


def _draw(
    axes, names: list[str], pairs: Pairs, bars: dict[str, Effect], character: str, limits: tuple[float, float]
) -> list[str]:
    """Draw a character's panel, and return our ratios in words. bars: our effects by the comparisons' names."""
    phrases, (lower, upper) = [], limits
    axes.axvspan(1.0, upper, color="0.93", zorder=0)
    axes.axvline(1.0, color="0.4", linewidth=0.8, zorder=1)
    for y, name in enumerate(names):
        ours, theirs = pairs[name]
        if theirs:
            style = {"markerfacecolor": "none", "markeredgecolor": THEIRS, "markersize": 11, "zorder": 2}
            axes.plot(*((_arrow(axes, lower, y), y, "<") if theirs.ratio < LEAST else (theirs.ratio, y, "o")), **style)
        if ours and ours.ratio < LEAST:
            axes.plot(_arrow(axes, lower, y), y, "<", color=OURS, markersize=8)
        elif ours:
            axes.errorbar(
                ours.ratio, y, xerr=_bar(bars[name], lower, upper), fmt="o", color=OURS, markersize=6, capsize=3
            )
        if ours:
            phrases.append(f"{character}, {name}: {significant(ours.ratio, 2)}")
    axes.set_xscale("log")
    axes.set_xlim(lower, upper)
    decades = math.log10(upper / lower)
    wide = [10.0**k for k in range(-12, 13, math.ceil(decades / 3))] if decades > MOST_DECADES else FEW_TICKS
    ticks = [tick for tick in (TICKS if decades < FEW_DECADES else wide) if lower < tick < upper]
    ticks = ticks if len(ticks) > 1 else [tick for tick in NARROW_TICKS if lower < tick < upper]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(len(names) - 0.5, -0.5)
    tidy(axes)
    return phrases


def _title(pairs: Pairs, character: str, published: bool) -> str:
    """Return a panel's title: our character and, if the paper has numbers for any panel, its character below."""
    film = stand_in(character)
    has = [any(pair[k] for pair in pairs.values()) for k in (0, 1)]
    ours = f"{character}{', ours' if film else ''}" if has[0] else f"{character}: not tested"
    theirs = f"{film}, paper" if has[1] else "paper: no number"
    return f"{ours}\n{theirs}" if published else ours


def _arrow(axes, lower: float, y: int) -> float:
    """Write "< `LEAST`" beside the arrow of a smaller ratio, and return the arrow's x."""
    place = 1.25 * lower
    style = {"textcoords": "offset points", "va": "center", "fontsize": SIZE_PT}
    axes.annotate(f"< {LEAST:g}", (place, y), (8, 0), **style)
    return place


def _legend(figure: "matplotlib.figure.Figure", has: Sequence[bool]) -> None:
    """Explain dots and rings. has: whether there are dots (ours), and rings (the paper's)."""
    from matplotlib.lines import Line2D

    dot = Line2D([], [], marker="o", linestyle="", color=OURS, label="our characters")
    ring = Line2D([], [], marker="o", linestyle="", markerfacecolor="none", markersize=11, color=THEIRS)
    ring.set_label("the paper’s characters")
    handles = [handle for handle, there in zip((dot, ring), has, strict=True) if there]
    figure.legend(handles=handles, loc="outside upper right", ncols=2, frameon=False, fontsize=SIZE_PT)


def pairs_of(evidence: Evidence, paper: Evidence, claim: str, character: str) -> Pairs:
    """Return a claim's comparisons by their names: (ours, the paper's), None where either lacks a number."""
    ways = claim_named(claim).ways
    ours, theirs = (
        _comparisons(ways, rows, name) for rows, name in ((evidence, character), (paper, stand_in(character)))
    )
    keys = {name: comparison.key for name, comparison in ours.items()}
    alone = {name: (None, each) for name, each in theirs.items() if name not in keys.values()}
    return {name: (each, theirs.get(keys[name])) for name, each in ours.items()} | alone


def _comparisons(ways, evidence: Evidence, character: str) -> dict[str, Comparison]:
    try:
        return {comparison.name: comparison for way in ways(evidence, character) for comparison in way}
    except MissingNumber:
        return {}


OF_FREQUENCY = "C5"
BAND = "frequency_band_"


def frequency_chart(evidence: Evidence) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): errors by octaves of the mesh's waves, a panel a character and a line a network.

    The last point of a line is what no wave of the basis has. None where no errors are taken apart.
    """
    from matplotlib.figure import Figure

    lines: dict[str, dict[str, list[float]]] = {}
    for character in (name for name in evidence.characters() if "@" not in name):
        for method in NETWORKS:
            found = [row for row in evidence.rows.values() if row.key[1:3] == (character, method)]
            bands = {int(row.metric.removeprefix(BAND)): row.value for row in found if row.metric.startswith(BAND)}
            if bands:
                lines.setdefault(character, {})[method] = [bands[k] for k in sorted(bands)]
    if not lines:
        return None
    across = min(PANELS, len(lines))
    down = -(-len(lines) // across)
    figure = Figure((WIDTH, 2.6 * down + FRAME), dpi=DPI, layout="constrained")
    grid = figure.subplots(down, across, squeeze=False, sharey=True).ravel()
    for axes in grid[len(lines) :]:
        axes.set_visible(False)
    for axes, (character, methods) in zip(grid, lines.items(), strict=False):
        for method, roots in methods.items():
            known = method_named(method)
            axes.plot(range(len(roots)), roots, color=known.colour, marker=LINE_MARKS[method], label=known.label)
        count = len(roots)
        axes.set_xticks([0, count - 2, count - 1], ["1", f"{2 ** (count - 2):,}", "rest"])
        axes.set_yscale("log")
        axes.set_title(character, fontsize=TITLE_PT, loc="left")
        axes.tick_params(labelsize=SIZE_PT)
        tidy(axes)
    grid[0].set_ylabel("error, mm", fontsize=SIZE_PT)
    figure.supxlabel("waves of the mesh, from slow to quick, by octaves", fontsize=SIZE_PT)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(NETWORKS), frameon=False, fontsize=SIZE_PT)
    ends = [
        f"{character}, {method} {significant(roots[-1], 2)} mm in the rest"
        for character, methods in lines.items()
        for method, roots in methods.items()
    ]
    alt = f"Lines of the root of the mean squared error by octaves of waves, logarithmic. {'; '.join(ends)}."
    return figure, Words(
        alt, "C5: errors by octaves of the mesh's waves, slow ones left; the rest is of high frequency."
    )


LINE_MARKS = {"coarse": "o", "refined": "s", "dense": "^"}


def _bar(effect: Effect, lower: float, upper: float) -> list[list[float]] | None:
    """Return the lengths of the bar of an effect's interval on both sides, within limits; None where it has none."""
    if not 0 < effect.half < math.inf:
        return None
    return [[effect.ratio - max(effect.low, lower)], [min(effect.high, upper) - effect.ratio]]
