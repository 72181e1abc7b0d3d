"""The numbers of Figures 1, 9 and 10 are those below and beside their pictures, unrounded; tables and answers too."""

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from bumpy_plate import bumpy_plate, texts_of
from sample_results import GIT
from toy_stages import ToyConfig

from replicate.base import paths
from replicate.config import resolve
from replicate.engine import store
from replicate.engine.stage import Stage
from replicate.report import manifest, notebooks
from replicate.report.pose_record import CHOICES, TRUTH, PoseRecord, load_pose, plain_name, pose_file
from replicate.report.publication import CharacterResult
from replicate.report.results import Row, read_results, write_results
from replicate.report.tables import as_text
from replicate.targets.figure01 import figure01
from replicate.targets.figure09.forehead_wrinkles import figure09, fold_change_deg
from replicate.targets.figure10 import figure10
from replicate.targets.pose_numbers import answer, pose_tables, publish, rows_of

FIGURES = ("figure01", "figure09", "figure10")


@pytest.fixture
def records() -> dict[str, PoseRecord]:
    """A bumpy plate in three poses, as the refined networks, LBS and others predict it."""
    plate = bumpy_plate()
    coarse, dense = (plate.vertices[name] for name in ("coarse", "dense"))
    more = {"refined": (coarse + plate.vertices["truth"]) / 2, "lbs32": dense + np.float32([0, 0, 1]), "floor": coarse}
    record = replace(plate, vertices=plate.vertices | more)
    numbered = {choice: replace(record, choice=choice, pose=pose) for pose, choice in enumerate(CHOICES, 7)}
    return numbered | {"worst": replace(numbered["worst"], vertices=plate.vertices)}


def rows_in(figure: str, records: dict[str, PoseRecord]) -> list[Row]:
    return rows_of(figure, records, 10.0, "quick", "r")


def values(rows: Sequence[Row]) -> dict[tuple[str, str], float]:
    return {(row.method, row.metric): row.value for row in rows}


def test_figure_1_draws_the_distances_and_normal_errors_of_its_rows(records):
    own = values(rows_in("figure01", records))
    figure, words = figure01(records["folded"], 40)
    expected = []
    for method in ("refined", "lbs32"):
        distance, degrees = (own[method, f"{kind}_error_mean[folded]"] for kind in ("vertex", "normal"))
        forehead = own[method, "normal_error_mean[folded][forehead]"]
        expected += [f"{distance:.2f} mm, {degrees:.2f}°", f"forehead: {forehead:.2f}°"]
        assert f"{plain_name(method)} {', '.join(expected[-2:])}" in words.alt
    assert [text for text in texts_of(figure) if text.endswith("°")] == expected
    assert own.pop((TRUTH, "test_pose[folded]")) == 7 and "test pose 7 of" in words.caption and len(own) == 6


def test_figure_9_draws_the_foreheads_errors_of_its_rows(records):
    own = values(rows_in("figure09", records))
    figure, words = figure09(records["folded"], across=40)
    degrees = {method: value for (method, metric), value in own.items() if metric.startswith("normal_error")}
    assert list(degrees) == ["refined", "coarse", "dense", "lbs32"]
    strips = [own[method, "strip_error_mean[folded]"] for method in degrees]
    drawn = [text for text in texts_of(figure) if "°" in text]
    assert drawn[::2] == [f"forehead: {mean:.2f}°" for mean in degrees.values()]
    assert drawn[1::2] == [f"strip: {mean:.2f}°" for mean in strips]
    assert all(f"{plain_name(method)} {mean:.2f}° and" in words.alt for method, mean in degrees.items())
    assert own[TRUTH, "fold_change_mean[folded][forehead]"] == fold_change_deg(records["folded"])
    bare = replace(records["folded"], region_names=(), region=None)
    assert {metric for _, metric in values(rows_in("figure09", {"folded": bare}))} >= {"normal_error_mean[folded]"}


@pytest.mark.parametrize("choice", CHOICES)
def test_figure_10_draws_the_errors_of_its_rows_in_every_pose_and_region(records, choice):
    own = values(rows_in("figure10", records))
    figure, words = figure10(records[choice], 10.0, across=40)
    drawn = [text for text in texts_of(figure) if text.endswith("°")]
    shown = [f"{value:.2f}°" for (_, metric), value in own.items() if metric == f"normal_error_mean[{choice}]"]
    assert sorted(drawn) == sorted(shown) and len(set(drawn)) >= 2
    for (method, metric), value in own.items():
        if metric == f"normal_error_mean[{choice}]":
            assert f"{plain_name(method)} {value:.2f}°" in words.alt
    assert f"test pose {own[TRUTH, f'test_pose[{choice}]']:.0f} of" in words.caption.lower()
    assert own[TRUTH, "colour_limit"] == 10 and "0° to 10°" in words.caption
    assert not any(method == "floor" for method, _ in own), "figures don't show it"


