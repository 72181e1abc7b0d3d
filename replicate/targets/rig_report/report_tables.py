"""The rig report, printed: all characters side by side, one in full, its strongest pairs, and a line of a card."""

from collections.abc import Sequence
from pathlib import Path

from replicate.methods.method_registry import in_order, method_named
from replicate.report.cast import characters_of
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off
from replicate.targets.rig_report.control_pairs import LENGTHS, read_pairs
from replicate.targets.rig_report.method_names import LABELS, features_text

TABLE = "rig_report"
STATISTICS = ("mean", "p95", "max")
KINDS = (("vertex", "mm", "Distance error, mm"), ("normal", "deg", "Normal angle error, degrees"))
UNTRIED = "–: a rig that is known by its samples alone; no pair of its controls can be tried."
COUNTS = {
    "99 % of variance": "99 % of the variance",
    "99.9 % of variance": "99.9 %",
    "99.99 % of variance": "99.99 %",
    "0.5 degrees": "a mean normal error of 0.5°",
    "0.25 degrees": "of 0.25°",
}


def report_table(rows: Sequence[Row]) -> Table:
    """Return the means of all characters side by side."""
    characters = characters_of(rows)
    body: list[tuple[str, ...] | None] = []
    for kind, unit, words in KINDS:
        body.append(_heading(f"{words}, mean over held-out poses", characters))
        body += [_line(rows, characters, label, name, f"{kind}_error_mean", unit) for name, label in LABELS.items()]
    body += [None, _heading("Principal components for", characters)]
    body += [(words, *(_count(rows, c, f"components[{what}]") for c in characters)) for what, words in COUNTS.items()]
    body += [None, _heading("Controls that can move a vertex", characters)]
    body += [
        _line(rows, characters, word, "influence", f"controls_per_vertex_{word}", "count")
        for word in ("mean", "median", "max")
    ]
    body += [None, _heading("Pairs of controls", characters)]
    body.append(_line(rows, characters, "that interact by more than 0.1 mm", "pairs", "interacting_share", "%"))
    body.append(_line(rows, characters, "mixed over single differences, RMS", "pairs", "mixed_over_single", "%"))
    body += [None, _heading("Normal error of the truth on maps, degrees", characters)]
    body += [
        _line(rows, characters, f"{size}×{size} texels a segment", "maps", f"normal_error_mean[{size}]", "deg")
        for size in map_sizes(rows)
    ]
    tried = {row.character for row in rows if row.method == "pairs"}
    notes = (_about(rows), *((UNTRIED,) if set(characters) - tried else ()))
    return Table("How hard is a rig?", (("", *characters),), tuple(body), notes)


def errors_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's held-out errors in full."""
    body = tuple((label, *_errors(rows, TABLE, character, name)) for name, label in LABELS.items())
    headers = (
        ("", "distance error, mm", "", "", "normal angle error, degrees", "", ""),
        ("", *STATISTICS, *STATISTICS),
    )
    features = features_text(lambda method, metric: _value(rows, character, method, metric))
    samples = _value(rows, character, "linear", "samples")
    notes = (f"Fitted to {samples:,.0f} training samples. {features}",) if samples else ()
    return Table(f"Held-out errors of simple fits: {character}", headers, body, notes)


def pairs_table(file: Path, character: str) -> Table | None:
    """Return the pairs of controls of `control_pairs.write_pairs`, the strongest first; None where none was tried."""
    lines = read_pairs(file).to_dict("records")
    if not lines:
        return None
    body = tuple(
        (f"{line['first']} × {line['second']}", line["segment"], line["pose"],
         *(round_off(line[name], "mm") for name in LENGTHS))
        for line in lines
    )  # fmt: skip
    header = ("", "segment", "from pose", "mixed, mm", "first alone", "second alone")
    return Table(f"Pairs of {character}'s controls that interact most", (header,), body, text_columns=3)


