"""The command line: one sentence for a mistake, and no work that was done before."""

import subprocess
import sys
import types

import pytest
from toy_stages import ToyConfig, faulty_graph

import replicate
from data_recipes import recipe_paths
from replicate import __main__ as cli
from replicate.engine import paths
from replicate.engine.cache_report import inventory
from replicate.engine.stage import Stage
from replicate.engine.store import artefact_folder, read_manifest
from replicate.report.results import Row, write_results


@pytest.fixture
def recipes(tmp_path, monkeypatch):
    """Three characters, whatever the project has."""
    folder = tmp_path / "recipes"
    folder.mkdir()
    for name in ("dragon", "teen", "toon", "woman"):
        (folder / f"{name}.toml").write_text("")
    monkeypatch.setattr(recipe_paths, "RECIPES", folder)


@pytest.fixture
def pipeline(monkeypatch, recipes):
    """A pipeline of two toy stages a character; returns what was published."""
    published = []

    def graph(config):
        rig = Stage("rig", "toy_stages:numbers", ToyConfig(seed=config.seed), label=config.character)
        return [Stage("errors", "toy_stages:total", ToyConfig(seed=config.seed), (rig,), label=config.character)]

    module = types.ModuleType("replicate.pipeline")
    module.table2_graph = module.all_graphs = graph
    monkeypatch.setitem(sys.modules, "replicate.pipeline", module)
    monkeypatch.setattr(replicate, "pipeline", module, raising=False)
    monkeypatch.setattr("replicate.report.publish.publish_table2", lambda *given: published.append(given[:2]))
    return published


def refused(capsys, *arguments):
    """Return the one sentence with which a command line is refused."""
    assert cli.main(list(arguments)) == 2
    told = capsys.readouterr()
    assert told.out == "" and told.err.count("\n") == 1 and "Traceback" not in told.err
    return told.err


def test_an_unknown_character_is_refused_with_those_there_are(capsys, pipeline):
    sentence = refused(capsys, "table2", "--characters", "hiccup")
    assert "'hiccup'" in sentence and "dragon, teen, toon, woman" in sentence


@pytest.mark.parametrize("command", ["table2", "compare", "status"])
def test_an_unknown_profile_is_refused_with_those_there_are(capsys, pipeline, command):
    sentence = refused(capsys, command, "--profile", "fast")
    assert "'fast'" in sentence and "quick, laptop, paper" in sentence


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--jobs", "0"], ["jobs is 0", "at least 1"]),
        (["--seed=-1"], ["seed is '-1'", "at least 0"]),
        (["--seed", "0,one"], ["seed is 'one'", "at least 0"]),
        (["--device", "tpu"], ["'tpu'", "auto, cpu, cuda"]),
        (["--split", "poses"], ["'poses'", "frames, clips"]),
        (["--config", "nowhere.toml"], ["nowhere.toml", "no such file"]),
        (["--characters", ","], ["no character", "teen"]),
        (["--colour", "red"], ["--colour"]),
    ],
)
def test_a_bad_option_is_refused_with_what_is_allowed(capsys, pipeline, cache, arguments, named):
    sentence = refused(capsys, "table2", *arguments)
    assert all(part in sentence for part in named), sentence
    assert not cache.exists(), "something was written"


def test_an_unknown_command_is_refused(capsys):
    assert "table9" in refused(capsys, "table9")


def test_table2_runs_the_graph_of_every_character_and_publishes_once(capfd, cache, pipeline):
    assert cli.main(["table2", "--profile", "quick", "--characters", "teen,dragon", "woman", "--seed", "4", "2,4"]) == 0
    ((configs, tables),) = pipeline
    wanted = [(character, seed) for character in ("teen", "dragon", "woman") for seed in (4, 2)]
    assert [(config.character, config.seed) for config in configs] == wanted
    assert {config.profile for config in configs} == {"quick"}
    assert [table.name for table in tables] == ["errors"] * 6
    facts = read_manifest(artefact_folder(tables[0].identifier))["run"]
    assert facts["seeds"] == [2, 4] and facts["command"].startswith("python -m replicate table2 ")
    assert "made 12 of 12 artefacts" in capfd.readouterr().out


def test_a_recipe_named_twice_is_run_once(capfd, cache, pipeline):
    named = ["teen", str(recipe_paths.RECIPES / "teen.toml"), "dragon", "teen"]
    assert cli.main(["table2", "--profile", "quick", "--characters", *named]) == 0
    ((configs, _),) = pipeline
    assert [config.character for config in configs] == ["teen", "dragon"]


def test_two_recipes_of_one_name_are_refused_with_both_files(capsys, cache, pipeline, tmp_path):
    mine = tmp_path / "mine" / "teen.toml"
    mine.parent.mkdir()
    mine.write_text("")
    sentence = refused(capsys, "table2", "--characters", f"teen,{mine}")
    named = (str(recipe_paths.RECIPES / "teen.toml"), str(mine), "rename one of them")
    assert all(part in sentence for part in named)
    assert not cache.exists()


@pytest.fixture
def drawing(pipeline, monkeypatch):
    """The graphs of Table 1 and of the figures as toys too; returns what was published of them."""
    published = []
    module = sys.modules["replicate.pipeline"]
    module.table1_graph = module.table2_graph
    module.figure_graph = lambda config, name: module.table2_graph(config)
    monkeypatch.setattr("replicate.report.publish.publish_table1", lambda *given: published.append(("table1", *given)))
    monkeypatch.setattr("replicate.report.publish.publish_figure", lambda *given: published.append(given))
    return published


