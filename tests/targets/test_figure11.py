"""Figure 11: its words say how many control points are dragged, and its page what its pictures show."""

import json
import re

import nbformat
import numpy as np

from replicate.base.paths import REFERENCE
from replicate.report.notebooks import NOTEBOOKS
from replicate.targets.figure11 import dragged_points


def test_one_number_of_dragged_points_is_said_once_and_two_as_a_range():
    assert dragged_points(np.array([5, 5, 5]), 22) == "5 of the 22 points are dragged"
    assert dragged_points(np.array([4, 5, 3]), 22) == "From 3 to 5 of the 22 points are dragged"
    assert dragged_points(np.array([1, 1]), 22) == "1 of the 22 points is dragged"


def committed_errors(character):
    """Return (millimetres, degrees) of each method in each row of a committed picture, as its words say them."""
    words = json.loads((REFERENCE / f"figure11_{character}.json").read_text("utf-8"))["alt"]
    found = re.findall(r"row (\d), ([^:]+): ([\d.]+) mm and ([\d.]+)°", words)
    return {(method, int(row)): (float(mm), float(degrees)) for row, method, mm, degrees in found}


def test_the_pages_answer_is_what_the_committed_pictures_show():
    page = nbformat.read(NOTEBOOKS / "figure11.ipynb", as_version=4).cells[0].source.replace("\n", " ")
    rows, cnn = range(1, 4), {}
    for character in ("teen", "woman", "toon"):
        errors = committed_errors(character)
        cnn[character] = [errors["Refined", row] for row in rows]
        for place in (0, 1):
            for row in rows:
                ours, refined, dense = (errors[name, row][place] for name in ("Regional (ours)", "Refined", "Dense"))
                is_exception = (character, row, place) == ("woman", 3, 1)
                assert ours < min(refined, dense) and (refined < dense) != is_exception, (character, row)
    assert "in every row, but for the normals of the woman's third" in page
    near, far = (choose(mm for mm, _ in cnn["toon"]) for choose in (min, max))
    few, many = (choose(degrees for _, degrees in cnn["toon"]) for choose in (min, max))
    assert f"off by {near:.1f} to {far:.1f} mm and by {few:.0f} to {many:.0f}°, more than on teen and woman" in page
    for character in ("teen", "woman"):
        assert max(mm for mm, _ in cnn[character]) < far and max(degrees for _, degrees in cnn[character]) < many
