"""`make reference ADD_SEEDS=1`: the seeds of a run join those that are committed, and means and facts follow."""

import json
import statistics
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from sample_results import result
from sample_rows import table2_rows
from toy_texts import texts_to_fill

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.config import resolve
from replicate.methods.method_registry import sections
from replicate.report import manifest, notebooks
from replicate.report.pose_record import CHOICES, TRUTH, load_pose, pose_file
from replicate.report.results import Row, of_character, read_curves, read_results, read_seeds, write_results
from replicate.report.tables import Table
from replicate.targets import reference, table2
from replicate.targets.reference.times import times_card
from replicate.targets.table2.charts import redraw_charts


@cache
def committed_times() -> Table:
    """Return how long Table 2 takes by the committed results; it is made of the graphs of 16 runs."""
    return times_card(paths.ROOT / "results" / "reference")


@pytest.fixture
def publish(cache, tmp_path, monkeypatch):
    """A function that publishes characters as a run of its own, and makes this run the reference or a part of it."""
    monkeypatch.setattr(paths, "REFERENCE", tmp_path / "reference")
    monkeypatch.setattr(notebooks, "run_notebook", lambda name, results: tmp_path / name)
    monkeypatch.setattr(reference, "times_card", lambda folder: committed_times())  # no seed changes it
    monkeypatch.setattr(reference, "redraw_charts", lambda *_: [])  # it takes most of the time; one test has it
    texts_to_fill(tmp_path, monkeypatch)

    def run_and_publish(name: str, *results, add_seeds: bool = True) -> None:
        monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / name))
        table2.publish(results, draw=False)
        reference.publish_reference("quick", add_seeds)

    return run_and_publish


def committed(character: str = "teen") -> dict[int, float]:
    """Return the coarse networks' mean error by seed."""
    seeds = of_character(read_seeds(paths.REFERENCE / "table2_seeds.csv"), character)
    return {
        seed: next(row.value for row in rows if row.key[2:] == ("coarse", "vertex_error_mean"))
        for seed, rows in seeds.items()
    }


def mean_row(character: str = "teen"):
    rows = read_results(paths.REFERENCE / "table2.csv")
    return next(row for row in rows if row.key == ("table2", character, "coarse", "vertex_error_mean"))


def test_seeds_of_three_runs_give_the_mean_and_the_spread_of_one_run_with_all(publish):
    errors = {0: 0.2, 1: 0.3, 2: 0.7}
    for seed, error in errors.items():
        publish(f"run{seed}", result("teen", seed, f"r{seed}", error=error))
    assert committed() == errors
    row = mean_row()
    assert (row.value, row.sd) == pytest.approx((0.4, statistics.stdev(errors.values()))) and row.seeds == 3
    facts = manifest.entries(paths.REFERENCE, "table2")["teen"]
    assert facts["seeds"] == [0, 1, 2] and facts["run"] == row.run
    publish("all", *(result("teen", seed, f"r{seed}", error=error) for seed, error in errors.items()), add_seeds=False)
    assert mean_row() == row


def test_pictures_and_curves_stay_those_of_the_first_seed_and_charts_follow(publish, monkeypatch):
    monkeypatch.setattr(reference, "redraw_charts", redraw_charts)
    publish("first", result("teen", 0))
    chart, pose = (paths.REFERENCE / name for name in ("table2_teen_chart.json", "table2_teen_pose.npz"))
    before, curves = pose.stat().st_mtime_ns, read_curves(paths.REFERENCE / "table2_curves.csv")
    publish("second", result("teen", 1, "s", error=0.9), result("tiny", 1))
    assert pose.stat().st_mtime_ns == before
    assert read_curves(paths.REFERENCE / "table2_curves.csv").items() >= curves.items()
    assert f"Coarse {mean_row().value:.2f} mm" in json.loads(chart.read_text())["alt"]
    assert committed("tiny") and mean_row("tiny").seeds == 1, "a new character comes as a whole"


def test_a_table_that_is_not_committed_yet_of_a_character_comes_with_its_seed_and_stays_then(publish, tmp_path):
    def run_with_table4(name: str, seed: int, value: float) -> None:
        folder = tmp_path / name / "quick"
        folder.mkdir(parents=True)
        facts = ("vertex_error_mean", "mm", value, None, 1, 25, "quick", name)
        write_results(folder / "table4.csv", [Row("table4", "teen", "dense", *facts)])
        manifest.write_entries(folder, "table4", {"teen": {"run": name, "git": {"commit": name, "clean": True}}})
        publish(name, result("teen", seed, name))

    def table4() -> float:
        (row,) = read_results(paths.REFERENCE / "table4.csv")
        assert manifest.entries(paths.REFERENCE, "table4")["teen"]["run"] == row.run
        return row.value

    publish("first", result("teen", 0))
    run_with_table4("second", 1, 0.5)
    assert table4() == 0.5
    run_with_table4("third", 2, 0.9)
    assert table4() == 0.5 and sorted(committed()) == [0, 1, 2]


def test_a_seed_that_both_have_is_the_runs(publish):
    publish("first", result("teen", 0))
    publish("second", result("teen", 0, "s", error=0.9))
    assert committed() == {0: 0.9} and mean_row().sd is None


def test_a_method_that_a_run_lacks_stays_and_one_that_it_brings_joins_the_seed(publish):
    publish("first", result("teen", 0))
    before = {row.key for row in read_results(paths.REFERENCE / "table2.csv")}
    more = result("teen", 0, "s", error=0.9)
    table = more.folder / "table2.csv"
    rows = [replace(row, method="squares") for row in read_results(table) if row.method == "coarse"]
    write_results(table, rows)
    publish("second", more)
    after = read_results(paths.REFERENCE / "table2.csv")
    assert {row.key for row in after} == before | {row.key for row in rows}
    assert committed() == {0: mean_row().value} and mean_row().value != 0.9
    (name,) = {row.run for row in after}
    assert name == manifest.entries(paths.REFERENCE, "table2")["teen"]["run"] not in ("r0", "s")