def beside_table2(table2: Sequence[Row], report: Sequence[Row], character: str) -> Table | None:
    """Return a character's mean errors of Table 2's methods and of the report's fits; None without either."""
    own = [row for row in table2 if row.table == "table2" and row.character == character]
    if not own or not any(row.character == character for row in report):
        return None
    lines = [(method_named(m).title, _errors(own, "table2", character, m)) for m in in_order({r.method for r in own})]
    fits = [(f"Regression on {LABELS[name]}", name) for name in ("linear", "squares", "products")]
    fits.append(("PCA basis of these regressions", "basis"))
    lines += [None, *((label, _errors(report, TABLE, character, name)) for label, name in fits)]
    body = tuple(line and (line[0], line[1][0], line[1][3]) for line in lines)
    header = ("mean over held-out poses", "distance error, mm", "normal angle error, degrees")
    note = "From `make rig-report`: ridge regressions of all rig parameters to PCA coefficients of the whole mesh."
    return Table(f"Table 2 beside simple fits: {character}", (header,), body, (note,))


def report_card(rows: Sequence[Row]) -> Table:
    """Return the table of the data card: a character a line, in the order of the paper's."""
    body = []
    for character in characters_of(rows):
        degrees = (_value(rows, character, name, "normal_error_mean") for name in ("neutral", "linear", "products"))
        body.append((
            character,
            *(round_off(value, "deg") for value in degrees),
            _count(rows, character, "components[99.9 % of variance]"),
            _count(rows, character, "components[0.25 degrees]"),
            round_off(_value(rows, character, "influence", "controls_per_vertex_median"), "count"),
            _percent(_value(rows, character, "pairs", "interacting_share")),
            _percent(_value(rows, character, "pairs", "mixed_over_single")),
        ))  # fmt: skip
    header = ("", "neutral pose, °", "straight line, °", "with products, °", "components for 99.9 %", "for 0.25°",
              "controls a vertex", "pairs > 0.1 mm", "mixed / single")  # fmt: skip
    return Table("How hard the rigs are", (header,), tuple(body))


def map_sizes(rows: Sequence[Row]) -> list[int]:
    """Return the widths of the maps that there are rows of, in pixels."""
    metrics = {row.metric for row in rows if row.table == TABLE and row.method == "maps"}
    return sorted(int(metric.partition("[")[2][:-1]) for metric in metrics if metric.startswith("normal_error"))


def _value(rows: Sequence[Row], character: str, method: str, metric: str) -> float | None:
    row = find(rows, TABLE, character, method, metric)
    return row.value if row else None


def _count(rows: Sequence[Row], character: str, metric: str) -> str:
    """Return a count of components, or "> 512" where so many are too few."""
    count, most = (_value(rows, character, "basis", name) for name in (metric, "components"))
    return f"> {most:,.0f}" if count is None and most else round_off(count, "count")


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{value:.1%}".replace("%", " %")


def _heading(words: str, characters: Sequence[str]) -> tuple[str, ...]:
    return (words, *[""] * len(characters))


def _line(
    rows: Sequence[Row], characters: Sequence[str], label: str, method: str, metric: str, unit: str
) -> tuple[str, ...]:
    cells = []
    for character in characters:
        row = find(rows, TABLE, character, method, metric)
        if unit == "%":
            cells.append(_percent(row.value if row else None))
        else:
            cells.append(round_off(row.value, unit, row.sd) if row else "–")
    return (f"– {label}", *cells)


def _errors(rows: Sequence[Row], table: str, character: str, method: str) -> tuple[str, ...]:
    cells = []
    for kind, unit, _ in KINDS:
        for statistic in STATISTICS:
            row = find(rows, table, character, method, f"{kind}_error_{statistic}")
            cells.append(round_off(row.value, unit, row.sd) if row else "–")
    return tuple(cells)


def _about(rows: Sequence[Row]) -> str:
    profiles = ", ".join(sorted({row.profile for row in rows}))
    return (
        f"Profile {profiles}. Fits: ridge regressions from all rig parameters p to coefficients of a PCA basis of the "
        "whole mesh; “> k”: more than the k components that there are."
    )
