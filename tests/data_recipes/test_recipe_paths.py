"""Recipes by name: those that come along, those whose data lies elsewhere, and files of one's own."""

from pathlib import Path

import pytest

from data_recipes.recipe_paths import OUTSIDE, RECIPES, character_label, character_names, recipe_file, split_character


def test_a_character_is_there_for_each_recipe_and_each_folder_that_a_variable_names(monkeypatch, tmp_path):
    for variable in OUTSIDE.values():
        monkeypatch.delenv(variable, raising=False)
    assert character_names() == tuple(sorted(path.stem for path in RECIPES.glob("*.toml")))
    monkeypatch.setenv("ICT_FACEKIT", str(tmp_path))
    assert character_names()[-1] == "ict"


@pytest.mark.parametrize("name, place", [("tiny", "tiny.toml"), ("ict", "ict/ict.toml"), ("nobody", "nobody.toml")])
def test_a_name_stands_for_a_recipe_of_the_projects(name, place):
    assert recipe_file(name) == RECIPES / place


def test_a_path_stands_for_itself(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert recipe_file("mine.toml") == Path(tmp_path / "mine.toml").resolve()


@pytest.mark.parametrize(
    ("character", "label"),
    [("teen", "teen"), ("teen@one_face", "teen@one_face"), ("my@folder/mine.toml@fine@3", "mine@fine@3")],
)
def test_a_variant_has_the_same_recipe_and_a_label_of_its_own(character, label):
    name, variants = split_character(character)
    assert recipe_file(character) == recipe_file(name)
    assert character_label(character) == label == "@".join([recipe_file(name).stem, *variants])
