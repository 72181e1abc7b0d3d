"""Figure 13 in numbers: every way to move meshes of another topology, and what charts that are off cost."""

import re
from collections.abc import Sequence

from replicate.report.cast import characters_of
from replicate.report.results import Row, find, most_seeds, seeds_in_words
from replicate.report.tables import Table, round_off

MESHES = {"original": "its own mesh", "half": "half of the vertices", "quarter": "a quarter"}
LABELS = {
    "coarse": "Coarse networks",
    "refined": "Refined networks",
    "coarse_carried": "Coarse networks, carried from the own mesh",
    "deformation_transfer": "Deformation transfer of the rig's mesh †",
    "deformation_transfer_coarse": "Deformation transfer of the coarse networks' mesh",
    "neutral": "Neutral pose",
}
KINDS = (("vertex", "mm", "Distance error, mm"), ("normal", "deg", "Normal angle error, degrees"))
NOTES = (
    "Networks are trained on the own mesh and read at the texture coordinates of the new one. The truth is the rig's "
    "movement, carried to the new vertices by barycentric coordinates.",
    "Carried: the networks' movement of the own mesh, taken to the new vertices by the same coordinates as the truth.",
    "† Sumner and Popović 2004; it is handed the true mesh of each pose, which the networks are not.",
)
OTHER_NOTES = (
    "Networks of one character move another one's face, aligned by landmarks, offsets scaled by the distances between "
    "them. The numbers are differences from the other's own rig at the same numbers of the same controls.",
    "That rig is no truth: it is another person, who folds elsewhere. A difference of zero is out of reach.",
    NOTES[-1],
)


def tables13(ours: Sequence[Row]) -> list[Table]:
    """Return for each character a table of every way on every mesh and one of charts that are off.

    Tables of other characters' faces follow, where any have been moved and measured.
    """
    rows = [row for row in ours if row.table == "figure13"]
    tables = [make(rows, character) for character in characters_of(rows) for make in (meshes_table, charts_table)]
    return tables + [table for character in characters_of(rows) if (table := others_table(rows, character))]


def meshes_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's mean errors of every way to move every mesh."""
    own = [row for row in rows if row.character == character]
    present = {row.method for row in own}
    body: list[tuple[str, ...] | None] = []
    for kind, unit, words in KINDS:
        body += [None] if body else []
        body.append((words, *[""] * len(MESHES)))
        for way in (way for way in LABELS if way in present):
            found = [find(rows, "figure13", character, way, f"{kind}_error_mean[{mesh}]") for mesh in MESHES]
            body.append((LABELS[way], *(round_off(row.value, unit, row.sd) if row else "–" for row in found)))
    return Table(
        f"Meshes of other topologies: {character}", (("", *MESHES.values()),), tuple(body), (*NOTES, _about(own))
    )


def charts_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's mean errors of the coarse networks on charts that are shifted and turned."""
    pattern = re.compile(r"vertex_error_mean\[half\]\[(.+)\]")
    own = [row for row in rows if row.character == character and row.method == "coarse"]
    charts = sorted((match[1] for row in own if (match := pattern.fullmatch(row.metric))), key=_amount)
    body = []
    for chart in charts:
        cells = []
        for mesh in ("half", "quarter"):
            for kind, unit, _ in KINDS:
                row = find(rows, "figure13", character, "coarse", f"{kind}_error_mean[{mesh}][{chart}]")
                cells.append(round_off(row.value, unit, row.sd) if row else "–")
        body.append((chart, *cells))
    spans = ("", MESHES["half"], "", MESHES["quarter"], "")
    notes = ("Shifts are in pixels of the coarse maps; every chart is moved on its own, in random directions.",)
    return Table(
        f"Charts that are off: {character}", (spans, ("", "mm", "degrees", "mm", "degrees")), tuple(body), notes
    )


def others_table(rows: Sequence[Row], character: str) -> Table | None:
    """Return one character's mean differences of every way to move other characters' faces from these one's rigs."""
    pattern = re.compile(r"vertex_error_mean\[([^\]]+)\]")
    own = [row for row in rows if row.character == character]
    named = dict.fromkeys(match[1] for row in own if (match := pattern.fullmatch(row.metric)))
    others = [name for name in named if name not in MESHES]
    if not others:
        return None
    body = []
    for way in LABELS:
        cells = []
        for other in others:
            for kind, unit, _ in KINDS:
                row = find(rows, "figure13", character, way, f"{kind}_error_mean[{other}]")
                cells.append(round_off(row.value, unit, row.sd) if row else "–")
        body.append((LABELS[way], *cells))
    spans = ("", *(cell for other in others for cell in (other, "")))
    units = ("", *("mm", "degrees") * len(others))
    return Table(f"Faces of other characters: {character}", (spans, units), tuple(body), (*OTHER_NOTES, _about(own)))


def _amount(chart: str) -> tuple[str, float]:
    kind, amount, _ = chart.split(" ")
    return kind, float(amount)


def _about(rows: Sequence[Row]) -> str:
    poses = max((row.poses or 0 for row in rows), default=0)
    profiles = ", ".join(sorted({row.profile for row in rows}))
    return f"{poses} test poses; {seeds_in_words([most_seeds(rows)])}; profile {profiles}."
