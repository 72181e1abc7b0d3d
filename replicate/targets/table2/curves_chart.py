"""Validation error of the networks against training step, with the floors that their maps set."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import LETTER_PT, MEASURES, WIDTH, enlarge, error_scale, tidy
from replicate.methods.method_registry import in_order, method_named, methods
from replicate.report.results import Row, find
from replicate.report.training_curves import Curve

if TYPE_CHECKING:
    import matplotlib.figure

FLOORS = {"coarse": "--", "refined": (0, (1, 2))}  # dashes and dots: the two may lie on each other


def training_curves(
    curves: Mapping[tuple[str, str], Curve], rows: Sequence[Row], character: str
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both errors of one character's networks on the validation poses.

    rows: Table 2's results, for the floors (dashed and dotted).
    """
    from matplotlib.figure import Figure

    figure = Figure((WIDTH, 4.6), dpi=DPI, layout="constrained")
    ends = []
    for axes, column, (metric, _, label) in zip(figure.subplots(1, 2), (2, 3), MEASURES, strict=True):
        for method in map(method_named, in_order(name for who, name in curves if who == character)):
            if method.in_figures:
                curve = curves[character, method.name]
                steps, errors = [row[0] for row in curve], [row[column] for row in curve]
                axes.plot(steps, errors, color=method.colour, linewidth=2.2, label=method.label)
                ends.append(f"{method.label} ends at {curve[-1][column]:.2f} {'mm' if column == 2 else 'degrees'}")
        for floor in methods().values():
            if floor.floor_of and (row := find(rows, "table2", character, floor.name, metric)):
                style = FLOORS.get(floor.floor_of, "--")
                axes.axhline(row.value, color=floor.colour, linestyle=style, linewidth=2, label=floor.label)
        error_scale(axes, "y")
        axes.set_xlim(left=0)
        axes.set_xlabel("training step")
        axes.set_ylabel(label)
        axes.locator_params(axis="x", nbins=4)
        tidy(axes)
        enlarge(axes)
    if ends:  # methods without training alone have no curve
        lines = axes.get_legend_handles_labels()
        figure.legend(*lines, frameon=False, fontsize=LETTER_PT, ncols=3, loc="outside upper center")
    return figure, Words(
        f"Two line charts of validation error against training step for {character}: {'; '.join(ends)}.",
        f"Error of {character}'s networks on the validation poses as training goes on; the refined network starts "
        "where the coarse one ended. Dashed and dotted: what the maps' resolution allows on the test poses (Table 2's "
        "floors). Validation poses are others than those of Table 2, so the ends differ from its numbers.",
    )
