"""Publishing Table 1 and figures: each target has its own entry in the manifest, and leaves the others theirs."""

import json
from dataclasses import replace

import pytest
from sample_results import GIT, publish_numbers, result
from sample_rows import table1_rows
from timed_rows import timed_rows
from toy_stages import ToyConfig

from replicate.config import resolve
from replicate.engine import store
from replicate.engine.stage import Stage
from replicate.report import manifest, notebooks
from replicate.report.publication import CharacterResult, publish_pictures
from replicate.report.results import read_results, write_results
from replicate.targets import table1, table3


@pytest.fixture
def notebook_names(place, monkeypatch):
    """Unexecuted notebooks; returns the names of those that would have been."""
    names = []

    def execute(source, out, parameters, stamp):
        names.append(out.name)
        out.write_text(stamp)

    monkeypatch.setattr(notebooks, "execute", execute)
    return names


def size_result(character: str, seed: int = 0, run: str = "r", small: float = 8.0) -> CharacterResult:
    """Return a character whose artefact holds made-up sizes for Table 1."""

    def build(out, scratch):
        write_results(out / "table1.csv", [replace(row, run=run) for row in table1_rows(character, small)])
        return {"key": "k", "wall_s": 1.0, "run": {"git": GIT, "profile": "quick"}}

    stage = Stage("table1", "toy_stages:numbers", ToyConfig(seed), label=f"{character}-{run}")
    store.make(stage.identifier, build)
    return CharacterResult(resolve(character, "quick", seed=seed), stage)


def test_table_1_is_published_character_by_character_with_the_claim(place, notebook_names, capsys):
    table1.publish([size_result("teen")])
    table1.publish([size_result("tiny", small=4.0)])
    assert {row.character for row in read_results(place / "table1.csv")} == {"teen", "tiny"}
    assert notebook_names == ["table1.ipynb"] * 2
    output = capsys.readouterr().out
    assert "holds on teen" in output and "Table 1" in output
    before = {path.name: path.read_bytes() for path in place.iterdir()}
    table1.publish([size_result("tiny", small=4.0)])
    assert {path.name: path.read_bytes() for path in place.iterdir()} == before and len(notebook_names) == 2


def test_table_1_shows_the_mean_over_its_seeds(place, notebook_names):
    table1.publish([size_result("teen", 0, "r", 7.0), size_result("teen", 1, "s", 9.0)])
    row = next(
        row for row in read_results(place / "table1.csv") if row.metric == "model_size" and row.method == "refined"
    )
    assert (row.value, row.sd, row.seeds) == (8.0, pytest.approx(2**0.5), 2)
    assert manifest.entries(place, "table1")["teen"]["run"] == row.run


def test_rows_of_table_1_that_the_manifest_does_not_know_are_left_out(place, notebook_names):
    table1.publish([size_result("teen")])
    rows = read_results(place / "table1.csv")
    write_results(place / "table1.csv", [replace(row, run="killed before the manifest was written") for row in rows])
    table1.publish([size_result("tiny")])
    assert {row.character for row in read_results(place / "table1.csv")} == {"tiny"}


def time_result(character: str, run: str, times: float = 1.0) -> CharacterResult:
    """Return a character whose artefact holds made-up times for Table 3; those of the networks are `times` as long."""

    def build(out, scratch):
        rows = [row for row in timed_rows(character) if row.table == "table3"]
        slow = [
            replace(row, value=row.value * (times if row.unit == "ms" and "rig" not in row.method else 1))
            for row in rows
        ]
        write_results(out / "table3.csv", [replace(row, run=run) for row in slow])
        return {"key": "k", "wall_s": 1.0, "run": {"git": GIT, "profile": "quick"}}

    stage = Stage("table3", "toy_stages:numbers", ToyConfig(), label=f"{character}-{run}")
    store.make(stage.identifier, build)
    return CharacterResult(resolve(character, "quick"), stage)


