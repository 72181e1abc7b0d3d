"""Table 2, printed: ours beside the paper's, with the rows that the paper lacks and what they mean."""

from collections.abc import Iterable, Sequence

from replicate.methods.method_registry import in_order, method_named
from replicate.report.cast import STANDS_FOR, characters_of
from replicate.report.results import Row, find, most_seeds, seeds_note
from replicate.report.tables import Table, paper_value, round_off

STATISTICS = ("mean", "p95", "max")


def table2(ours: Iterable[Row], paper: Sequence[Row], character: str) -> Table:
    """Return one character's errors in full, with the column of the film character that it stands for."""
    rows = [row for row in ours if row.table == "table2" and row.character == character]
    theirs = STANDS_FOR.get(character)
    present = in_order({row.method for row in rows})
    body = [_line(rows, paper, character, theirs, method) for method in present if method_named(method).in_paper]
    extra = [_line(rows, paper, character, theirs, method) for method in present if not method_named(method).in_paper]
    name = theirs or "paper"
    headers = (
        ("", "distance error, mm", "", "", "", "normal angle error, degrees", "", "", "", "texels"),
        ("", *STATISTICS, name, *STATISTICS, name, "per vertex"),
    )
    rule = [None] if body and extra else []
    heading = f"Table 2: {character}" + (f" beside the paper's {theirs}" if theirs else "")
    return Table(heading, headers, (*body, *rule, *extra), (_about(rows, theirs), *_notes(rows, present)))


def table2_overview(ours: Sequence[Row], paper: Sequence[Row]) -> Table:
    """Return the paper's Table 2: the means of every character beside those of the one that it stands for."""
    rows = [row for row in ours if row.table == "table2"]
    characters = [c for c in STANDS_FOR if any(row.character == c for row in rows)]
    present = in_order({row.method for row in rows if row.character in characters})
    body: list[tuple[str, ...] | None] = []
    for kind, unit, words in (("vertex", "mm", "Distance error, mm"), ("normal", "deg", "Normal angle error, degrees")):
        body += [None] if body else []
        body.append((words, *[""] * (2 * len(characters))))
        for method in present:
            cells = [method_named(method).title]
            for character in characters:
                mine = find(rows, "table2", character, method, f"{kind}_error_mean")
                cells.append(round_off(mine.value, unit, mine.sd) if mine else "–")
                cells.append(paper_value(find(paper, "table2", STANDS_FOR[character], method, f"{kind}_error_mean")))
            body.append(tuple(cells))
    header = ("", *(name for c in characters for name in (c, STANDS_FOR[c])))
    heading = "Table 2: mean errors of our characters beside the paper's"
    own = [row for row in rows if row.character in characters]
    about = _about(own, "each of the paper's characters")
    return Table(heading, (header,), tuple(body), (about, *_notes(own, present)))


def other_rigs(ours: Sequence[Row]) -> Table:
    """Return the mean errors on rigs that stand for none of the paper's characters, variants of ours left out."""
    rows = [row for row in ours if row.table == "table2" and row.character not in STANDS_FOR]
    rows = [row for row in rows if "@" not in row.character]
    characters, present = characters_of(rows), in_order({row.method for row in rows})
    body = []
    for method in present:
        cells = [method_named(method).title]
        for character in characters:
            for kind, unit in (("vertex", "mm"), ("normal", "deg")):
                mine = find(rows, "table2", character, method, f"{kind}_error_mean")
                cells.append(round_off(mine.value, unit, mine.sd) if mine else "–")
        body.append(tuple(cells))
    header = ("", *(f"{who}, {unit}" for who in characters for unit in ("mm", "degrees")))
    heading = "Mean errors on rigs that others wrote: distance (mm) and normal angle (degrees)"
    about = (_about(rows, None), *_notes(rows, present)) if rows else ("There are no results of such a rig.",)
    return Table(heading, (header,), tuple(body), about)


def _line(rows, paper, character: str, theirs: str | None, method: str) -> tuple[str, ...]:
    cells = [method_named(method).title]
    for kind, unit in (("vertex", "mm"), ("normal", "deg")):
        for statistic in STATISTICS:
            row = find(rows, "table2", character, method, f"{kind}_error_{statistic}")
            cells.append(round_off(row.value, unit, row.sd) if row else "–")
        cells.append(paper_value(find(paper, "table2", theirs or "", method, f"{kind}_error_mean")))
    texels = find(rows, "table2", character, method, "texels_per_vertex")
    return (*cells, round_off(texels.value, "ratio") if texels else "")


def _about(rows: Sequence[Row], theirs: str | None) -> str:
    about = []
    seeds = most_seeds(rows)
    if poses := _poses_in_words(rows):
        about.append(f"{poses} unique test poses" + (" or more a seed" if seeds > 1 else ""))
    if seeds:
        about.append(seeds_note(rows))
    about += [f"profile {name}" for name in sorted({row.profile for row in rows})]
    if theirs:
        about.append(f"{theirs} is another rig: compare orderings and ratios, not millimetres")
    return "; ".join(about) + "."


def _poses_in_words(rows: Sequence[Row]) -> str:
    """Return how many poses the errors are means over, character by character where they differ; "" for none.

    Rows with fewer seeds than others of the same character don't count: the fewest poses of one seed may be more.
    """
    counts = {}
    for who in characters_of(rows):
        own = [row for row in rows if row.character == who]
        counts[who] = max(row.poses or 0 for row in own if (row.seeds or 0) == most_seeds(own))
    counts = {who: count for who, count in counts.items() if count}
    if len(set(counts.values())) < 2:
        return "".join(f"{count:,}" for count in set(counts.values()))
    *most, last = (f"{count:,} ({who})" for who, count in counts.items())
    return f"{', '.join(most)} and {last}"


def method_notes(present: Sequence[str]) -> list[str]:
    """Return the footnotes of some methods in their order, each once: by its mark, or by the row's label."""
    methods = [method_named(name) for name in present]
    return list(dict.fromkeys(f"{m.mark or m.label + ':'} {m.note}" for m in methods if m.note))


def _notes(rows: Sequence[Row], present: Sequence[str]) -> tuple[str, ...]:
    notes = method_notes(present)
    left_out = [row for row in rows if row.metric == "normal_faces_left_out" and row.value]
    if left_out:
        worst = max(left_out, key=lambda row: row.value)
        notes.append(
            f"Eq. 11 leaves out faces that have no area in the true or the predicted mesh: {worst.value:,.0f} (face, "
            f"pose) pairs at most ({method_named(worst.method).title})."
        )
    single = False  # whether the rows of fewer seeds than the others show it: they have no ±
    for character in sorted({row.character for row in rows}):
        most = most_seeds(row for row in rows if row.character == character)
        own = {row.method: row for row in rows if row.character == character and row.poses}
        for method in filter(own.__contains__, present):
            largest = max(row.poses for row in own.values() if row.seeds == own[method].seeds)
            if own[method].poses < largest:
                notes.append(f"{method_named(method).title}: on {own[method].poses:,} of {character}'s poses only.")
        fewer = [method_named(m).title for m in present if m in own and 1 < (own[m].seeds or 0) < most]
        if fewer:
            notes.append(f"Of fewer seeds than the others of {character}: {', '.join(fewer)}.")
        single |= most > 1 and any((row.seeds or 0) == 1 for row in own.values())
    return (*notes, *(["Means without ± are of one seed."] if single else []))