def test_a_region_without_normals_has_no_row(records):
    record = records["folded"]
    nowhere = replace(record, region_names=("forehead", "mouth", "nose"))
    metrics = {metric for _, metric in values(rows_in("figure10", {"folded": nowhere}))}
    assert "normal_error_mean[folded][mouth]" in metrics and "normal_error_mean[folded][nose]" not in metrics
    cells = [row for row in pose_tables(rows_in("figure10", {"folded": nowhere}), "figure10")[0].body if row[1]]
    assert all(len(row) == 4 for row in cells)


def test_rows_survive_a_file_and_give_the_same_table_and_answer(records, tmp_path):
    for figure in FIGURES:
        rows = rows_in(figure, records)
        write_results(tmp_path / f"{figure}.csv", rows)
        stored = read_results(tmp_path / f"{figure}.csv")
        assert pose_tables(stored, figure) == pose_tables(rows, figure) and answer(stored, figure) == answer(
            rows, figure
        )


def test_tables_have_a_heading_for_each_pose_and_a_column_for_each_region_from_the_top_of_the_face(records):
    (table,) = pose_tables(rows_in("figure10", records), "figure10")
    assert table.headers == (("", "normal error, °", "", ""), ("", "whole mesh", "forehead", "mouth"))
    headings = [row[0] for row in table.body if not any(row[1:])]
    assert headings == ["test pose 7, the forehead folds most", "test pose 8, the median", "test pose 9, the worst"]
    first = values(rows_in("figure10", records))["coarse", "normal_error_mean[folded][mouth]"]
    assert table.body[1][0] == "Coarse" and table.body[1][3] == f"{first:.2f}"
    (table,) = pose_tables(rows_in("figure01", records), "figure01")
    assert table.headers == (("", "distance error, mm", "normal error, °"), ("", "teen", "teen"))
    assert table.body[0] == ("test pose", "7", "7") and "An oracle" in as_text(table)
    both = [*rows_in("figure09", records), *(replace(row, character="toon") for row in rows_in("figure09", records))]
    tables = pose_tables([row for row in both if row.key[1:3] != ("toon", "coarse")], "figure09")
    assert [table.title.rpartition(" of the ")[2] for table in tables] == ["forehead", "lower strip"]
    for table, kind in zip(tables, ("normal", "strip"), strict=True):
        degrees = values(rows_in("figure09", records))[
            "coarse", f"{kind}_error_mean[folded]" + "[forehead]" * (kind == "normal")
        ]
        assert table.headers == (("", "normal error, °", ""), ("", "teen", "toon"))
        assert table.body[:2] == (("test pose", "7", "7"), ("Coarse", f"{degrees:.2f}", "–"))


def rows_of_method(character: str, method: str, degrees: float, mm: float | None = None) -> list[Row]:
    facts = (None, 1, 1, "quick", "r")
    rows = [Row("figure01", character, method, "normal_error_mean[folded]", "deg", degrees, *facts)]
    if mm is not None:
        rows.append(Row("figure01", character, method, "vertex_error_mean[folded]", "mm", mm, *facts))
    return rows


def test_the_answer_counts_poses_and_tells_oracles_from_what_sees_parameters_alone():
    rows = [*rows_of_method("teen", "refined", 1.0, 0.2), *rows_of_method("teen", "lbs32", 2.0, 0.1)]
    assert answer(rows, "figure01") == (
        "**“Refined” has smaller normal errors than “LBS: 32 bones” in this pose**: 1.00° against 2.00°, means over "
        "the whole mesh (in distance 0.20 mm against 0.10 mm). Of all that see rig parameters alone, “Refined” is the "
        "nearest in this pose, with 1.00°."
    )
    rows += [
        *rows_of_method("toon", "refined", 1.5),
        *rows_of_method("toon", "lbs32", 0.5),
        *rows_of_method("toon", "regional", 0.25),
    ]
    said = answer(rows, "figure01")
    assert "in 1 of 2 poses**: 1.00° to 1.50° against 0.50° to 2.00°" in said
    assert "“Refined” is the nearest in 1 of 2 poses" in said
    assert "in none of the 2 poses" in answer(
        [replace(row, value=9.0) if row.method == "refined" else row for row in rows], "figure01"
    )
    assert answer(rows_of_method("teen", "lbs32", 1.0), "figure01") == "" and answer([], "figure01") == ""


