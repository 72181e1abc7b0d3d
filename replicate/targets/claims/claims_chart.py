"""A claim's numbers as a chart: ours beside the paper's, as ratios that the claim wants below 1."""

from typing import TYPE_CHECKING

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import tidy
from replicate.targets.claims.evidence import Evidence, MissingNumber, stand_in
from replicate.targets.claims.paper_claims import claim_named
from replicate.targets.claims.verdict_rules import SPREADS, Comparison, significant

if TYPE_CHECKING:
    import matplotlib.figure

OURS, THEIRS = "#1F6FB4", "#333333"
PANEL, LABELS, ROW, FRAME = 1.75, 2.2, 0.3, 1.1  # inches: a panel, what is left of them, a line, what is around


def claim_chart(evidence: Evidence, paper: Evidence, claim: str) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): a panel for each character, our ratios as dots and the paper's as rings.

    claim: its number, "C1". A ratio is that of the two numbers that the claim compares, the one that it wants to be the
    smaller over the other. None where neither we nor the paper have numbers.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    panels = {character: pairs_of(evidence, paper, claim, character) for character in evidence.characters()}
    panels = {character: pairs for character, pairs in panels.items() if pairs}
    if not panels:
        return None
    names = list(dict.fromkeys(name for pairs in panels.values() for name in pairs))
    figure = Figure((LABELS + PANEL * max(3, len(panels)), ROW * len(names) + FRAME), dpi=DPI, layout="constrained")
    axes_of = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    ratios = [c.ratio for pairs in panels.values() for pair in pairs.values() for c in pair if c and c.ratio > 0]
    lower, upper = min([*ratios, 0.8]) / 1.25, max([*ratios, 1.25]) * 1.25
    phrases = []
    for axes, (character, pairs) in zip(axes_of, panels.items(), strict=True):
        axes.axvspan(1.0, upper, color="0.93", zorder=0)
        axes.axvline(1.0, color="0.4", linewidth=0.8, zorder=1)
        for y, name in enumerate(names):
            ours, theirs = pairs.get(name, (None, None))
            if theirs:
                axes.plot(theirs.ratio, y, "o", markerfacecolor="none", markeredgecolor=THEIRS, markersize=8, zorder=4)
            if ours:
                axes.errorbar(ours.ratio, y, xerr=_half_width(ours), fmt="o", color=OURS, markersize=6, capsize=3)
                phrases.append(f"{character}, {name}: {significant(ours.ratio, 2)}")
        axes.set_title(f"{character}\n{stand_in(character) or '–'}", fontsize=9)
        axes.set_yticks(range(len(names)), names, fontsize=8)
        axes.set_xscale("log")
        axes.set_xlim(lower, upper)
        ticks = [t for t in (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20) if lower < t < upper]
        axes.set_xticks(ticks, [f"{t:g}" for t in ticks], fontsize=8)
        axes.minorticks_off()
        axes.set_ylim(len(names) - 0.5, -0.5)
        tidy(axes)
    dot = Line2D([], [], marker="o", linestyle="", color=OURS, label="ours")
    ring = Line2D([], [], marker="o", linestyle="", markerfacecolor="none", color=THEIRS, label="the paper's")
    figure.legend(handles=[dot, ring], loc="outside lower right", ncols=2, frameon=False, fontsize=8)
    figure.supxlabel("ratio of the two numbers; in grey, against the claim", fontsize=8)
    about = "its numbers as ratios, dots ours, rings the paper's; the claim wants them left of 1"
    alt = f"Dots and rings of ratios for claim {claim}. Ours: {'; '.join(phrases) or 'none yet'}."
    return figure, Words(alt, f"{claim}, {claim_named(claim).text}: {about}.")


def pairs_of(
    evidence: Evidence, paper: Evidence, claim: str, character: str
) -> dict[str, tuple[Comparison | None, Comparison | None]]:
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
    return SPREADS * _sd(comparison) / comparison.right.value if _sd(comparison) else None


def _sd(comparison: Comparison) -> float:
    return (comparison.left.sd or 0.0) + (comparison.right.sd or 0.0)
