"""Bad input from the command line to its one sentence: exit code 2, and nothing written.

The cases are generated (see bad_inputs) from the seed in the test's name. TEST_SEED=7 tries other ones:
`TEST_SEED=7 python -m pytest tests/test_bad_input.py`.
"""

import os
import re
import subprocess
import sys
import time

import numpy as np
import pytest
from bad_inputs import TINY, clip_mutations, command_lines, configurations, recipes, special_files

from data_recipes.acting.clip_file import read_clip
from data_recipes.catalogue import character_parts
from data_recipes.controls import make_controls
from data_recipes.recipe_paths import OUTSIDE
from replicate import __main__ as cli
from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.config import resolve

LONGEST_S = 30.0  # none takes a second on a quiet machine; what hangs takes for ever
LONGEST_SENTENCE = 2_000
CONTROLS = make_controls({"face": 4, "head": 1})
SEED = int(os.environ.get("TEST_SEED", "0"))


def refusal(read, value) -> str:
    """Return the sentence with which something is refused; fail for none, for another error, and for a long wait."""
    beginning = time.monotonic()
    with pytest.raises(InputError) as error:
        read(value)
    sentence = str(error.value)
    assert time.monotonic() - beginning < LONGEST_S
    assert sentence and "\n" not in sentence and len(sentence) < LONGEST_SENTENCE, sentence[:300]
    return sentence