def figure_result(character: str, seed: int, value: float, run: str) -> CharacterResult:
    """Return a character whose artefact holds a made-up Figure 1 of one seed."""

    def build(out, scratch):
        rows = [replace(row, run=run) for row in rows_of_method(character, "refined", value)]
        write_results(out / "figure01.csv", rows)
        (out / f"figure01_{character}.png").write_text(run)
        return {"key": "k", "wall_s": 1.0, "run": {"git": GIT, "profile": "quick"}}

    stage = Stage("figure01", "toy_stages:numbers", ToyConfig(seed), label=f"{character}-{run}")
    store.make(stage.identifier, build)
    return CharacterResult(resolve(character, "quick", seed=seed), stage)


def test_of_several_seeds_the_numbers_are_those_of_the_picture_and_other_characters_stay(
    tmp_path, cache, monkeypatch, capsys
):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    monkeypatch.setattr(notebooks, "execute", lambda source, out, parameters, stamp: out.write_text(stamp))
    place = tmp_path / "results" / "quick"
    publish("figure01", [figure_result("teen", 0, 1.0, "r"), figure_result("teen", 1, 3.0, "s")])
    publish("figure01", [figure_result("tiny", 0, 2.0, "t")])
    found = {row.character: (row.value, row.sd, row.run) for row in read_results(place / "figure01.csv")}
    assert found == {"teen": (1.0, None, "r"), "tiny": (2.0, None, "t")}
    assert (place / "figure01_teen.png").read_text() == "r" and (place / "figure01.ipynb").is_file()
    entries = manifest.entries(place, "figure01")
    assert {name: facts["run"] for name, facts in entries.items()} == {"teen": "r", "tiny": "t"}
    assert entries["teen"]["files"] == ["figure01_teen.png"] and "Refined" in capsys.readouterr().out


@pytest.mark.parametrize("figure", FIGURES)
def test_committed_numbers_are_those_of_the_committed_poses(figure):
    rows = read_results(paths.REFERENCE / f"{figure}.csv")
    entries = manifest.entries(paths.REFERENCE, figure)
    assert {row.character for row in rows} == set(entries) and {"teen", "woman", "dragon", "toon"} <= set(entries)
    for character, facts in entries.items():
        own = [row for row in rows if row.character == character]
        assert {row.run for row in own} == {facts["run"]}
        if manifest.POSES in facts:
            records = {choice: load_pose(pose_file(paths.REFERENCE, character, choice)) for choice in CHOICES}
            again = rows_of(figure, records, 30.0, facts["profile"], facts["run"])
            assert values(own) == pytest.approx(values(again), rel=1e-4)
            assert facts["run"] == manifest.entries(paths.REFERENCE, manifest.TOP)[character]["run"]


@pytest.mark.parametrize("figure", FIGURES)
def test_committed_pictures_say_the_committed_numbers(figure):
    rows = read_results(paths.REFERENCE / f"{figure}.csv")
    for character, facts in manifest.entries(paths.REFERENCE, figure).items():
        own = values([row for row in rows if row.character == character])
        words = [file for file in facts["files"] if file.endswith(".json")]
        assert words, "each picture has its words beside it"
        for name in words:
            choice = next((choice for choice in CHOICES if f"_{choice}." in name), "folded")
            said = json.loads((paths.REFERENCE / name).read_text())
            assert f"test pose {own[TRUTH, f'test_pose[{choice}]']:.0f} of {character}," in said["caption"].lower()
            region = "[forehead]" if figure == "figure09" or "_forehead" in name else ""
            means = {m: v for (m, metric), v in own.items() if metric == f"normal_error_mean[{choice}]{region}"}
            between = " {:.2f} mm," if figure == "figure01" else ""
            shown = [method for method in means if f"{plain_name(method)} " in said["alt"]]
            assert len(shown) >= min(3, len(means))
            for method, mean in ((method, means[method]) for method in shown):
                distance = between.format(own.get((method, f"vertex_error_mean[{choice}]"), 0))
                assert f"{plain_name(method)}{distance} {mean:.2f}°" in said["alt"], (name, method)
