"""Configurations of control points: what a script draws, what a file holds, and what is wrong with one."""

import tomllib

import numpy as np
import pytest

from data_recipes.recipe_paths import RECIPES, drags_file
from replicate.base.exceptions import InputError
from replicate.inverse.configurations import Drag, read_drags, scripted_drags, targets_of, write_drags

NAMES = ("brow", "chin", "nose", "lip", "lid", "cheek")


def test_a_script_drags_one_to_five_points_by_up_to_25_mm():
    drags = scripted_drags(NAMES, np.random.default_rng(1))
    assert [len(own) for own in drags] == [1, 2, 3, 4, 5] * 5
    lengths = [np.hypot(drag.x_mm, drag.y_mm) for own in drags for drag in own]
    assert 3 <= min(lengths) < 6 and 22 < max(lengths) <= 25.01
    assert all(len({drag.point for drag in own}) == len(own) for own in drags)


@pytest.mark.parametrize("character", ["teen", "woman", "dragon", "toon"])
def test_the_committed_drags_are_those_of_the_script(character):
    table = tomllib.loads((RECIPES / f"{character}.toml").read_text())["control_points"]
    names = [name for own in table.values() for name in own]
    assert read_drags(drags_file(character), names) == scripted_drags(names, np.random.default_rng(0))


def test_dragged_points_move_and_the_others_stay():
    neutral = np.arange(18, dtype=np.float32).reshape(6, 3)
    targets = targets_of(neutral, NAMES, [(Drag("chin", 1.0, -2.0),), (Drag("brow", 0.0, 3.0), Drag("lip", 4.0, 0.0))])
    moves = targets - neutral
    assert targets.shape == (2, 6, 3) and np.count_nonzero(moves) == 4
    assert moves[0, 1].tolist() == [1, -2, 0] and moves[1, 3].tolist() == [4, 0, 0]


def test_a_file_comes_back_as_it_was_written(tmp_path):
    drags = scripted_drags(NAMES, np.random.default_rng(2), 7)
    write_drags(tmp_path / "own.csv", drags)
    assert read_drags(tmp_path / "own.csv", NAMES) == drags


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("configuration,point,x_mm,y_mm\n1,ear,2.0,3.0\n", "no control point 'ear'; there are brow, chin"),
        ("configuration,point,x_mm,y_mm\n", "expected at least one drag, got none"),
        ("configuration,point,x_mm,y_mm\n1,chin,nan,3.0\n", "line 2"),
        ("configuration,point,x_mm,y_mm\n1,chin,1.0,3.0\n1,chin,2.0,3.0\n", "line 3"),
        ("point,x,y\nchin,1,2\n", "line 1"),
    ],
)
def test_what_is_wrong_with_a_file_of_drags_is_named(tmp_path, text, part):
    file = tmp_path / "own.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=part) as error:
        read_drags(file, NAMES)
    assert "own.csv" in str(error.value)
