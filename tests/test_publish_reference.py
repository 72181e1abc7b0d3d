"""`make reference`: whole runs from clean trees alone, other characters' benchmarks kept, README's table replaced."""

import json

import pytest

from replicate import manifest, paths, reference
from replicate.errors import InputError
from replicate.evaluation.results import Row, read_results, write_results
from replicate.figures import notebooks

CLEAN = {"git": {"commit": "c" * 40, "clean": True}, "run": "r"}


def row(character: str, table: str = "table2", value: float = 0.5) -> Row:
    return Row(table, character, "coarse", "vertex_error_mean", "mm", value, None, 1, 9, "laptop", "r")


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """A profile's results, two benchmarks' and committed ones; what executes notebooks is noted, not run."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    monkeypatch.setattr(paths, "REFERENCE", tmp_path / "reference")
    monkeypatch.setattr(reference, "README", tmp_path / "README.md")
    (tmp_path / "README.md").write_text(f"before\n{reference.BEGIN}old\n{reference.END}after\n")
    executed = []
    monkeypatch.setattr(notebooks, "run_notebook", lambda name, results: executed.append(name) or tmp_path / name)
    run, bench = tmp_path / "runs" / "laptop", tmp_path / "runs" / "bench"
    run.mkdir(parents=True)
    bench.mkdir()
    write_results(run / "table2.csv", [row("teen")])
    (run / "figure10_teen.png").write_bytes(b"png")
    (run / "table2.ipynb").write_text("{}")
    manifest.write_entries(run, "table2", {"teen": CLEAN})
    write_results(bench / "bench_rig.csv", [row("teen", "bench_rig", 1.0)])
    manifest.write_entries(bench, "bench_rig", {"teen": CLEAN})
    return run, bench, tmp_path / "reference", executed


def test_results_benchmarks_manifest_and_readme_are_written(folders):
    run, _, committed, executed = folders
    committed.mkdir()
    write_results(committed / "bench_rig.csv", [row("teen", "bench_rig", 2.0), row("woman", "bench_rig", 3.0)])
    reference.publish_reference("laptop")
    assert (committed / "table2.csv").read_bytes() == (run / "table2.csv").read_bytes()
    assert (committed / "figure10_teen.png").is_file() and not (committed / "table2.ipynb").exists()
    kept = {found.character: found.value for found in read_results(committed / "bench_rig.csv")}
    assert kept == {"teen": 1.0, "woman": 3.0}, "the other character's stays"
    assert manifest.targets(committed) == ["table2", "bench_rig"]
    assert executed == ["rig_tour", "table2"]
    text = reference.README.read_text()
    assert (
        text.startswith("before\n") and text.endswith("after\n") and "old" not in text and "| Coarse | 0.50 |" in text
    )


@pytest.mark.parametrize("where", ["table2", "bench_rig"])
def test_a_tree_with_changes_is_refused_and_nothing_is_written(folders, where):
    run, bench, committed, _ = folders
    changed = {**CLEAN, "git": {"commit": "c" * 40, "clean": False}}
    manifest.write_entries(run if where == "table2" else bench, where, {"teen": changed})
    with pytest.raises(InputError, match=f"{where} of teen .* made from a tree with changes"):
        reference.publish_reference("laptop")
    assert not committed.exists()


def test_without_results_the_target_that_makes_them_is_named(folders):
    run, *_ = folders
    (run / manifest.NAME).write_text(json.dumps([]))
    with pytest.raises(InputError, match="there are no results; `make table2 PROFILE=laptop` writes them"):
        reference.publish_reference("laptop")


def test_a_readme_without_its_marks_is_refused():
    with pytest.raises(InputError, match="found no lines"):
        reference.with_table("# A text\n", "| a |")