@pytest.mark.parametrize("command", ["table1", "figure05", "figure07", "figure08"])
def test_what_needs_no_training_runs_its_own_graph_and_publishes_under_its_name(capfd, cache, drawing, command):
    assert cli.main([command, "--profile", "quick", "--characters", "teen,dragon", "--seed", "3"]) == 0
    ((name, configs, lasts),) = drawing
    assert name == command and [config.character for config in configs] == ["teen", "dragon"]
    assert {config.seed for config in configs} == {3} and [stage.name for stage in lasts] == ["errors"] * 2


@pytest.mark.parametrize("command", ["table1", "figure05", "figure07", "figure08"])
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--characters", "hiccup"], ["'hiccup'", "dragon, teen, toon, woman"]),
        (["--profile", "fast"], ["'fast'", "quick, laptop, paper"]),
        (["--jobs", "0"], ["jobs is 0", "at least 1"]),
        (["--latex"], ["--latex"]),
    ],
)
def test_a_bad_option_of_theirs_is_refused_too(capsys, cache, drawing, command, arguments, named):
    sentence = refused(capsys, command, *arguments)
    assert all(part in sentence for part in named), sentence
    assert not cache.exists() and not drawing


def test_table1_and_figures_take_all_of_the_papers_characters_that_have_a_recipe(capsys):
    there = [
        name for name in ("teen", "woman", "dragon", "toon") if (paths.ROOT / f"data_recipes/{name}.toml").is_file()
    ]
    assert list(cli.CAST) == there and "teen" in there
    for command in ("table1", "figure05", "figure07", "figure08"):
        assert cli._parser().parse_args([command]).characters == there
    assert cli._parser().parse_args(["table2"]).characters == ["teen"]


def test_the_tour_is_executed_once_for_each_character(capfd, monkeypatch, tmp_path):
    executed = []
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    monkeypatch.setattr("replicate.made.made_rig", lambda character: executed.append(character))
    monkeypatch.setattr("replicate.report.notebooks.execute", lambda *given: executed.append(given))
    mine = tmp_path / "mine.toml"
    assert cli.main(["tour", "--characters", "teen", str(mine)]) == 0
    source, folder = paths.ROOT / "notebooks" / "rig_tour.ipynb", tmp_path / "runs" / "tour"
    assert executed == [
        "teen",
        (source, folder / "rig_tour_teen.ipynb", {"CHARACTER": "teen"}),
        str(mine),
        (source, folder / "rig_tour_mine.ipynb", {"CHARACTER": str(mine)}),
    ]


def test_table2_again_has_nothing_to_do(capfd, cache, pipeline):
    cli.main(["table2"])
    capfd.readouterr()
    assert cli.main(["table2"]) == 0
    assert "nothing to do: 2 artefacts up to date" in capfd.readouterr().out


def test_a_failing_stage_is_one_sentence_and_exit_code_1(capfd, cache, pipeline, monkeypatch):
    monkeypatch.setattr(sys.modules["replicate.pipeline"], "table2_graph", lambda config: faulty_graph("error"))
    assert cli.main(["table2"]) == 1
    told = capfd.readouterr().err
    assert "stage faulty failed" in told and "Traceback" not in told
    assert not pipeline, "a run that failed was published"


def test_status_tells_what_is_there_from_what_is_not(capfd, cache, pipeline):
    assert cli.main(["status"]) == 0
    assert capfd.readouterr().out.count("missing") == 2
    cli.main(["table2"])
    file = next(cache.glob("rig-teen-*")) / "numbers.json"
    file.write_text(file.read_text()[:-1])
    capfd.readouterr()
    cli.main(["status"])
    told = capfd.readouterr().out
    assert told.count("up to date") == 1 and "damaged: numbers.json" in told


def test_clean_cache_keeps_what_is_current_and_all_keeps_nothing(capfd, cache, pipeline, monkeypatch):
    cli.main(["table2"])
    (cache / "scratch" / "left-over").mkdir(parents=True)
    assert cli.main(["clean-cache"]) == 0
    assert [entry.state for entry in inventory()] == ["current", "current"]
    monkeypatch.setattr("replicate.engine.cache_report.sources_digest", lambda function: "changed")
    assert [entry.state for entry in inventory()] == ["stale", "stale"]
    assert cli.main(["clean-cache", "--all"]) == 0
    assert inventory() == []


def test_clean_cache_leaves_alone_what_the_suite_did_not_make(capfd, cache):
    (cache / "photographs").mkdir(parents=True)
    (cache / "notes.txt").write_text("mine")
    assert cli.main(["clean-cache", "--all"]) == 0
    assert (cache / "photographs").is_dir() and (cache / "notes.txt").is_file()


def test_compare_prints_text_or_latex(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    row = Row("table2", "teen", "coarse", "vertex_error_mean", "mm", 0.2, None, 1, 10, "quick", "r")
    (tmp_path / "quick").mkdir()
    write_results(tmp_path / "quick" / "table2.csv", [row])
    assert cli.main(["compare", "--profile", "quick"]) == 0
    text = capsys.readouterr().out
    assert "teen, Coarse, vertex_error_mean [mm]" in text and "\\" not in text
    assert cli.main(["compare", "--profile", "quick", "--latex"]) == 0
    latex = capsys.readouterr().out
    assert latex.count(r"\begin{table}") == latex.count(r"\end{table}") >= 1
    assert r"teen, Coarse, vertex\_error\_mean [mm] & 0.36 & " in latex and "|" not in latex


@pytest.mark.parametrize("command", [[], *([name] for name in cli.COMMANDS)])
def test_every_command_has_help(command):
    told = subprocess.run(
        [sys.executable, "-m", "replicate", *command, "--help"],
        cwd=paths.ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "usage:" in told.stdout and "REPLICATE_CACHE" in told.stdout
