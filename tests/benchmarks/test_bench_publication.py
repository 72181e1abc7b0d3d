"""What benchmarks keep: no row is lost where two write at once, and a place that can't be written is known at first."""

import ast
import json
import threading
import time

import pytest

from replicate.base.paths import ROOT
from replicate.benchmarks import common
from replicate.report import manifest
from replicate.report.results import Row, read_results

NAME = "bench_toy"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    return tmp_path / "runs" / "bench"


def publish(character: str, method: str = "dense", words=(), in_part: bool = False) -> None:
    row = Row(NAME, character, method, "time", "ms", 1.0, None, 1, 1, "bench", "run")
    common.publish(NAME, [row], [], words, in_part)


def answer(body) -> int:
    return common.answer(common.make_parser(NAME, "Measure toys."), body, [])


@pytest.mark.parametrize("module, slow", [(common, "read_results"), (manifest, "entries")])
def test_two_benchmarks_that_write_at_once_lose_nothing(folder, monkeypatch, module, slow):
    publish("tiny")
    read, reading = getattr(module, slow), threading.Event()

    def read_slowly(*place):
        found = read(*place)
        if not reading.is_set():
            reading.set()
            time.sleep(0.5)
        return found

    monkeypatch.setattr(module, slow, read_slowly)
    first = threading.Thread(target=publish, args=("teen",))
    first.start()
    assert reading.wait(10)
    publish("toon")
    first.join()
    assert {row.character for row in read_results(folder / f"{NAME}.csv")} == {"teen", "tiny", "toon"}
    notes = json.loads((folder / "manifest.json").read_text())["targets"][NAME]
    assert set(notes["characters"]) == {"teen", "tiny", "toon"}


def test_the_manifest_names_the_commands_of_all_parts_and_of_a_whole_run_its_own_alone(folder):
    def parts():
        entry = json.loads((folder / "manifest.json").read_text())["targets"][NAME]["characters"]["tiny"]
        return [part["command"].split()[-1] for part in (*entry.get("earlier", []), entry)]

    for method in ("linear", "dense", "coarse", "dense"):
        publish("tiny", method, ["--only", method], in_part=True)
    assert parts() == ["linear", "coarse", "dense"]
    assert {row.method for row in read_results(folder / f"{NAME}.csv")} == {"linear", "dense", "coarse"}
    publish("tiny", "dense", ["--characters", "tiny"])
    assert parts() == ["tiny"]


def test_a_place_that_can_not_be_written_ends_in_a_sentence_before_anything_is_measured(folder, capsys):
    folder.parent.mkdir()
    folder.write_text("a file")
    assert answer(lambda options, words: pytest.fail("it measures")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "can't be written to" in line and "set REPLICATE_RESULTS" in line


@pytest.mark.parametrize("damage", ["a,b\n", "folder"])
def test_earlier_rows_that_can_not_be_read_end_in_a_sentence_before_anything_is_measured(folder, damage, capsys):
    file = folder / f"{NAME}.csv"
    folder.mkdir(parents=True)
    file.mkdir() if damage == "folder" else file.write_text(damage)
    assert answer(lambda options, words: pytest.fail("it measures")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(file) in line and line.endswith("new rows would join that file: mend or remove it")


def test_a_check_of_the_place_leaves_nothing_there(folder):
    assert answer(lambda options, words: None) == 0
    assert not folder.parent.exists()


@pytest.mark.parametrize("file", sorted((ROOT / "replicate/benchmarks").glob("bench_*.py")), ids=lambda file: file.stem)
def test_a_benchmark_runs_once_all_of_its_module_is_there(file):
    *_, last = ast.parse(file.read_text(encoding="utf-8")).body
    assert isinstance(last, ast.If) and ast.unparse(last.test) == "__name__ == '__main__'"
