"""The command line: one sentence for a mistake, and no work that was done before."""

import subprocess
import sys

import pytest
from refusal import refusal
from sample_folders import write
from toy_stages import faulty_graph
from toy_targets import toy as toy_module

from data_recipes import recipe_paths
from replicate import __main__ as cli
from replicate.base import paths
from replicate.cli import parser
from replicate.cli import target_list as registry
from replicate.cli.options import OF_A_RUN, configurations
from replicate.engine.cache_report import inventory
from replicate.engine.store import artefact_folder, read_manifest
from replicate.report.results import Row, write_results


@pytest.fixture
def recipes(tmp_path, monkeypatch):
    """Four characters, whatever the project has."""
    folder = tmp_path / "recipes"
    folder.mkdir()
    for name in ("dragon", "teen", "toon", "woman"):
        (folder / f"{name}.toml").write_text("")
    monkeypatch.setattr(recipe_paths, "RECIPES", folder)


@pytest.fixture
def toy(monkeypatch):
    """The module of a target "toy", which is none of the suite's; its PUBLICATIONS notes what it would publish."""
    target = registry.Target("toy", "toys", "two toy stages", "the cache", OF_A_RUN, module="toy_targets.toy")
    monkeypatch.setitem(registry.targets(), "toy", target)
    toy_module.PUBLICATIONS.clear()
    return toy_module


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--jobs", "0"], ["jobs: expected a whole number from 1", "got '0'"]),
        (["--jobs", "many"], ["jobs: expected a whole number from 1", "got 'many'"]),
        (["--jobs", "4", "--cluster", "local:2"], ["JOBS=4", "CLUSTER=local:2", "leave JOBS out"]),
        (["--seed=-1"], ["seed: expected a whole number from 0", "got '-1'"]),
        (["--seed", "0,one"], ["seed: expected a whole number from 0", "got 'one'"]),
        (["--device", "tpu"], ["'tpu'", "expected auto, cpu or cuda"]),
        (["--split", "poses"], ["split: expected frames or clips, got 'poses'"]),
        (["--config", "nowhere.toml"], ["nowhere.toml", "no such file"]),
        (["--characters", ","], ["no character", "teen"]),
        (["--colour", "red"], ["--colour"]),
    ],
)
def test_a_bad_option_is_refused_with_what_is_allowed(capsys, toy, recipes, cache, arguments, parts):
    sentence = refusal(capsys, "toy", *arguments)
    assert all(part in sentence for part in parts), sentence
    assert not cache.exists() and not toy.PUBLICATIONS, "something was written"


@pytest.mark.parametrize(
    ("word", "near"),
    [("tabel2", "table2"), ("figure1", "figure01"), ("Figure_9", "figure09"), ("rig_report", "rig-report")],
)
def test_a_mistyped_target_gets_the_nearest_name(capsys, word, near):
    assert refusal(capsys, word) == f"there is no target {word}; did you mean {near}?\n"


def test_a_word_that_is_near_to_no_target_is_refused_with_where_they_are_listed(capsys):
    assert "--help" in refusal(capsys, "hello")


def test_a_target_makes_the_stages_of_every_character_and_publishes_once(capfd, cache, recipes, toy):
    assert cli.main(["toy", "--profile", "quick", "--characters", "teen,dragon", "woman", "--seed", "4", "2,4"]) == 0
    (results,) = toy.PUBLICATIONS
    expected = [(character, seed) for character in ("teen", "dragon", "woman") for seed in (4, 2)]
    assert [(one.config.character, one.config.seed) for one in results] == expected
    assert {one.config.profile for one in results} == {"quick"}
    assert [one.stage.name for one in results] == ["summed"] * 6
    facts = read_manifest(artefact_folder(results[0].stage.identifier))["run"]
    assert facts["seeds"] == [2, 4] and facts["command"].startswith("python -m replicate toy ")
    assert "made 12 of 12 artefacts" in capfd.readouterr().out


