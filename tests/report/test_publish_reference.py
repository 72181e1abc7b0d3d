"""`make reference`: whole runs from clean trees alone, others' benchmarks kept, tables in texts replaced."""

import json
import warnings
from dataclasses import replace

import pytest
from bumpy_plate import bumpy_plate
from PIL import Image
from toy_texts import TABLES, texts_to_fill

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.report import manifest, notebooks
from replicate.report.pose_record import pose_file, save_pose
from replicate.report.results import Row, read_curves, read_results, write_curves, write_results
from replicate.report.tables import Table
from replicate.targets import reference
from replicate.targets.claims.verdicts import read_verdicts

CLEAN = {"git": {"commit": "c" * 40, "clean": True}, "run": "r", "seeds": [0]}


def row(character: str, table: str = "table2", value: float = 0.5) -> Row:
    return Row(table, character, "coarse", "vertex_error_mean", "mm", value, None, 1, 9, "laptop", "r")


def time_of(character: str, where: str, value: float) -> Row:
    return Row("table3", character, "refined", f"time_{where}", "ms", value, None, 1, 9, "laptop", "r")


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """A profile's results, two benchmarks' and committed ones; what executes notebooks is noted, not run."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    monkeypatch.setattr(paths, "REFERENCE", tmp_path / "reference")
    texts_to_fill(tmp_path, monkeypatch)
    notebook_names = []
    monkeypatch.setattr(notebooks, "run_notebook", lambda name, results: notebook_names.append(name) or tmp_path / name)
    run, bench = tmp_path / "runs" / "laptop", tmp_path / "runs" / "bench"
    run.mkdir(parents=True)
    bench.mkdir()
    write_results(run / "table2.csv", [row("teen")])
    Image.new("RGB", (30, 20), "teal").save(run / "figure10_teen.png")
    (run / "table2.ipynb").write_text("{}")
    manifest.write_entries(run, "table2", {"teen": CLEAN})
    write_results(bench / "bench_floors.csv", [row("teen", "bench_floors", 1.0)])
    manifest.write_entries(bench, "bench_floors", {"teen": CLEAN})
    return run, bench, tmp_path / "reference", notebook_names


def test_results_benchmarks_manifest_and_readme_are_written(folders):
    run, _, reference_folder, notebook_names = folders
    reference_folder.mkdir()
    write_results(reference_folder / "bench_floors.csv", [row(who, "bench_floors", 2.0) for who in ("teen", "woman")])
    reference.publish_reference("laptop")
    assert (reference_folder / "table2.csv").read_bytes() == (run / "table2.csv").read_bytes()
    with Image.open(reference_folder / "figure10_teen.webp") as picture:
        assert picture.format == "WEBP" and picture.size == (30, 20)
    assert not any((reference_folder / name).exists() for name in ("figure10_teen.png", "table2.ipynb"))
    values = {row.character: row.value for row in read_results(reference_folder / "bench_floors.csv")}
    assert values == {"teen": 1.0, "woman": 2.0}, "the other character's stays"
    assert manifest.targets(reference_folder) == ["table2", "bench_floors"]
    studies = [f"table2_{name}" for name in ("clips", "layouts", "line", "profiles", "training")]
    assert notebook_names == ["claims", "rig_tour", "table2", *studies]
    brief = reference.README.read_text()
    assert (
        brief.count("\nold\n") == len(TABLES) - 1
        and "| C1 The refined model beats the coarse one in both errors |" in brief
    )
    text = reference.RESULTS.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and text.count("\nold\n") == len(TABLES) - 5
    assert "| Coarse | 0.50 |" in text and "| teen (Hiccup) |" in text
    verdicts = {one.results for one in read_verdicts(reference_folder / "claims.csv")}
    assert verdicts <= {"", "reference"}, "they are of the committed rows, not of the run's"


def test_no_file_is_left_open(folders):
    _, _, reference_folder, _ = folders
    reference_folder.mkdir()
    write_results(reference_folder / "bench_floors.csv", [row("woman", "bench_floors", 2.0)])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", ResourceWarning)
        reference.publish_reference("laptop")
    assert [str(one.message) for one in said if issubclass(one.category, ResourceWarning)] == []


def test_a_benchmark_that_was_run_in_part_joins_what_is_committed(folders):
    _, bench, reference_folder, _ = folders
    reference_folder.mkdir()
    earlier = [replace(row("teen", "bench_floors", 2.0), metric=metric) for metric in ("vertex_error_mean", "other")]
    write_results(reference_folder / "bench_floors.csv", earlier)
    entry = {"command": "bench_floors", "seeds": [0], "git": {"commit": "b" * 40, "clean": True}}
    manifest.write_entries(reference_folder, "bench_floors", {"teen": entry})
    manifest.write_entries(bench, "bench_floors", {"teen": CLEAN | {"command": "bench_floors --only mean"}})
    reference.publish_reference("laptop")
    values = {row.metric: row.value for row in read_results(reference_folder / "bench_floors.csv")}
    assert values == {"vertex_error_mean": 1.0, "other": 2.0}
    facts = manifest.entries(reference_folder, "bench_floors")["teen"]
    assert facts["command"] == "bench_floors; bench_floors --only mean"
    assert facts["git"]["commits"] == ["c" * 40, "b" * 40] and facts["git"]["clean"]


def test_benchmarks_alone_are_put_beside_committed_results(folders):
    run, _, reference_folder, _ = folders
    (run / manifest.NAME).unlink()
    reference_folder.mkdir()
    write_results(reference_folder / "table2.csv", [row("teen", value=0.7)])
    reference.publish_reference("laptop")
    assert read_results(reference_folder / "table2.csv")[0].value == 0.7, "no manifest tells of the profile's"
    assert not (reference_folder / "figure10_teen.webp").exists()
    assert read_results(reference_folder / "bench_floors.csv")[0].value == 1.0
    assert manifest.targets(reference_folder) == ["bench_floors"]


def test_a_character_that_the_run_lacks_stays(folders):
    run, _, reference_folder, _ = folders
    reference_folder.mkdir()
    curve = ((1.0, 2.0, 3.0, 4.0),)
    for folder, shown, value in ((reference_folder, ("teen", "woman"), 0.7), (run, ("teen",), 0.5)):
        write_results(folder / "table2.csv", [row(who, value=value) for who in shown])
        write_curves(folder / "table2_curves.csv", {(who, "coarse"): curve * len(shown) for who in shown})
        manifest.write_entries(folder, "table2", {who: {**CLEAN, "run": f"{value}"} for who in shown})
    reference.publish_reference("laptop")
    values = {row.character: row.value for row in read_results(reference_folder / "table2.csv")}
    assert values == {"teen": 0.5, "woman": 0.7}
    curves = read_curves(reference_folder / "table2_curves.csv")
    assert curves == {("teen", "coarse"): curve, ("woman", "coarse"): curve * 2}
    runs = {who: facts["run"] for who, facts in manifest.entries(reference_folder, "table2").items()}
    assert runs == {"teen": "0.5", "woman": "0.7"}


def test_a_check_replaces_the_committed_one(folders):
    run, _, reference_folder, _ = folders
    reference_folder.mkdir()
    manifest.write_entries(run, "check", {"tiny": CLEAN})
    for folder, value in ((reference_folder, "1.0"), (run, "2.0")):
        (folder / "check_tiny.csv").write_text(f"character,kind,name,metric\ntiny,face,size,{value}\n")
    reference.publish_reference("laptop")
    assert (reference_folder / "check_tiny.csv").read_text().endswith("tiny,face,size,2.0\n")


def test_numbers_of_figures_go_with_the_poses_of_table_2(folders):
    run, _, reference_folder, _ = folders
    save_pose(pose_file(run, "teen"), bumpy_plate())
    manifest.write_entries(run, "table2", {"teen": {**CLEAN, "profile": "laptop"}})
    reference.publish_reference("laptop")
    rows = read_results(reference_folder / "figure10.csv")
    assert {(row.character, row.run) for row in rows} == {("teen", "r")}
    assert {row.method for row in rows} == {"truth", "coarse", "dense"}
    assert not (reference_folder / "figure01.csv").exists(), "it has no picture"


def test_meshes_of_a_face_from_elsewhere_and_of_variants_stay_out(folders):
    run, _, reference_folder, _ = folders
    for name in ("table2_ict_pose.npz", "table2_toon_pose.npz", "table2_teen@fine_pose.npz"):
        (run / name).write_bytes(b"meshes")
    (run / "figure10_teen.png").rename(run / "figure10_ict.png")
    reference.publish_reference("laptop")
    there = {file.name for file in reference_folder.iterdir()}
    assert {"table2_toon_pose.npz", "figure10_ict.webp"} <= there and not {
        "table2_ict_pose.npz",
        "table2_teen@fine_pose.npz",
    } & there


def test_a_benchmark_that_no_manifest_tells_of_is_left_out(folders):
    _, bench, reference_folder, _ = folders
    write_results(bench / "bench_rig.csv", [row("teen", "bench_rig")])
    reference.publish_reference("laptop")
    assert not (reference_folder / "bench_rig.csv").exists()


def test_the_paper_profile_has_a_folder_of_its_own_beside_what_texts_quote(folders, tmp_path):
    run, _, reference_folder, notebook_names = folders
    reference_folder.mkdir()
    write_results(reference_folder / "table2.csv", [row("teen", value=0.7)])
    with pytest.raises(InputError, match="there is no Table 2; `make table2 PROFILE=paper` writes it"):
        reference.publish_reference("paper")
    longer = tmp_path / "runs" / "paper"
    run.rename(longer)
    reference.publish_reference("paper")
    apart = reference_folder / paths.PAPER_PROFILE
    assert read_results(apart / "table2.csv") == [row("teen")] and manifest.targets(apart) == ["table2"]
    assert read_results(reference_folder / "table2.csv")[0].value == 0.7 and manifest.targets(reference_folder) == []
    assert "table2" in notebook_names and not (reference_folder / "bench_floors.csv").exists()
    manifest.write_entries(longer, "table2", {"teen": {**CLEAN, "git": {"commit": "c" * 40, "clean": False}}})
    with pytest.raises(InputError, match="made from a tree with changes"):
        reference.publish_reference("paper")


def test_whole_clips_have_a_folder_of_their_own_and_are_not_mixed_with_frames(folders):
    run, _, reference_folder, _ = folders
    manifest.write_entries(run, "table2", {"teen": {**CLEAN, "split": "clips"}})
    reference.publish_reference("laptop")
    apart = reference_folder / paths.WHOLE_CLIPS
    assert read_results(apart / "table2.csv") == [row("teen")] and not (reference_folder / "table2.csv").exists()
    both = {"teen": {**CLEAN, "split": "clips"}, "tiny": {**CLEAN, "split": "frames"}}
    manifest.write_entries(run, "table2", both)
    with pytest.raises(InputError, match=r"Table 2 has several splits \(teen clips, tiny frames\): publish one"):
        reference.publish_reference("laptop")
    manifest.write_entries(run, "table2", {"teen": {**CLEAN, "split": "clips"}})
    run.rename(run.with_name("paper"))
    with pytest.raises(InputError, match=r"results on whole clips can't be published with the profile paper"):
        reference.publish_reference("paper")


def test_times_on_a_gpu_have_a_folder_of_their_own_beside_what_texts_quote(folders):
    run, _, reference_folder, notebook_names = folders
    reference_folder.mkdir()
    apart = reference_folder / paths.GPU_MACHINE
    apart.mkdir()
    for folder, value, who in ((reference_folder, 0.7, "teen"), (apart, 0.2, "toon")):
        write_results(folder / "table3.csv", [time_of(who, "all_cores", value)])
        manifest.write_entries(folder, "table3", {who: {**CLEAN, "run": f"{value}"}})
    timed = [time_of("teen", where, 0.5) for where in ("all_cores", "gpu")]
    write_results(run / "table3.csv", timed)
    manifest.write_entries(run, "table3", {"teen": CLEAN})
    reference.publish_reference("laptop")
    assert read_results(apart / "table3.csv") == [*timed, time_of("toon", "all_cores", 0.2)]
    assert list(manifest.entries(apart, "table3")) == ["teen", "toon"]
    assert read_results(reference_folder / "table3.csv") == [time_of("teen", "all_cores", 0.7)]
    assert manifest.entries(reference_folder, "table3")["teen"]["run"] == "0.7"
    assert (reference_folder / "table2.csv").is_file() and {"table2", "table3", "claims"} <= {*notebook_names}
    write_results(run / "table3.csv", [*timed, time_of("woman", "all_cores", 0.5)])
    with pytest.raises(InputError, match="Table 3 has no times on a GPU for woman: publish these apart"):
        reference.publish_reference("laptop")


@pytest.mark.parametrize("where", ["table2", "bench_floors"])
def test_a_tree_with_changes_is_refused_and_nothing_is_written(folders, where):
    run, bench, reference_folder, _ = folders
    entry = {**CLEAN, "git": {"commit": "c" * 40, "clean": False}}
    manifest.write_entries(run if where == "table2" else bench, where, {"teen": entry})
    with pytest.raises(InputError, match=f"{where} of teen .* made from a tree with changes"):
        reference.publish_reference("laptop")
    assert not reference_folder.exists()


def test_without_results_the_target_that_makes_them_is_named(folders):
    run, bench, *_ = folders
    for folder in (run, bench):
        (folder / manifest.NAME).write_text(json.dumps([]))
    with pytest.raises(InputError, match="there are no results; `make table2 PROFILE=laptop` writes them"):
        reference.publish_reference("laptop")


def test_a_readme_without_its_marks_is_refused():
    with pytest.raises(InputError, match=r"expected the lines .*table2, by make reference"):
        reference.with_table("# A text\n", "table2", Table("", (("a",),), (("b",),)))