def poses(character: str = "teen") -> list[float]:
    """Return how far the dense networks' vertices are off in each committed pose, mm."""
    records = [load_pose(pose_file(paths.REFERENCE, character, choice)) for choice in CHOICES]
    return [round(float(np.abs(r.vertices["dense"] - r.vertices[TRUTH]).max()), 3) for r in records]


def test_poses_and_curves_follow_the_methods_of_the_first_seed_where_they_show_the_same(publish):
    publish("first", result("teen", 0))
    publish("second", result("teen", 0, "s", moved=0.5))
    assert poses() == [0.5] * len(CHOICES)
    publish("third", result("teen", 1, "t", moved=0.7))
    assert poses() == [0.5] * len(CHOICES), "pictures are of the first seed"
    publish("fourth", result("teen", 0, "u", moved=0.9, pose=6))
    assert poses() == [0.5] * len(CHOICES), "another pose"


def test_a_method_may_have_other_numbers_if_no_seed_keeps_the_earlier_ones(publish):
    publish("first", result("teen", 0), result("teen", 1, "s"))
    changed = [result("teen", seed, run, error=0.9) for seed, run in ((0, "t"), (1, "u"))]
    changed = [
        replace(one, config=replace(one.config, coarse=replace(one.config.coarse, map_size=64))) for one in changed
    ]
    with pytest.raises(InputError, match="its seeds can't join the committed ones, since coarse"):
        publish("second", changed[0])
    publish("third", *changed)
    assert committed() == {0: 0.9, 1: 0.9}
    assert manifest.entries(paths.REFERENCE, "table2")["teen"]["configuration"]["coarse"]["map_size"] == 64


def test_the_section_of_a_method_that_a_run_lacks_may_differ_and_stays(publish):
    one, other = result("teen", 0), result("teen", 1, "s")
    full = resolve("teen", "quick", sections=sections("quick"))
    changed = replace(full, seed=1, pca=replace(full.pca, components=7))
    publish("first", replace(one, config=full))
    publish("second", replace(other, config=changed))
    facts = manifest.entries(paths.REFERENCE, "table2")["teen"]
    assert facts["seeds"] == [0, 1] and facts["configuration"]["pca"]["components"] == full.pca.components != 7


def test_without_the_option_a_run_replaces_all_seeds(publish):
    publish("first", result("teen", 0), result("teen", 1, "s"))
    publish("second", result("teen", 2, "t", error=0.9), add_seeds=False)
    assert committed() == {2: 0.9}
    assert manifest.entries(paths.REFERENCE, "table2")["teen"]["seeds"] == [2]


def test_stages_of_an_earlier_run_say_what_they_were_made_from(publish):
    publish("first", result("teen", 0, git={"commit": "older", "clean": True}))
    publish("second", result("teen", 1, "s"))
    facts = manifest.entries(paths.REFERENCE, "table2")["teen"]
    assert facts["git"] == {"commit": "c0ffee", "clean": True, "commits": ["c0ffee", "older"]}
    assert [stage.get("git", {}).get("commit") for stage in facts["stages"].values()] == ["older", None]


def test_pictures_that_were_drawn_anew_still_say_so_when_seeds_join(publish):
    publish("first", result("teen", 0))
    entries = manifest.entries(paths.REFERENCE, "table2")
    entries["teen"][manifest.DRAWN] = drawn = {"commit": "a" * 40, "clean": True}
    manifest.write_entries(paths.REFERENCE, "table2", entries)
    publish("second", result("teen", 1, "s"))
    assert manifest.entries(paths.REFERENCE, "table2")["teen"][manifest.DRAWN] == drawn
    publish("third", result("teen", 0), add_seeds=False)
    assert manifest.DRAWN not in manifest.entries(paths.REFERENCE, "table2")["teen"], "its pictures are the run's own"


def test_seeds_of_another_configuration_are_refused_and_nothing_changes(publish):
    publish("first", result("teen", 0))
    table = (paths.REFERENCE / "table2.csv").read_bytes()
    other = result("teen", 1, "s")
    other = replace(other, config=replace(other.config, coarse=replace(other.config.coarse, map_size=64)))
    with pytest.raises(InputError, match="teen: its seeds can't join the committed ones, since coarse"):
        publish("second", other)
    assert (paths.REFERENCE / "table2.csv").read_bytes() == table


def test_seeds_of_another_split_join_none_of_the_committed_ones_and_go_into_a_folder_of_their_own(publish):
    publish("first", result("teen", 0))
    table = (paths.REFERENCE / "table2.csv").read_bytes()
    publish("second", result("teen", 1, "s", split="clips"))
    assert (paths.REFERENCE / "table2.csv").read_bytes() == table
    apart = manifest.entries(paths.REFERENCE / paths.WHOLE_CLIPS, "table2")["teen"]
    assert apart["seeds"] == [1] and apart["split"] == "clips"


def test_committed_results_without_single_seeds_are_those_of_their_one_seed(publish):
    publish("first", result("teen", 4))
    (paths.REFERENCE / "table2_seeds.csv").unlink()
    publish("second", result("teen", 1, "s", error=0.9))
    (first,) = {row.value for row in table2_rows() if row.key[2:] == ("coarse", "vertex_error_mean")}
    assert committed() == {4: first, 1: 0.9}
