"""Publishing: whole characters stay, half written ones are written again, and two processes lose nothing."""

import json
import threading
import time
from dataclasses import replace

import pytest
from sample_results import GIT, publish_numbers, result
from sample_rows import table2_rows

from replicate.drawing.panels import Words
from replicate.report import notebooks
from replicate.report.notebooks import provenance_text
from replicate.report.results import of_character, read_curves, read_results, read_seeds, write_results
from replicate.targets import table2
from replicate.targets.table2 import charts

POSES = ("table2_teen_pose.npz", "table2_teen_pose_median.npz", "table2_teen_pose_worst.npz")
FILES = ("table2.csv", "table2_seeds.csv", "table2_curves.csv", *POSES, "manifest.json")


def characters(place) -> list[set[str]]:
    """Return whose results each file holds."""
    return [
        {row.character for row in read_results(place / "table2.csv")},
        {character for character, _ in read_curves(place / "table2_curves.csv")},
        set(json.loads((place / "manifest.json").read_text())["characters"]),
    ]


def test_characters_published_one_after_the_other_stand_side_by_side(place):
    publish_numbers(result("teen"))
    publish_numbers(result("tiny"))
    assert characters(place) == [{"teen", "tiny"}] * 3
    before = {file: (place / file).read_bytes() for file in FILES}
    publish_numbers(result("tiny"))
    assert {file: (place / file).read_bytes() for file in FILES} == before


def test_each_seeds_rows_stand_beside_their_means(place):
    publish_numbers(result("teen"), result("teen", 3, "s"))
    publish_numbers(result("tiny", 3))
    seeds = read_seeds(place / "table2_seeds.csv")
    assert {seed: {row.character for row in rows} for seed, rows in seeds.items()} == {0: {"teen"}, 3: {"teen", "tiny"}}
    assert {row.run for row in seeds[3] if row.character == "teen"} == {"s"}
    means = {row.key: row for row in read_results(place / "table2.csv")}
    assert all(means[row.key].seeds == 2 and means[row.key].sd == 0 for row in seeds[0])
    publish_numbers(result("teen", 3, "s"))
    assert sorted(of_character(read_seeds(place / "table2_seeds.csv"), "teen")) == [3], "a run replaces a character"


@pytest.mark.parametrize("harm", ["gone", "empty", "garbage", "cut"])
@pytest.mark.parametrize("file", FILES)
def test_a_file_that_is_gone_or_damaged_is_written_again(place, file, harm):
    runs = result("teen"), result("tiny")
    publish_numbers(*runs)
    whole = {name: (place / name).read_bytes() for name in FILES}
    (place / file).unlink()
    if harm != "gone":
        (place / file).write_bytes({"empty": b"", "garbage": b"[7, \xff", "cut": whole[file][:-40]}[harm])
    publish_numbers(runs[1])
    assert "tiny" in set.intersection(*characters(place)), "what is published does not depend on what was there"
    publish_numbers(*runs)
    assert {name: (place / name).read_bytes() for name in FILES} == whole


@pytest.mark.parametrize("text", ["7", "[]", "{}", '{"characters": []}', '{"characters": {"teen": 7}}'])
def test_a_manifest_of_another_shape_counts_as_none(place, text):
    publish_numbers(result("teen"))
    (place / "manifest.json").write_text(text)
    publish_numbers(result("tiny"))
    assert characters(place) == [{"tiny"}] * 3


def test_a_character_without_an_entry_in_the_manifest_is_left_out(place):
    publish_numbers(result("teen"), result("tiny"))
    manifest = json.loads((place / "manifest.json").read_text())
    del manifest["characters"]["teen"]
    (place / "manifest.json").write_text(json.dumps(manifest))
    publish_numbers(result("tiny"))
    assert characters(place) == [{"tiny"}] * 3


def test_rows_of_another_run_than_the_manifests_are_left_out(place):
    publish_numbers(result("teen"))
    rows = [replace(row, run="killed before the manifest was written") for row in table2_rows()]
    write_results(place / "table2.csv", rows)
    publish_numbers(result("tiny"))
    assert characters(place) == [{"tiny"}] * 3


def test_two_processes_that_publish_at_once_lose_no_rows(place, monkeypatch, capsys):
    runs, read, reading = [result("teen"), result("tiny")], table2.read_curves, threading.Event()

    def read_slowly(file):
        if file.parent == place and not reading.is_set():
            reading.set()
            time.sleep(0.5)
        return read(file)

    monkeypatch.setattr(table2, "read_curves", read_slowly)
    first = threading.Thread(target=publish_numbers, args=(runs[0],))
    first.start()
    assert reading.wait(10)
    publish_numbers(runs[1])
    first.join()
    assert characters(place) == [{"teen", "tiny"}] * 3
    assert "being written by another process; waiting for it" in capsys.readouterr().out


