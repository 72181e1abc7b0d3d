"""Tables of cells as aligned text for a terminal, HTML for a page, and Markdown and LaTeX for a paper."""

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass

from replicate.report.results import Row

_BREAK = re.compile(r"(?<=±) | (?=[±†‡◊¶§‖★☆△¤≈])")
_CODE = re.compile(r"`([^`]*)`")
_MARKUP = re.compile(r"<(?=[A-Za-z/!?])|&(?=[#\w])|(?<=\])\(|[\\*$]")  # tags, entities, links, emphasis, formulas
_CODE_OR_MARKUP = re.compile(rf"(`[^`]+`)|{_MARKUP.pattern}")
_ONE_LINE = 36  # a page keeps a cell of at most so many characters in one line
_LEFT, _CENTRE, _RULE = ' style="text-align: left"', ' style="text-align: center"', ' style="border-top: 1px solid"'


@dataclass(frozen=True)
class Table:
    """A table of cells that are ready to be shown.

    title: the line above it
    headers: header rows; a text that spans several columns is followed by empty strings
    body: the rows; None is a horizontal rule
    notes: lines below it
    text_columns: how many columns on the left hold text and are set flush left
    """

    title: str
    headers: tuple[tuple[str, ...], ...]
    body: tuple[tuple[str, ...] | None, ...]
    notes: tuple[str, ...] = ()
    text_columns: int = 1


def round_off(value: float | None, unit: str, sd: float | None = None) -> str:
    """Return a value for a table: with two decimals, three below 0.1 mm, none for counts and seconds; "–" for None.

    A standard deviation that would round to zero gets up to two more decimals, if that shows a digit of it.
    """
    if value is None:
        return "–"
    digits = 3 if unit == "mm" and value < 0.0995 else {"count": 0, "s": 0}.get(unit, 2)
    if sd is None:
        return f"{value:,.{digits}f}"
    finer = next((more for more in range(digits, digits + 3) if round(sd, more)), digits)
    return f"{value:,.{digits}f} ± {sd:.{finer}f}"


def our_value(row: Row | None, spread: bool = True) -> str:
    """Return a value of ours for a table, with its standard deviation if `spread`; "–" for a row that is missing."""
    return round_off(row.value, row.unit, row.sd if spread else None) if row else "–"


def paper_value(row: Row | None) -> str:
    """Return a value of the paper's with its printed digits; "?" marks one that the scan makes doubtful."""
    if row is None:
        return "–"
    digits = {"mm": 2, "deg": 1, "MB": 2, "count": 0}.get(row.unit)
    value = repr(row.value) if digits is None else f"{row.value:,.{digits}f}"
    return value + ("?" if "doubtful" in row.run else "")


def as_text(table: Table) -> str:
    """Return the table aligned for a terminal."""
    width = _widths(table)
    lines = [table.title, ""]
    lines += [_span_line(header, width, table.text_columns) for header in table.headers[:-1]]
    lines.append(_text_line(table.headers[-1], width, table.text_columns))
    rule = "─" * len(lines[-1])
    lines.append(rule)
    lines += [rule if row is None else _text_line(row, width, table.text_columns) for row in table.body]
    if table.notes:
        lines += ["", *table.notes]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def as_markdown(table: Table) -> str:
    """Return the table in GitHub's Markdown; headers that span columns are joined with those below them."""
    header = list(table.headers[-1])
    for upper in table.headers[:-1]:
        header = [
            f"{span}: {cell}" if span and cell else cell or span
            for span, cell in zip(_fill(upper), header, strict=True)
        ]
    sides = [":--" if column < table.text_columns else "--:" for column in range(len(header))]
    lines = [f"**{plain_markdown(table.title)}**", "", _bar(header), _bar(sides)]
    lines += [_bar(row) for row in table.body if row is not None]
    if table.notes:
        lines += ["", plain_markdown("\n".join(table.notes)).replace("\n", "<br>")]  # code may begin in one note
    return "\n".join(lines) + "\n"


def plain_markdown(text: str) -> str:
    """Return Markdown that shows a text unchanged, whatever names are in it; only `code` stays code.

    A name that a user gave a region, say, can then make no tag, link or image.
    """
    if "``" in text:  # Markdown readers disagree on where such code ends, so none is kept
        return _MARKUP.sub(_entity, text)
    return _CODE_OR_MARKUP.sub(lambda found: found[1] or _entity(found), text)


def _entity(found: re.Match) -> str:
    return f"&#{ord(found[0])};"


MANY_COLUMNS = 8  # tables of more have smaller letters on pages


def as_html(table: Table, folded: bool = False) -> str:
    """Return the table as HTML, with headers that span columns, and short labels in one line.

    folded: show the title alone until a reader clicks it.
    """
    title = f"<b>{_html(table.title)}</b>"
    head = "".join(_html_header(header, table.text_columns) for header in table.headers)
    above = [None, *table.body]  # a rule is the upper border of the row after it
    rows = [
        _html_row(row, table.text_columns, before is None and k > 0)
        for k, (before, row) in enumerate(zip(above, table.body, strict=False))
        if row is not None
    ]
    size = ' style="font-size: 85%"' if len(table.headers[-1]) > MANY_COLUMNS else ""
    whole = f"<table{size}><thead>{head}</thead>\n<tbody>\n" + "\n".join(rows) + "\n</tbody></table>"
    if table.notes:
        whole += "\n<p>" + "<br>\n".join(unbroken(_html(note)) for note in table.notes) + "</p>"
    if folded:
        return f"<details><summary>{title}</summary>\n{whole}\n</details>"
    return f"<p>{title}</p>\n{whole}"


