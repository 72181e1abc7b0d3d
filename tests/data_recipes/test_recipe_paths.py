"""Recipes by name: those that come along, those whose data lies elsewhere, and files of one's own."""

from pathlib import Path

import pytest
from sample_folders import write

from data_recipes.recipe_paths import (
    OUTSIDE,
    RECIPES,
    character_label,
    character_names,
    in_command,
    named,
    recipe_file,
    sample_folder,
    split_character,
)
from replicate.base.exceptions import InputError
from replicate.base.user_files import words
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


@pytest.mark.parametrize("file", ["mesh.obj", "head.PLY", "head.glb", "controls.csv", "face.toml"])
def test_a_folder_of_samples_is_named_by_any_file_that_says_what_it_is(tmp_path, monkeypatch, file):
    folder = write(tmp_path / "my face")
    if not (folder / file).exists():
        (folder / file).write_bytes(b"")
    monkeypatch.chdir(folder)
    assert named(str(folder / file)) == str(folder) == named(file) == named(f"../my face/{file}")
    assert resolve(str(folder / file), "quick") == resolve(str(folder), "quick")


def test_a_face_file_without_its_controls_still_names_its_folder_where_poses_are(tmp_path):
    folder = write(tmp_path / "mine")
    (folder / "controls.csv").unlink()
    assert named(f"{folder}/face.toml") == str(folder)


def test_a_mesh_that_belongs_to_no_folder_of_samples_stays_what_it_is(tmp_path):
    (tmp_path / "mesh.obj").write_text("")
    assert named(f"{tmp_path}/mesh.obj") == f"{tmp_path}/mesh.obj"
    with pytest.raises(InputError, match=r"face\.toml: there is no such file, which a folder of samples has"):
        resolve(f"{tmp_path}/mesh.obj", "quick")


def test_a_file_or_folder_that_is_nearly_meant_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "head.glb").write_bytes(b"")
    (tmp_path / "face").mkdir()
    (tmp_path / "face" / "poses").mkdir()
    (tmp_path / "avatars").mkdir()
    (tmp_path / "avatars" / "anna.glb").write_bytes(b"")
    (tmp_path / "mine.toml").write_text("")
    says = {
        "hed.glb": r"hed\.glb: there is no such file; did you mean head\.glb\?",
        "head": r"there is no character head; did you mean the file head\.glb\?",
        "mime.toml": r"mime\.toml: there is no such recipe file; did you mean mine\.toml\?",
        "face": r"face/face\.toml: there is no such file, which a folder of samples has \(REPRODUCING\.md says what",
        "./avatars": r"which a folder of samples has; anna\.glb in this folder is a character by itself: name",
    }
    for character, words_ in says.items():
        with pytest.raises(InputError, match=words_):
            resolve(character, "quick")


def test_a_command_names_a_character_so_that_it_can_be_typed_anywhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "my face"), write(tmp_path / "mine")
    for character in ("my face", "./my face", f"{tmp_path}/my face/mesh.obj"):
        assert words(in_command(named(character))) == [f"{tmp_path}/my face"]
    assert in_command("mine") == f"{tmp_path}/mine" and in_command("own.toml@3") == f"{tmp_path}/own.toml@3"
    assert in_command("teen@one_face") == "teen@one_face"
    assert in_command("somebody") == "<recipe or folder of somebody>"


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