def test_a_recipe_named_twice_is_run_once(capfd, cache, recipes, toy):
    characters = ["teen", str(recipe_paths.RECIPES / "teen.toml"), "dragon", "teen"]
    assert cli.main(["toy", "--profile", "quick", "--characters", *characters]) == 0
    (results,) = toy.PUBLICATIONS
    assert [one.config.character for one in results] == ["teen", "dragon"]


def test_two_recipes_of_one_name_are_refused_with_both_files(capsys, cache, recipes, toy, tmp_path):
    mine = tmp_path / "mine" / "teen.toml"
    mine.parent.mkdir()
    mine.write_text("")
    sentence = refusal(capsys, "toy", "--characters", f"teen,{mine}")
    assert (
        str(recipe_paths.RECIPES / "teen.toml") in sentence
        and str(mine) in sentence
        and "rename one of them" in sentence
    )
    assert not cache.exists()


@pytest.mark.parametrize("ending", ["", "/face.toml"])
def test_a_path_with_a_space_and_the_home_folder_need_no_quotes_of_their_own(tmp_path, monkeypatch, ending):
    monkeypatch.setenv("HOME", str(tmp_path))
    folder = write(tmp_path / "my faces" / "a face")
    (tmp_path / "few.toml").write_text("[samples]\ncount = 123\n")
    line = ["table2", "--profile", "quick", "--config", "~/few.toml", "--characters"]
    for name in (f"{folder}{ending}", f"~/my faces/a face{ending}", f"tiny,~/my faces/a face{ending}"):
        *_, config = configurations(parser.parser().parse_args([*line, name]))
        assert config.character == str(folder) and config.samples.count == 123


def test_what_make_hands_to_every_target_is_left_out_where_a_target_lacks_it(capfd, cache, recipes, toy):
    options = ["--profile", "quick", "--latex", "--pose", "joy", "--tolerance", "0.1", "--seed", "3"]
    assert cli.main(["toy", "--from-make", *options]) == 0
    (results,) = toy.PUBLICATIONS
    assert [(one.config.character, one.config.profile, one.config.seed) for one in results] == [("teen", "quick", 3)]
    facts = read_manifest(artefact_folder(results[0].stage.identifier))["run"]
    assert facts["command"] == "python -m replicate toy --profile quick --seed 3"
    assert "left out, since this command has no such option: LATEX, POSE, TOLERANCE\n" in capfd.readouterr().err


@pytest.mark.parametrize("option", [["--latex"], ["--pose", "joy"]])
def test_who_types_an_option_that_a_target_lacks_is_told(capsys, cache, recipes, toy, option):
    assert option[0] in refusal(capsys, "toy", *option)


def test_make_leaves_no_misspelt_option_out_of_a_typed_command(capsys, cache, recipes, toy):
    assert "got 'one'" in refusal(capsys, "toy", "--from-make", "--seed", "one")


def test_the_tour_is_executed_once_for_each_character(capfd, monkeypatch, tmp_path):
    calls = []
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    monkeypatch.setattr("replicate.methods.artefacts.rig_of", lambda character: calls.append(character))
    monkeypatch.setattr("replicate.report.notebooks.execute", lambda *call: calls.append(call))
    mine = tmp_path / "mine.toml"
    assert cli.main(["tour", "--characters", "teen", str(mine)]) == 0
    source, folder = paths.ROOT / "notebooks" / "rig_tour.ipynb", tmp_path / "runs" / "tour"
    assert calls == [
        "teen",
        (source, folder / "rig_tour_teen.ipynb", {"CHARACTER": "teen"}),
        str(mine),
        (source, folder / "rig_tour_mine.ipynb", {"CHARACTER": str(mine)}),
    ]


def test_a_target_again_has_nothing_to_do(capfd, cache, recipes, toy):
    cli.main(["toy"])
    capfd.readouterr()
    assert cli.main(["toy"]) == 0
    assert "nothing to do: 2 artefacts up to date" in capfd.readouterr().out


