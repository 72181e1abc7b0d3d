"""A claim's numbers as a chart: ours beside the paper's, as ratios that the claim wants below 1."""

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import WIDTH, tidy
from replicate.targets.claims.evidence import Evidence, MissingNumber, stand_in
from replicate.targets.claims.paper_claims import claim_named
from replicate.targets.claims.verdict_rules import Comparison, significant

if TYPE_CHECKING:
    import matplotlib.figure

OURS, THEIRS = "#1F6FB4", "#333333"
PANELS = 4  # in a row
ROW, TITLE, FRAME = 0.3, 1.0, 0.8  # inches: a comparison, what is around a row of panels, and around all of them
LETTERS, LINE = 30, 0.2  # in a line of what is compared; inches that each further line takes
SIZE_PT, TITLE_PT = 12, 11  # of letters; a panel's names are as wide as it
MOST_DECADES = 2.5  # beyond that the numbers of all ticks have no room
LEAST = 0.02  # a smaller ratio stands at the left end of its panel, as an arrow with its bound
TICKS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20)

Pairs = dict[str, tuple[Comparison | None, Comparison | None]]


def claim_chart(evidence: Evidence, paper: Evidence, claim: str) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): a panel for each character, our ratios as dots and the paper's as rings.

    claim: its number, "C1". A ratio is that of the two numbers that the claim compares, the one that it wants to be the
    smaller over the other; one below `LEAST` is an arrow, so that it takes no room from the others. Characters of which
    it compares other things have a row of panels of their own. None where neither we nor the paper have numbers.
    """
    from matplotlib.figure import Figure

    panels = {character: pairs_of(evidence, paper, claim, character) for character in evidence.characters()}
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
            phrases += _draw(axes, names, panels[character], character, limits)
            axes.set_title(_title(panels[character], character, has[1]), fontsize=TITLE_PT, loc="left")
            axes.set_yticks(range(len(names)), lines[r] if c == 0 else [])
            axes.tick_params(labelsize=SIZE_PT)
    _legend(figure, has)
    of_what = f"{quantity}s" if quantity else "the two numbers"
    figure.supxlabel(f"ratio of {of_what}; in grey, against the claim", fontsize=SIZE_PT)
    about = "its numbers as ratios, dots ours, rings the paper's; the claim wants them left of 1"
    about += f"; an arrow is one below {LEAST:g}" if small else ""
    alt = f"Dots and rings of ratios for claim {claim}. Ours: {'; '.join(phrases) or 'none yet'}."
    return figure, Words(alt, f"{claim}, {claim_named(claim).text}: {about}.")


def _rows(panels: dict[str, Pairs]) -> list[tuple[list[str], list[str]]]:
    """Return (what is compared, characters) of each row of panels: no character has lines that are of others alone."""
    groups: dict[frozenset[str], list[str]] = {}
    for character, pairs in panels.items():
        groups.setdefault(frozenset(pairs), []).append(character)
    parts = [members[k : k + PANELS] for members in groups.values() for k in range(0, len(members), PANELS)]
    return [(list(panels[part[0]]), part) for part in parts]


def _shared_quantity(names: list[str]) -> str:
    """Return the quantity that all lines compare, or "" where they differ."""
    quantities = {name.partition(": ")[0] for name in names}
    return quantities.pop() if len(quantities) == 1 else ""


def _draw(axes, names: list[str], pairs: Pairs, character: str, limits: tuple[float, float]) -> list[str]:
    """Draw a character's panel, and return our ratios in words."""
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
            axes.errorbar(ours.ratio, y, xerr=_half_width(ours), fmt="o", color=OURS, markersize=6, capsize=3)
        if ours:
            phrases.append(f"{character}, {name}: {significant(ours.ratio, 2)}")
    axes.set_xscale("log")
    axes.set_xlim(lower, upper)
    decades = math.log10(upper / lower)
    wide = [10.0**k for k in range(-12, 13, math.ceil(decades / 3))] if decades > MOST_DECADES else TICKS
    ticks = [tick for tick in wide if lower < tick < upper]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(len(names) - 0.5, -0.5)
    tidy(axes)
    return phrases


def _title(pairs: Pairs, character: str, published: bool) -> str:
    """Return whose numbers a panel has: ours and, where the paper has some for any panel, the paper's below."""
    film = stand_in(character)
    has = [any(pair[k] for pair in pairs.values()) for k in (0, 1)]
    ours = f"● {character}{', ours' if film else ''}" if has[0] else f"{character}: not tested"
    theirs = f"○ {film}, paper" if has[1] else "paper: no number"
    return f"{ours}\n{theirs}" if published else ours


def _arrow(axes, lower: float, y: int) -> float:
    """Write the bound of a ratio below `LEAST` beside its arrow, and return where that stands."""
    place = 1.25 * lower
    style = {"textcoords": "offset points", "va": "center", "fontsize": SIZE_PT}
    axes.annotate(f"< {LEAST:g}", (place, y), (8, 0), **style)
    return place


def _legend(figure: "matplotlib.figure.Figure", has: Sequence[bool]) -> None:
    """Say what dots and rings are. has: whether there are any of ours, and of the paper's."""
    from matplotlib.lines import Line2D

    dot = Line2D([], [], marker="o", linestyle="", color=OURS, label="our characters")
    ring = Line2D([], [], marker="o", linestyle="", markerfacecolor="none", markersize=11, color=THEIRS)
    ring.set_label("the paper’s characters")
    handles = [handle for handle, there in zip((dot, ring), has, strict=True) if there]
    figure.legend(handles=handles, loc="outside upper right", ncols=2, frameon=False, fontsize=SIZE_PT)


def pairs_of(evidence: Evidence, paper: Evidence, claim: str, character: str) -> Pairs:
    """Return what a claim compares, in words → (our numbers, the paper's), None for what either lacks."""
    ways = claim_named(claim).ways
    ours, theirs = (
        _comparisons(ways, rows, who) for rows, who in ((evidence, character), (paper, stand_in(character)))
    )
    return {name: (ours.get(name), theirs.get(name)) for name in {**ours, **theirs}}


def _comparisons(ways, evidence: Evidence, character: str) -> dict[str, Comparison]:
    try:
        return {one.name: one for way in ways(evidence, character) for one in way}
    except MissingNumber:
        return {}


def _half_width(comparison: Comparison) -> float | None:
    """Return what a bar shows of the spread: to the line at 1 if the difference is just what the rule needs."""
    return comparison.spread / comparison.right.value if comparison.spread else None