def all_refused(read, cases, write) -> None:
    """Refuse all cases; the failure names each that was not."""
    wrong = []
    for name, data in cases:
        try:
            refusal(read, write(data))
        except BaseException as error:  # pytest's own failures too
            if isinstance(error, KeyboardInterrupt):
                raise
            wrong.append(f"{name}: {type(error).__name__} {str(error)[:200]}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("seed", [SEED])
def test_generated_recipes_are_refused_in_a_sentence_before_anything_is_built(tmp_path, seed):
    file = tmp_path / "mine.toml"
    all_refused(character_parts, recipes(seed), lambda data: (file.write_bytes(data), file)[1])


@pytest.mark.parametrize("seed", [SEED])
def test_generated_configurations_are_refused_in_a_sentence(tmp_path, seed):
    file = tmp_path / "mine.toml"
    all_refused(
        lambda file: resolve("tiny", "quick", file=file),
        configurations(seed),
        lambda data: (file.write_bytes(data), file)[1],
    )


@pytest.mark.parametrize("seed", [SEED])
def test_generated_clips_are_refused_in_a_sentence(tmp_path, seed):
    file = tmp_path / "shot.csv"
    cases = clip_mutations(np.random.default_rng(seed))
    all_refused(lambda file: read_clip(file, CONTROLS), cases, lambda data: (file.write_bytes(data), file)[1])


@pytest.mark.parametrize(("variables", "seed"), [({"TEST_SEED": "7"}, 7), ({}, 0)])
def test_generated_cases_are_those_of_a_seed_that_is_named_and_of_no_date(variables, seed):
    environment = {name: value for name, value in os.environ.items() if name != "TEST_SEED"} | variables
    options = "--collect-only -q -p no:xdist -k generated_clips".split()
    command = [sys.executable, "-m", "pytest", *options, __file__]
    named = subprocess.run(command, env=environment, cwd=paths.ROOT, capture_output=True, text=True, check=True).stdout
    assert re.findall(r"generated_clips\w*\[(.*?)\]", named) == [str(seed)]


def test_what_is_no_file_is_refused_at_once(tmp_path):
    readers = {
        "recipe": (lambda file: character_parts(str(file)), ".toml"),
        "character": (lambda file: resolve(str(file)), ".toml"),
        "configuration": (lambda file: resolve("tiny", file=file), ".toml"),
        "clip": (lambda file: read_clip(file, CONTROLS), ".csv"),
    }
    for name, (read, ending) in readers.items():
        all_refused(read, special_files(tmp_path / name, ending).items(), lambda file: file)


def test_generated_command_lines_end_with_2_and_one_line(capfd, cache, tmp_path, monkeypatch):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    monkeypatch.chdir(tmp_path)
    wrong = []
    for name, arguments in command_lines():
        code = cli.main(arguments)
        errors = capfd.readouterr().err.strip().splitlines()
        if code != 2 or len(errors) != 1 or len(errors[0]) > LONGEST_SENTENCE:
            wrong.append(f"{name}: {code}, {errors[-1][:200] if errors else 'nothing'}")
    assert not wrong, "\n".join(wrong)
    assert not cache.exists() and not (tmp_path / "results").exists() and not list(tmp_path.glob("*.glb"))


@pytest.mark.parametrize("value", ["~nobody-of-this-name/cache", "n" * 300, "/dev/null"])
@pytest.mark.parametrize("variable", ["REPLICATE_CACHE", "REPLICATE_RESULTS", "ICT_FACEKIT"])
def test_a_variable_that_can_name_no_folder_is_refused_by_its_name(monkeypatch, variable, value):
    monkeypatch.setenv(variable, value)
    assert variable in refusal(lambda _: paths.settle_folders(*OUTSIDE.values()), None)


def test_folders_that_variables_name_are_absolute_once_they_are_settled(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("REPLICATE_CACHE", "kept")
    monkeypatch.setenv("REPLICATE_RESULTS", "shown")
    paths.settle_folders()
    monkeypatch.chdir("/")
    assert (paths.cache_folder(), paths.run_folder("quick")) == (tmp_path / "kept", tmp_path / "shown" / "quick")


@pytest.fixture
def table2_refusal(capfd, cache, tmp_path, monkeypatch):
    """Run table2 on a recipe and return the sentence with which it is refused."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))

    def run(recipe, *arguments) -> str:
        file = tmp_path / "mine.toml"
        file.write_bytes(recipe if isinstance(recipe, bytes) else recipe.encode())
        assert cli.main(["table2", "--profile", "quick", "--characters", str(file), *arguments]) == 2
        errors = capfd.readouterr().err.strip().splitlines()
        assert not (tmp_path / "results").exists() and not cache.exists()
        assert len(errors) == 1
        return errors[0]

    return run


NO_OTHERS = "\n".join(f"{group} = 0" for group in ("jaw", "lids", "lips", "handles", "wrinkles", "head", "lid_follow"))
FEW_CONTROLS = re.sub(r"(?s)\[controls\].*", f"[controls]\nface = 8\n{NO_OTHERS}\n", TINY)


@pytest.mark.parametrize(
    ("recipe", "parts"),
    [
        (TINY + "\n[nostril]\nwide = 3\n", ["mine.toml", "unknown key nostril: expected name, vertices"]),
        (TINY + "\n[acting]\nholds = 2\n", ["mine.toml", "acting.holds: expected a number from 0 to 1, got 2"]),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", ["mine.toml", "byte 0 is no UTF-8"]),
        ("name = ", ["mine.toml", "not a readable TOML file"]),
        ('clip_files = ["none.csv"]\n' + TINY, ["none.csv", "there is no such file"]),
        (TINY.replace("vertices = 918", "vertices = 917"), ["mine.toml", "vertices: expected 918", "got 917"]),
        (FEW_CONTROLS, ["mine.toml", "8 controls of 4 kinds", "moves 7 kinds", "set acting.clips to 7 or less"]),
        (TINY.replace("[teeth]", "[teeth]\nwidths_upper = [60, 60]"), ["mine.toml", "teeth.widths_upper", "240 mm"]),
    ],
)
def test_a_bad_recipe_is_refused_before_anything_is_built(table2_refusal, recipe, parts):
    sentence = table2_refusal(recipe)
    assert all(part in sentence for part in parts), sentence


@pytest.mark.parametrize(
    ("clip", "message"),
    [
        ("squash\nnan\n", r"line 2, squash: expected a number from -1 to 1, got 'nan'"),
        ("wings\n0\n", r"there is no control 'wings' in this rig; there are"),
    ],
)
def test_a_bad_clip_is_refused_by_name_and_line(table2_refusal, tmp_path, clip, message):
    (tmp_path / "shot.csv").write_text(clip, encoding="utf-8")
    sentence = table2_refusal('clip_files = ["shot.csv"]\n' + TINY)
    assert "shot.csv" in sentence and re.search(message, sentence), sentence


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[coarse]\nmap_sise = 64\n", r"unknown key coarse\.map_sise: expected map_size"),
        ("[samples]\ncount = 0\n", r"samples\.count: expected a whole number from 1 to 10000000, got 0"),
        ("[coarse.training]\nsteps = 70000000\n", r"coarse\.training\.steps: .* from 1 to 2000000, got 70000000"),
        ("[samples\n", "not a readable TOML file"),
    ],
)
def test_a_bad_configuration_is_refused_by_key(table2_refusal, tmp_path, text, message):
    (tmp_path / "mine_config.toml").write_text(text, encoding="utf-8")
    sentence = table2_refusal(TINY, "--config", str(tmp_path / "mine_config.toml"))
    assert "mine_config.toml" in sentence and re.search(message, sentence), sentence