def unbroken(text: str) -> str:
    """Return a text in which no line breaks beside ± or before the mark of a note, however narrow the page.

    Its no-break spaces hinder searching, so texts that people search are better left alone.
    """
    return _BREAK.sub("\u00a0", text)


def as_latex(table: Table) -> str:
    """Return the table as a LaTeX tabular (packages: booktabs) with its title as the caption."""
    sides = ["l" if column < table.text_columns else "r" for column in range(len(table.headers[-1]))]
    lines = [
        r"\begin{table}",
        rf"\caption{{{_tex(table.title)}}}",
        rf"\begin{{tabular}}{{{''.join(sides)}}}",
        r"\toprule",
    ]
    for header in table.headers[:-1]:
        spans = _spans(header)
        lines.append(
            " & ".join(rf"\multicolumn{{{n}}}{{c}}{{{_tex(text)}}}" if n > 1 else _tex(text) for text, n in spans)
            + r" \\"
        )
    lines += [" & ".join(map(_tex, table.headers[-1])) + r" \\", r"\midrule"]
    lines += [r"\midrule" if row is None else " & ".join(map(_tex, row)) + r" \\" for row in table.body]
    lines += [r"\bottomrule", r"\end{tabular}"]
    lines += [rf"\par\footnotesize {_tex(note)}" for note in table.notes]
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def _widths(table: Table) -> list[int]:
    cells = [table.headers[-1], *(row for row in table.body if row is not None)]
    width = [max(len(row[k]) for row in cells) for k in range(len(cells[0]))]
    for header in table.headers[:-1]:  # a span may be wider than its columns
        start = 0
        for text, n in _spans(header):
            missing = len(text) - (sum(width[start : start + n]) + 2 * (n - 1))
            if missing > 0:
                width[start + n - 1] += missing
            start += n
    return width


def _text_line(cells: Sequence[str], width: Sequence[int], text_columns: int) -> str:
    return "  ".join(_aligned(cell, w, k < text_columns) for k, (cell, w) in enumerate(zip(cells, width, strict=True)))


def _aligned(text: str, room: int, left: bool) -> str:
    return text.ljust(room) if left else text.rjust(room)


def _span_line(header: Sequence[str], width: Sequence[int], text_columns: int) -> str:
    parts, start = [], 0
    for text, n in _spans(header):
        room = sum(width[start : start + n]) + 2 * (n - 1)
        parts.append(text.center(room) if n > 1 else _aligned(text, room, start < text_columns))
        start += n
    return "  ".join(parts)


def _spans(header: Sequence[str]) -> list[tuple[str, int]]:
    """Return (text, columns) pairs: a text spans the empty cells that follow it; the first cell stands alone."""
    spans = [[header[0], 1]]
    for text in header[1:]:
        if text or len(spans) == 1:
            spans.append([text, 1])
        else:
            spans[-1][1] += 1
    return [(text, n) for text, n in spans]


def _fill(header: Sequence[str]) -> list[str]:
    return [text for text, n in _spans(header) for _ in range(n)]


def _html(text: str) -> str:
    return _CODE.sub(r"<code>\1</code>", html.escape(text, quote=False))


def _html_cell(text: str) -> str:
    return _html(text.replace(" ", "\u00a0") if len(text) <= _ONE_LINE else unbroken(text))


def _html_header(header: Sequence[str], text_columns: int) -> str:
    cells, start = [], 0
    for text, n in _spans(header):
        span = f' colspan="{n}"{_CENTRE}' if n > 1 else _LEFT if start < text_columns else ""
        cells.append(f"<th{span}>{_html(unbroken(text))}</th>")
        start += n
    return f"<tr>{''.join(cells)}</tr>"


def _html_row(row: Sequence[str], text_columns: int, ruled: bool) -> str:
    if len(row) > 1 and not any(row[1:]):  # the heading of those that follow
        cells = f'<th colspan="{len(row)}"{_LEFT}>{_html(row[0])}</th>'
    else:
        cells = "".join(f"<td{_LEFT if k < text_columns else ''}>{_html_cell(cell)}</td>" for k, cell in enumerate(row))
    return f"<tr{_RULE if ruled else ''}>{cells}</tr>"


def _bar(cells: Sequence[str]) -> str:
    # a plain "|" would end the cell, even inside code
    return "| " + " | ".join(plain_markdown(cell).replace("|", "&#124;") for cell in cells) + " |"


def _tex(text: str) -> str:
    return text.translate(_TEX)


_TEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "{": r"\{",
        "}": r"\}",
        "#": r"\#",
        "$": r"\$",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "&": r"\&",
        "%": r"\%",
        "_": r"\_",
        "|": r"\textbar{}",
        "–": "--",
        "±": r"$\pm$",
        "×": r"$\times$",
        "†": r"$\dagger$",
        "‡": r"$\ddagger$",
        "§": r"\S{}",
        "¶": r"\P{}",
        "★": r"$\star$",
        "☆": r"$\ast$",  # without a package there is one star
        "‖": r"$\parallel$",
        "¤": r"$\circ$",
        "◊": r"$\diamond$",
        "△": r"$\triangle$",
        "≈": r"$\approx$",
        "≤": r"$\le$",
        "°": r"$^\circ$",
        "τ": r"$\tau$",
    }
)
