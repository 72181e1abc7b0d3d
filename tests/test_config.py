"""The paper's numbers are the defaults; whatever is unknown or out of range is one sentence."""

import dataclasses

import pytest

from data_recipes import recipe_paths
from data_recipes.recipe.reading import load_recipe
from replicate import config
from replicate.base.exceptions import InputError
from replicate.base.schema import from_json, to_json
from replicate.config import PROFILES, Config, resolve


@pytest.fixture
def recipe(tmp_path):
    file = tmp_path / "someone.toml"
    file.write_text("")
    return str(file)


def overriding(tmp_path, recipe, text):
    file = tmp_path / "mine.toml"
    file.write_text(text)
    return resolve(recipe, "laptop", file=file)


def test_the_defaults_are_the_papers(recipe):
    paper = resolve(recipe, "paper")
    assert paper == Config(recipe, profile="paper")
    assert (paper.samples.count, paper.samples.bins, paper.samples.split) == (50_000, 16, "frames")
    assert (paper.samples.low, paper.samples.high, paper.samples.held_out) == (0.25, 3.0, 0.1)
    assert (paper.coarse.map_size, paper.refinement.map_size, paper.refinement.square) == (32, 64, 0.25)
    assert (paper.coarse.normal_weight, paper.coarse.training.batch) == (5.0, 8)
    assert (paper.coarse.training.schedule, paper.coarse.training.rates) == ("paper", (1e-3, 1e-4, 1e-5))
    assert paper.dense.hidden == (256, 256)
    assert (paper.rigid.tau_mm, paper.rigid.attachments) == (0.3, 10)
    assert (paper.lbs.bones, paper.lbs.influences, paper.lbs.samples) == ((16, 24, 32), 8, 1_000)
    assert paper.evaluation.test_poses == 0


@pytest.mark.parametrize("profile", PROFILES)
def test_every_profile_resolves_and_keeps_its_name(recipe, profile):
    assert resolve(recipe, profile, seed=3).profile == profile


def test_a_file_overrides_a_profile_and_values_override_both(tmp_path, recipe):
    file = tmp_path / "mine.toml"
    file.write_text("[coarse]\nmap_size = 64\n[coarse.training]\nsteps = 5\n[lbs]\nbones = [4, 6]\n")
    mine = resolve(recipe, "laptop", file=file, seed=9)
    assert (mine.coarse.map_size, mine.coarse.training.steps, mine.seed) == (64, 5, 9)
    assert mine.coarse.training.schedule == "one_cycle", "the profile's other values stay"
    assert mine.lbs.bones == (4, 6)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("colour = 1", ["unknown key colour", "samples"]),
        ("[coarse]\nmapsize = 32", ["unknown key coarse.mapsize", "map_size"]),
        ("[coarse.training]\nbatch = 0", ["coarse.training.batch: expected", "from 1 to 4096, got 0"]),
        ("[coarse.training]\nbatch = 8.5", ["coarse.training.batch: expected a whole number", "got 8.5"]),
        ("[coarse.training]\nbatch = true", ["coarse.training.batch: expected a whole number", "got True"]),
        ("[coarse.training]\nrates = [1e-3]", ["coarse.training.shares", "1 numbers"]),
        (
            "[coarse.training]\nschedule = 'cosine'",
            ["coarse.training.schedule: expected paper, one_cycle or two_cycles, got 'cosine'"],
        ),
        ("[coarse]\nhidden = [32, 32]", ["coarse.hidden", "multiple of 64", "got [32, 32]"]),
        ("[refinement]\nhidden = [100]", ["refinement.hidden", "multiple of 64", "got [100]"]),
        ("[coarse]\nmap_size = 33", ["coarse.map_size: expected a power of two", "got 33"]),
        ("[coarse]\nnormal_weight = nan", ["coarse.normal_weight: expected a number", "got nan"]),
        ("[coarse]\nnormal_weight = inf", ["coarse.normal_weight: expected a number", "got inf"]),
        ("coarse = 3", ["coarse: expected a table [coarse], got 3"]),
        ("[samples]\nhigh = 0.1", ["samples.high: expected", "at least low", "got 0.1"]),
        ("[samples]\nsplit = 'poses'", ["samples.split: expected frames or clips, got 'poses'"]),
        ("[samples]\nheld_out = 1.0", ["samples.held_out: expected", "from 0.001 to 0.9, got 1.0"]),
        ("[lbs]\nbones = []", ["lbs.bones: expected", "one or more", "got []"]),
        ("[lbs]\nbones = [16, 'x']", ["lbs.bones", "whole number"]),
        ("profile = 'quick'", ["profile can't be set here", "PROFILE="]),
        ("character = 'teen'", ["character can't be set here", "CHARACTERS="]),
        ("seed = 1", ["seed can't be set here", "SEED="]),
        ("device = 'cpu'", ["device can't be set here", "DEVICE="]),
        ("[coarse\n", ["not a readable TOML file"]),
    ],
)
def test_a_bad_override_is_one_sentence_naming_file_key_value_and_what_is_allowed(tmp_path, recipe, text, parts):
    with pytest.raises(InputError) as error:
        overriding(tmp_path, recipe, text)
    sentence = str(error.value)
    assert sentence.startswith(str(tmp_path / "mine.toml"))
    assert all(part in sentence for part in parts), sentence
    assert "\n" not in sentence


