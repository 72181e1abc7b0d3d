"""Table 2, printed: ours beside the paper's, with the rows that the paper lacks and what they mean."""

import re
from collections.abc import Iterable, Sequence

from replicate.report.results import Row, find, most_seeds
from replicate.report.tables import Table, published, rounded

STANDS_FOR = {"teen": "Hiccup", "woman": "Valka", "dragon": "Toothless", "toon": "Ray"}

# The paper's methods in its order, then the rows that it lacks; other numbers of bones come between those of LBS.
METHODS = {
    "coarse": "Coarse",
    "refined": "Refined",
    "dense": "Dense",
    "lbs16": "LBS: 16 bones †",
    "lbs24": "LBS: 24 bones †",
    "lbs32": "LBS: 32 bones †",
    "driven": "LBS moved by a network ◊",
    "floor": "Floor, coarse maps ‡",
    "floor_refined": "Floor, refined maps ‡",
    "attachment": "Attached rigid segments ¶",
    "neutral": "Neutral pose §",
}
OF_TABLE1 = {"model": "Model", "dense_released": "Dense, 256 and 512"}
OURS_ALONE = ("driven", "floor", "floor_refined", "attachment", "neutral")
NOTES = {
    "†": "An oracle: its bones are refitted to the true mesh of each test pose; it is no function of rig parameters.",
    "◊": "The skin with the most bones, moved by a small network that sees rig parameters: LBS as a prediction.",
    "‡": "An oracle: the true mesh projected onto the deformation maps by least squares: what their resolution allows.",
    "¶": "An oracle: the true mesh, but for the rigid segments, which are placed by their attachment vertices (§3.4).",
    "§": "The neutral pose as prediction: how much the test poses move.",
}
STATISTICS = ("mean", "p95", "max")
_BONES = re.compile(r"lbs(\d+)")


def in_order(methods: Iterable[str]) -> list[str]:
    """Return the methods among some labels in the table's order: the paper's, LBS by bones, then what it lacks."""
    bones = {method: int(found[1]) for method in methods if (found := _BONES.fullmatch(method))}
    networks = [method for method in METHODS if method not in OURS_ALONE and not _BONES.fullmatch(method)]
    order = [*networks, *sorted(bones, key=bones.__getitem__), *OURS_ALONE]
    return [method for method in order if method in bones or method in methods]


def title(method: str) -> str:
    """Return a method's name as tables show it, with the mark of its note."""
    bones = _BONES.fullmatch(method)
    return (METHODS | OF_TABLE1).get(method, f"LBS: {bones[1]} bones †" if bones else method)


def table2(ours: Iterable[Row], paper: Sequence[Row], character: str) -> Table:
    """Return one character's errors in full, with the column of the film character that it stands for."""
    rows = [row for row in ours if row.table == "table2" and row.character == character]
    theirs = STANDS_FOR.get(character)
    present = in_order({row.method for row in rows})
    body = [_line(rows, paper, character, theirs, method) for method in present if method not in OURS_ALONE]
    extra = [_line(rows, paper, character, theirs, method) for method in present if method in OURS_ALONE]
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
    present = in_order({row.method for row in rows})
    body: list[tuple[str, ...] | None] = []
    for kind, unit, words in (("vertex", "mm", "Distance error, mm"), ("normal", "deg", "Normal angle error, degrees")):
        body += [None] if body else []
        body.append((words, *[""] * (2 * len(characters))))
        for method in present:
            cells = [title(method)]
            for character in characters:
                mine = find(rows, "table2", character, method, f"{kind}_error_mean")
                cells.append(rounded(mine.value, unit, mine.sd) if mine else "–")
                cells.append(published(find(paper, "table2", STANDS_FOR[character], method, f"{kind}_error_mean")))
            body.append(tuple(cells))
    header = ("", *(name for c in characters for name in (c, STANDS_FOR[c])))
    heading = "Table 2: mean errors of our characters beside the paper's"
    about = _about(rows, "each of the paper's characters")
    return Table(heading, (header,), tuple(body), (about, *_notes(rows, present)))


def _line(rows, paper, character: str, theirs: str | None, method: str) -> tuple[str, ...]:
    cells = [title(method)]
    for kind, unit in (("vertex", "mm"), ("normal", "deg")):
        for statistic in STATISTICS:
            row = find(rows, "table2", character, method, f"{kind}_error_{statistic}")
            cells.append(rounded(row.value, unit, row.sd) if row else "–")
        cells.append(published(find(paper, "table2", theirs or "", method, f"{kind}_error_mean")))
    texels = find(rows, "table2", character, method, "texels_per_vertex")
    return (*cells, rounded(texels.value, "ratio") if texels else "")


def _about(rows: Sequence[Row], theirs: str | None) -> str:
    about = []
    seeds = most_seeds(rows)
    if poses := max((row.poses or 0 for row in rows), default=0):
        about.append(f"{poses:,} unique test poses" + (" or more a seed" if seeds > 1 else ""))
    if seeds:
        about.append(f"{seeds} seeds, ± their standard deviation" if seeds > 1 else "one seed")
    about += [f"profile {name}" for name in sorted({row.profile for row in rows})]
    if theirs:
        about.append(f"{theirs} is another rig: compare orderings and ratios, not millimetres")
    return "; ".join(about) + "."


def _notes(rows: Sequence[Row], present: Sequence[str]) -> tuple[str, ...]:
    notes = [f"{mark} {note}" for mark, note in NOTES.items() if any(mark in title(method) for method in present)]
    left_out = [row for row in rows if row.metric == "normal_faces_left_out" and row.value]
    if left_out:
        worst = max(left_out, key=lambda row: row.value)
        notes.append(
            f"Eq. 11 leaves out faces that have no area in the true or the predicted mesh: {worst.value:,.0f} (face, "
            f"pose) pairs at most ({title(worst.method)})."
        )
    for character in sorted({row.character for row in rows}):
        counts = {row.method: row.poses for row in rows if row.character == character and row.poses}
        fewer = [m for m in present if counts.get(m, 0) and counts[m] < max(counts.values())]
        notes += [f"{title(m)}: on {counts[m]:,} of {character}'s poses only." for m in fewer]
    return tuple(notes)