def test_a_failing_stage_is_one_sentence_and_exit_code_1(capfd, cache, recipes, toy, monkeypatch):
    monkeypatch.setattr(toy, "stages", lambda plan: faulty_graph("error"))
    assert cli.main(["toy"]) == 1
    errors = capfd.readouterr().err
    assert "stage faulty failed" in errors and "Traceback" not in errors
    assert not toy.PUBLICATIONS, "a run that failed was published"


def test_status_knows_what_is_there_from_what_is_not(capfd, cache, toy):
    def states() -> dict[str, str]:
        assert cli.main(["status", "--profile", "quick", "--characters", "tiny", "--details"]) == 0
        lines = [line.split(maxsplit=2) for line in capfd.readouterr().out.partition("\n\n")[0].splitlines()]
        return {title: state for title, _, state in lines}

    before = states()
    assert {"counted-tiny", "summed-tiny", "rig-tiny", "errors_coarse-tiny", "table1-tiny", "table2-tiny"} <= set(
        before
    )
    assert set(before.values()) == {"missing"}
    cli.main(["toy", "--characters", "tiny"])
    file = next(cache.glob("counted-tiny-*")) / "numbers.json"
    file.write_text(file.read_text()[:-1])
    capfd.readouterr()
    after = states()
    assert "damaged: numbers.json" in after.pop("counted-tiny") and after.pop("summed-tiny") == "up to date"
    assert set(after.values()) == {"missing"}


def test_clean_keeps_what_is_current_and_all_keeps_nothing(capfd, cache, recipes, toy, monkeypatch):
    cli.main(["toy"])
    (cache / "scratch" / "left-over").mkdir(parents=True)
    assert cli.main(["clean"]) == 0
    assert [entry.state for entry in inventory()] == ["current", "current"]
    monkeypatch.setattr("replicate.engine.cache_report.sources_digest", lambda function: "changed")
    assert [entry.state for entry in inventory()] == ["stale", "stale"]
    assert cli.main(["clean", "--all"]) == 0
    assert inventory() == []


def test_clean_leaves_alone_what_the_suite_did_not_make(capfd, cache):
    (cache / "photographs").mkdir(parents=True)
    (cache / "notes.txt").write_text("mine")
    assert cli.main(["clean", "--all"]) == 0
    assert (cache / "photographs").is_dir() and (cache / "notes.txt").is_file()


def test_compare_prints_text_or_latex(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    row = Row("table2", "teen", "coarse", "vertex_error_mean", "mm", 0.2, None, 1, 10, "quick", "r")
    (tmp_path / "quick").mkdir()
    write_results(tmp_path / "quick" / "table2.csv", [row])
    assert cli.main(["compare", "--profile", "quick"]) == 0
    text = capsys.readouterr().out
    assert "teen, vertex_error_mean [mm]\n  Coarse" in text and "\\" not in text and "Left out: " in text
    assert cli.main(["compare", "--profile", "quick", "--all"]) == 0
    whole = capsys.readouterr().out
    assert len(whole.splitlines()) > 10 * len(text.splitlines()) and "Left out: " not in whole
    assert cli.main(["compare", "--profile", "quick", "--latex"]) == 0
    latex = capsys.readouterr().out
    assert latex.count(r"\begin{table}") == latex.count(r"\end{table}") >= 1
    assert r"teen, vertex\_error\_mean [mm] & " in latex and "Coarse & 0.36 & " in latex and "|" not in latex


def test_help_lists_every_target():
    program = [sys.executable, "-m", "replicate", "--help"]
    text = subprocess.run(program, cwd=paths.ROOT, capture_output=True, text=True, check=True).stdout
    names = [line.split()[0] for line in text.splitlines() if line.startswith("    ") and not line[4].isspace()]
    assert text.startswith("usage:") and "REPLICATE_CACHE" in text and names == list(registry.targets())