def test_a_missing_override_file_is_named(recipe, tmp_path):
    with pytest.raises(InputError, match=r"mine\.toml: there is no such file"):
        resolve(recipe, "laptop", file=tmp_path / "mine.toml")


def test_an_unknown_profile_lists_those_there_are(recipe):
    with pytest.raises(InputError, match=r"^there is no profile fast: there are quick, laptop, paper$"):
        resolve(recipe, "fast")
    with pytest.raises(InputError, match=r"^there is no profile Labtop; did you mean laptop\?$"):
        resolve(recipe, "Labtop")


def test_an_unknown_character_lists_those_there_are(tmp_path, monkeypatch):
    for name in ("teen", "tiny"):
        (tmp_path / f"{name}.toml").write_text("")
    monkeypatch.setattr(recipe_paths, "RECIPES", tmp_path)
    assert resolve("tiny").character == "tiny"
    with pytest.raises(InputError, match=r"^there is no character valka: there are teen, tiny, and paths of"):
        resolve("valka")


@pytest.mark.parametrize("name", ["Hiccup", "VALKA", "toothless", "ray"])
def test_a_character_of_the_papers_is_told_who_plays_it_here(name):
    who = {"Hiccup": "teen", "VALKA": "woman", "toothless": "dragon", "ray": "toon"}[name]
    for refuse in (resolve, load_recipe):
        with pytest.raises(InputError) as caught:
            refuse(name)
        assert str(caught.value) == f"{name.capitalize()}'s part is played by the {who}: CHARACTERS={who}"


@pytest.mark.parametrize(("word", "near"), [("tean", "teen"), ("Dragon", "dragon"), ("wom\nan", "woman")])
def test_a_mistyped_character_gets_the_nearest_name(word, near):
    with pytest.raises(InputError, match=rf"there is no character .*; did you mean {near}\?$") as caught:
        resolve(word)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["my(1)", "a+b", "a b"])
def test_a_recipe_whose_name_suits_no_folder_is_refused_in_one_sentence(tmp_path, name):
    file = tmp_path / f"{name}.toml"
    file.write_text("")
    with pytest.raises(InputError) as error:
        resolve(str(file))
    sentence = str(error.value)
    assert str(file) in sentence and repr(name) in sentence and "letters, digits, _, . and -" in sentence
    assert "\n" not in sentence


def test_a_recipe_may_have_a_name_of_letters_digits_dots_and_dashes(tmp_path):
    file = tmp_path / "Ünn_2.b-c.toml"
    file.write_text("")
    assert resolve(str(file)).character == str(file)


def test_a_configuration_survives_json(recipe):
    quick = resolve(recipe, "quick", seed=5)
    assert from_json(to_json(quick)) == quick


def test_whole_numbers_and_floats_of_one_value_are_one_configuration():
    assert to_json(config.CoarseConfig(normal_weight=5)) == to_json(config.CoarseConfig(normal_weight=5.0))
    assert isinstance(config.TrainingConfig(shares=(5, 1, 1)).shares[0], float)


def test_configurations_are_frozen(recipe):
    with pytest.raises(dataclasses.FrozenInstanceError):
        resolve(recipe).seed = 1


def test_a_seed_or_device_that_cannot_be_is_refused(recipe):
    with pytest.raises(InputError, match="seed: expected a whole number from 0 to 4294967295, got -1"):
        resolve(recipe, seed=-1)
    with pytest.raises(InputError, match="device: expected cpu or cuda, got 'tpu'"):
        resolve(recipe, device="tpu")
