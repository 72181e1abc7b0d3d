"""The rig report as a figure: letters of a column's size, and no more pairs than these leave room for."""

from dataclasses import replace
from itertools import combinations

import numpy as np
from plane import flat_grid

from replicate.base.paths import REFERENCE
from replicate.drawing.panels import LETTER_PT
from replicate.geometry.mesh import Mesh
from replicate.report.results import read_results
from replicate.targets.rig_report.shown import PAIRS, Measurements, maps_chart, report_figure, share_chart


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


def test_numbers_of_components_stand_inside_their_panel_and_apart():
    mesh, dragon = measurements(1)
    rows = [
        replace(row, character="dragon")
        for row in read_results(REFERENCE / "rig_report.csv")
        if row.character == "teen"
    ]
    spectrum, counts = 0.97 ** np.arange(1, 513), np.geomspace(1, 512, 20)
    curve = list(zip(counts, 4 * counts**-0.6, strict=True))
    figure, _ = report_figure(mesh, replace(dragon, rows=rows, spectrum=spectrum / spectrum.sum(), curve=curve))
    figure.draw_without_rendering()
    variance = {each.get_title(): each for each in figure.axes}["How many shapes it takes"]
    room = variance.get_window_extent()
    panels = [each for each in figure.axes if each.get_window_extent().bounds == room.bounds]
    texts = [text for panel in panels for text in panel.texts]
    boxes = [text.get_window_extent() for text in texts]
    assert "99 %: 17" in texts[0].get_text() and all(box.x0 >= room.x0 and box.x1 <= room.x1 for box in boxes)
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


def test_all_rigs_are_in_one_chart_of_fits_and_in_one_of_maps():
    rows = [row for row in read_results(REFERENCE / "rig_report.csv") if row.character in ("teen", "toon")]
    shares, words = share_chart(rows, {"teen": "a teen", "toon": "a toon"})
    assert [label.get_text() for label in shares.axes[0].get_yticklabels()] == ["a teen", "a toon"]
    assert "a teen: 23 %, 15 %, 12 %" in words.alt
    maps, words = maps_chart(rows)
    assert [line.get_label() for line in maps.axes[0].lines] == ["teen", "toon"] and "teen: 2.65" in words.alt
