"""Committed pictures drawn anew from committed numbers: the manifest says by which commit, and numbers stay."""

from dataclasses import replace

import numpy as np
import pytest
from plane import flat_grid
from sample_rows import roofline_rows, table2_rows

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.report import manifest
from replicate.report.pose_record import PoseRecord, load_pose, normal_means_deg, pose_file, save_pose
from replicate.report.results import read_results, write_curves, write_results
from replicate.targets.reference import pictures

ENTRY = {"git": {"commit": "a" * 40, "clean": True}, "run": "r", "profile": "laptop", "seeds": [0, 1]}


@pytest.fixture
def reference(tmp_path, monkeypatch):
    """A committed Table 2 of the teen with one pose, and an old picture of its forehead."""
    monkeypatch.setattr(paths, "REFERENCE", tmp_path)
    monkeypatch.setattr(pictures, "git_state", lambda: {"commit": "d" * 40, "clean": True})
    write_results(tmp_path / "table2.csv", table2_rows(("teen",)))
    for name in ("bench_decoder", "bench_ladder"):
        write_results(tmp_path / f"{name}.csv", [])
    write_results(tmp_path / "bench_roofline.csv", roofline_rows())
    manifest.write_entries(tmp_path, "bench_roofline", {"teen": ENTRY})
    write_curves(tmp_path / "table2_curves.csv", {("teen", "dense"): ((1.0, 2.0, 3.0, 4.0),) * 2})
    flat, faces = flat_grid(np.linspace(-90, 90, 9), np.linspace(-90, 90, 9), 40)
    posed = flat + np.float32([0, 0, 3]) * np.sin(flat[:, 1:2] / 9)
    save_pose(pose_file(tmp_path, "teen"), PoseRecord("teen", 5, flat, faces, {"truth": posed, "dense": flat}))
    manifest.write_entries(tmp_path, "table2", {"teen": ENTRY})
    manifest.write_entries(tmp_path, "figure10", {"teen": {**ENTRY, "files": ["figure10_teen.webp"]}})
    (tmp_path / "figure10_teen_forehead.webp").write_bytes(b"old")
    return tmp_path


def test_pictures_are_drawn_and_their_entries_say_by_which_commit(reference):
    files = pictures.redraw(["teen"])
    names = ["table2_teen_chart", "figure10_teen", "figure09_teen", "table2_teen_curves", "figure10_teen_forehead"]
    assert [file.stem for file in files] == [*names, "bench_roofline_teen", "figure09", "figure10"]
    assert all(file.stat().st_size > 500 and file.with_suffix(".json").is_file() for file in files[:-2])
    for target in ("table2", "figure10"):
        facts = manifest.entries(reference, target)["teen"]
        assert facts["pictures"] == {"commit": "d" * 40, "clean": True, "from": "table2_teen_pose*.npz"}
        assert facts["run"] == "r", "the numbers' own"
    assert manifest.entries(reference, "table2")["teen"]["git"] == ENTRY["git"]
    drawn = manifest.entries(reference, "bench_roofline")["teen"]["pictures"]
    assert drawn == {"commit": "d" * 40, "clean": True}, "from rows alone"


def test_what_no_commit_would_tell_of_is_not_drawn(reference, monkeypatch):
    monkeypatch.setattr(pictures, "git_state", lambda: {"commit": "d" * 40, "clean": False})
    with pytest.raises(InputError, match="the tree has changes"):
        pictures.redraw(["teen"])
    assert "pictures" not in manifest.entries(reference, "table2")["teen"]


def test_numbers_are_those_of_the_poses_and_their_entry_names_the_run_of_these(reference):
    (reference / "figure10_teen.webp").write_bytes(b"a picture")
    others = [replace(row, table="figure10", character="ict") for row in table2_rows(("toon",))[:1]]
    write_results(reference / "figure10.csv", others)
    (file,) = pictures.put_numbers(["teen", "toon"])
    rows = read_results(file)
    assert {row.character: row.run for row in rows} == {"ict": "r", "teen": "r"} and file.name == "figure10.csv"
    whole = next(row for row in rows if row.key[1:] == ("teen", "dense", "normal_error_mean[folded]"))
    assert whole.value == pytest.approx(
        normal_means_deg(load_pose(pose_file(reference, "teen")), "dense")["whole mesh"]
    )
    facts = manifest.entries(reference, "figure10")["teen"]
    assert facts["from"] == "table2_teen_pose*.npz" and facts["seeds"] == [0], "of the first seed"
    assert facts["files"] == ["figure10_teen.webp", "figure10_teen_forehead.webp"] and "git" not in facts
