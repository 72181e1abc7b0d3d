"""The rig report as a figure: letters of a column's size, and no more pairs than these leave room for."""

import numpy as np
from plane import flat_grid

from replicate.base.paths import REFERENCE
from replicate.drawing.panels import LETTER_PT
from replicate.geometry.mesh import Mesh
from replicate.report.results import read_results
from replicate.targets.rig_report.shown import PAIRS, Measurements, report_figure


def measurements(count: int) -> tuple[Mesh, Measurements]:
    """A plate, and the dragon's committed rows, with so many pairs of controls."""
    flat, faces = flat_grid(np.linspace(-90, 90, 9), np.linspace(-90, 90, 9), 40)
    mesh = Mesh(flat, faces, (flat[:, :2] + 90) / 180, np.zeros(81, np.int32), ("face",))
    rows = [row for row in read_results(REFERENCE / "rig_report.csv") if row.character == "dragon"]
    pairs = [("jaw_open", "smile_left", "face", "animation", 9.0 - k, 1.0, 1.0) for k in range(count)]
    spectrum = 0.5 ** np.arange(1, 513)
    curve = [(1, 5.0), (512, 0.3)]
    return mesh, Measurements("dragon", rows, pairs, spectrum, curve, np.arange(81), np.full(81, 0.1))


def test_the_strongest_pairs_are_shown_by_their_names_and_everything_in_a_columns_letters():
    figure, words = report_figure(*measurements(10))
    axes = {each.get_title(): each for each in figure.axes}["Which controls interact most"]
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["jaw open\n× smile L"] * PAIRS and len(axes.patches) == PAIRS < 10
    assert figure.get_size_inches()[0] == 10.0 and "dragon" in words.caption
    assert {label.get_fontsize() for each in figure.axes for label in each.get_xticklabels()} == {LETTER_PT}