def test_a_second_table_3_says_how_far_it_is_from_the_first_of_the_same_characters(place, notebook_names, capsys):
    def changes():
        rows = read_results(place / "table3.csv")
        return {row.character: row.value for row in rows if row.metric == "change_time_one_core[rig]"}

    table3.publish([time_result("teen", "r")])
    assert not changes() and "the one before it" not in capsys.readouterr().out
    table3.publish([time_result("teen", "s", times=0.5), time_result("tiny", "s")])
    assert changes() == {"teen": 2.0} and "100 %" in capsys.readouterr().out
    table3.publish([time_result("tiny", "t")])
    assert changes() == {"teen": 2.0, "tiny": 1.0} and "100 %" not in capsys.readouterr().out


def figure_result(character: str, run: str = "r", clips: bool = True) -> CharacterResult:
    """Return a character whose artefact holds its Figure 5, with or without strips of clips."""

    def build(out, scratch):
        for name in (f"figure05_{character}", *([f"figure05_{character}_clips"] if clips else [])):
            for ending in ("png", "json", "csv"):
                (out / f"{name}.{ending}").write_text(f"{run} of {name}")
        return {"key": "k", "wall_s": 1.0, "run": {"git": GIT, "profile": "quick"}}

    stage = Stage("figure05", "toy_stages:numbers", ToyConfig(0), label=f"{character}-{run}")
    store.make(stage.identifier, build)
    return CharacterResult(resolve(character, "quick"), stage)


def test_a_figure_is_copied_with_its_words_and_numbers_and_others_stay(place, notebook_names, capsys):
    publish_pictures("figure05", [figure_result("teen")])
    publish_pictures("figure05", [figure_result("tiny", clips=False)])
    assert (place / "figure05_teen_clips.csv").read_text() == "r of figure05_teen_clips"
    entries = manifest.entries(place, "figure05")
    assert entries["teen"]["files"] == sorted(path.name for path in place.glob("figure05_teen*"))
    assert entries["tiny"]["files"] == [f"figure05_tiny.{ending}" for ending in ("csv", "json", "png")]
    assert (
        notebook_names == ["figure05.ipynb"] * 2
        and "figure05_teen.png, figure05_teen_clips.png" in capsys.readouterr().out
    )


def test_a_picture_that_a_character_no_longer_has_is_removed_and_one_that_is_gone_is_forgotten(place, notebook_names):
    publish_pictures("figure05", [figure_result("teen")])
    publish_pictures("figure05", [figure_result("teen", "s", clips=False)])
    assert not list(place.glob("*_clips*")) and (place / "figure05_teen.png").read_text() == "s of figure05_teen"
    (place / "figure05_teen.csv").unlink()
    publish_pictures("figure05", [figure_result("tiny")])
    assert set(manifest.entries(place, "figure05")) == {"tiny"}


def test_what_the_manifest_tells_of_one_target_stays_when_another_is_published(place, notebook_names):
    publish_numbers(result("teen"))
    top = json.loads((place / "manifest.json").read_text())
    table1.publish([size_result("tiny")])
    publish_pictures("figure05", [figure_result("teen")])
    record = json.loads((place / "manifest.json").read_text())
    assert set(record.pop("targets")) == {"figure05", "table1"} and record == top
    publish_numbers(result("teen"), result("tiny"))
    assert set(json.loads((place / "manifest.json").read_text())["targets"]) == {"figure05", "table1"}
    assert set(manifest.entries(place, "table1")) == {"tiny"} and "tiny" in manifest.entries(place, "table2")


@pytest.mark.parametrize("text", ["", "7", "[]", '{"targets": 7}', '{"targets": {"table1": []}}', "[7, \xff"])
def test_a_damaged_manifest_counts_as_none_for_every_target(place, notebook_names, text):
    table1.publish([size_result("teen")])
    (place / "manifest.json").write_text(text)
    table1.publish([size_result("tiny")])
    assert set(manifest.entries(place, "table1")) == {"tiny"}
    assert {row.character for row in read_results(place / "table1.csv")} == {"tiny"}