def test_the_lock_is_free_after_a_failure_and_lies_outside_the_results(place, monkeypatch):
    run = result("teen")
    monkeypatch.setattr(charts, "open_table2", lambda folder: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        table2.publish([run])
    publish_numbers(run)
    assert {path.name for path in place.iterdir()} == set(FILES), "the place may be copied as it is"


@pytest.fixture
def drawing(place, monkeypatch):
    """Small figures and an unexecuted notebook instead of the true ones; returns what was drawn and executed."""
    from matplotlib.figure import Figure

    names = []

    def figures(results, character, limit_deg):
        for name in charts.table2_figure_names(results, character):
            names.append(name)
            yield name, Figure((0.1, 0.1)), Words("alt", "caption")

    def execute(source, out, parameters, stamp):
        names.append(out.name)
        out.write_text(stamp)

    monkeypatch.setattr(charts, "table2_figures", figures)
    monkeypatch.setattr(notebooks, "execute", execute)
    return names


FACES = ("figure10_teen", "figure10_teen_median", "figure10_teen_worst")
ALL = ["table2_teen_chart", *FACES, "figure09_teen", "table2_teen_curves", "table2.ipynb"]


def test_figures_and_notebook_are_made_once(place, drawing):
    table2.publish([result("teen")])
    assert drawing == ALL
    assert all((place / f"{name}.png").is_file() for name in ALL[:-1])
    table2.publish([result("teen")])
    assert drawing == ALL, "both show these results already"
    table2.publish([result("teen", run="another")])
    assert drawing == ALL * 2


@pytest.mark.parametrize("name", ["figure09_teen.png", "table2_teen_curves.json"])
def test_a_figure_that_is_gone_is_drawn_again(place, drawing, name):
    table2.publish([result("teen")])
    (place / name).unlink()
    drawing.clear()
    table2.publish([result("teen")])
    assert (place / name).is_file() and drawing == ALL[:-1], "the notebook need not be executed for it"


@pytest.mark.parametrize("name", ["figure09_teen.png", "table2_teen_curves.json"])
def test_a_figure_that_is_damaged_is_drawn_again(place, drawing, name):
    table2.publish([result("teen")])
    sound = (place / name).read_bytes()
    middle = len(sound) // 2
    (place / name).write_bytes(sound[:middle] + bytes([sound[middle] ^ 0xFF]) + sound[middle + 1 :])
    table2.publish([result("teen")])
    assert (place / name).read_bytes() == sound


def test_figures_that_a_killed_process_left_old_are_drawn_again(drawing, monkeypatch):
    table2.publish([result("teen")])
    with monkeypatch.context() as patch:
        patch.setattr("replicate.drawing.panels.save_figure", lambda *arguments: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            table2.publish([result("teen", run="another")])
    drawing.clear()
    table2.publish([result("teen", run="another")])
    assert drawing == ALL


def test_the_notebook_is_executed_again_when_only_the_manifest_changes(place, drawing):
    table2.publish([result("teen")])
    manifest = json.loads((place / "manifest.json").read_text())
    assert notebooks.is_current("table2", "quick", HEATMAP_DEG=30.0)
    (place / "manifest.json").write_text(json.dumps(manifest | {"processor": "abacus"}))
    assert not notebooks.is_current("table2", "quick", HEATMAP_DEG=30.0)


def test_a_character_is_clean_only_if_all_its_seeds_are(place):
    publish_numbers(result("tiny"), result("teen"), result("teen", 1, git={"commit": "f00d", "clean": False}))
    manifest = json.loads((place / "manifest.json").read_text())
    assert "git" not in manifest, "they share none"
    assert manifest["characters"]["tiny"]["git"] == GIT
    git = {"commit": "c0ffee", "clean": False, "commits": ["c0ffee", "f00d"]}
    assert manifest["characters"]["teen"]["git"] == git


def test_what_is_published_says_how_the_poses_were_split(place, capsys):
    publish_numbers(result("teen"))
    assert capsys.readouterr().out.count("\nsplit by frames, as in the paper\n") == 1
    publish_numbers(result("tiny", split="clips"))
    assert "\nsplit by clips\n" in capsys.readouterr().out
    facts = json.loads((place / "manifest.json").read_text())["characters"]
    assert {name: own["split"] for name, own in facts.items()} == {"teen": "frames", "tiny": "clips"}
    text = provenance_text("quick")
    assert "split by frames" in text and "split by clips" in text
