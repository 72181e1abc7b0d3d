"""The committed results: complete, from a clean tree, and what README and notebook show."""

import json
from pathlib import Path

import pytest

from replicate.base import paths
from replicate.cli.target_list import target_table
from replicate.methods.method_registry import methods
from replicate.report.results import STANDS_FOR, find, read_results
from replicate.report.tables import as_markdown, unbroken
from replicate.targets.reference import REPRODUCING, tables_in_texts, with_table
from replicate.targets.table2.rows import table2

CHARACTER = "teen"


def reference_file(name: str, target: str = "make table2") -> Path:
    """Return a file of the reference results; where it is missing the target that makes it is named."""
    file = paths.REFERENCE / name
    assert file.is_file(), f"{file} is missing: `{target}` makes it in results/runs, and `make reference` puts it there"
    return file


@pytest.fixture(scope="module")
def rows():
    return read_results(reference_file("table2.csv"))


def value_of(rows, method: str, metric: str) -> float:
    row = find(rows, "table2", CHARACTER, method, metric)
    assert row is not None, f"table2.csv has no {metric} of {method}"
    return row.value


def test_every_standard_method_is_there(rows):
    for name, method in methods().items():
        for metric in ("vertex_error_mean", "normal_error_mean"):
            assert not method.standard or value_of(rows, name, metric) > 0


def test_the_manifest_names_the_run_and_a_clean_tree(rows):
    manifest = json.loads(reference_file("manifest.json").read_text())
    states = [facts["git"] for facts in manifest["characters"].values()]
    assert all(git["clean"] and len(git["commit"]) == 40 for git in states)
    assert {row.run for row in rows} == {facts["run"] for facts in manifest["characters"].values()}
    assert {row.profile for row in rows if row.character.partition("@")[0] in STANDS_FOR} == {"laptop"}


@pytest.mark.parametrize("name", list(tables_in_texts()))
def test_a_text_shows_the_reference_and_nothing_else(name):
    file, csv, make_table = tables_in_texts()[name]
    text = file.read_text()
    assert with_table(text, name, make_table(reference_file(csv))) == text


def test_the_notebook_was_executed_on_the_reference(rows):
    text = (paths.ROOT / "notebooks" / "table2.ipynb").read_text()
    assert len(text) < 1_000_000
    outputs = [output for cell in json.loads(text)["cells"] for output in cell.get("outputs", ())]
    assert outputs and not any(output["output_type"] == "error" for output in outputs)
    texts = ["".join(output["data"].get("text/markdown", "")) for output in outputs if "data" in output]
    paper = read_results(paths.PAPER / "table2.csv")
    assert any(unbroken(as_markdown(table2(rows, paper, CHARACTER))).strip() in text for text in texts)


def test_reproducing_lists_the_targets_that_there_are():
    text = REPRODUCING.read_text(encoding="utf-8")
    assert with_table(text, "targets", target_table()) == text, "`make reference` writes the list"
