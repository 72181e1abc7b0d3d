"""Recipes by name: those that come along, those whose data lies elsewhere, and files of one's own."""

from pathlib import Path

import pytest
from sample_folders import write

from data_recipes.recipe_paths import (
    OUTSIDE,
    RECIPES,
    character_label,
    character_names,
    named,
    recipe_file,
    sample_folder,
    split_character,
)
from replicate.base.exceptions import InputError
from replicate.config import resolve


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


def test_a_folder_of_samples_is_named_by_its_face_file_too(tmp_path):
    folder = write(tmp_path / "mine")
    assert named(f"{folder}/face.toml") == str(folder) == named(str(folder))
    assert resolve(f"{folder}/face.toml", "quick") == resolve(str(folder), "quick")
    (tmp_path / "face.toml").write_text((RECIPES / "tiny.toml").read_text())
    assert named(f"{tmp_path}/face.toml") == f"{tmp_path}/face.toml", "a recipe may be called so"


def test_a_face_file_is_named_from_within_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(write(tmp_path / "mine"))
    assert sample_folder(named("face.toml")) == tmp_path / "mine"


def test_a_tilde_is_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    folder = write(tmp_path / "mine")
    (tmp_path / "own.toml").write_text((RECIPES / "tiny.toml").read_text())
    assert resolve("~/mine", "quick") == resolve(str(folder), "quick")
    assert recipe_file(resolve("~/own.toml@one_face", "quick").character) == tmp_path / "own.toml"
    with pytest.raises(InputError, match="no such home folder"):
        named("~nobody_at_all/mine")


def test_results_have_the_name_of_a_folder_or_where_it_names_no_file_that_of_its_face_file(tmp_path):
    assert character_label(str(write(tmp_path / "mine-2"))) == "mine-2"
    folder = write(tmp_path / "my face, (2)")
    assert character_label(str(folder)) == "box" and resolve(str(folder), "quick").character == str(folder)
    (folder / "face.toml").write_text("unit = 3")
    with pytest.raises(InputError, match=r"folders can't be called 'my face, .2.'"):
        resolve(str(folder), "quick")
