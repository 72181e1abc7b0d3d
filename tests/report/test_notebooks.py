"""Notebooks: thin over the library, executed to the same bytes, and open from a folder of results alone."""

import ast
import json
import re
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from plane import flat_grid
from sample_rows import CURVE, cells_after, rig_report_rows, table1_rows, table2_rows

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.base.paths import run_folder
from replicate.benchmarks.bench_training import balance_text, draws_text, trainings_tables
from replicate.report import notebooks
from replicate.report.notebooks import execute, main, with_parameters
from replicate.report.pose_record import PoseRecord, pose_file, save_pose
from replicate.report.results import Row, read_results, write_curves, write_results
from replicate.report.tables import Table, as_text
from replicate.targets.claims import write_claims
from replicate.targets.claims.rules import gather
from replicate.targets.claims.verdicts import CLAIMS
from replicate.targets.figure05 import POSES_HEADER
from replicate.targets.figure07 import HEADER as SEGMENTS_HEADER
from replicate.targets.figure08 import HEADER as REFINEMENT_HEADER
from replicate.targets.rig_report.rows import write_pairs
from replicate.targets.table2.charts import open_table2, table2_figure_names, table2_figures

RESULT_KINDS = ("text/html", "image/png", "image/jpeg")
FILES = sorted(notebooks.NOTEBOOKS.glob("*.ipynb"))
TABLE2 = notebooks.NOTEBOOKS / "table2.ipynb"


def cells(path: Path, kind: str) -> list[dict]:
    raw_cells = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == kind]
    return [cell | {"source": "".join(cell["source"])} for cell in raw_cells]


@pytest.fixture
def empty(tmp_path, monkeypatch) -> Path:
    """The folder of the results of the profile "quick"; none are there."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    run_folder("quick").mkdir(parents=True)
    return run_folder("quick")


@pytest.fixture
def folder(empty) -> Path:
    """The same with results as `make table2` leaves them, for a plate with a bump as character."""
    flat, faces = flat_grid(np.linspace(-90, 90, 9), np.linspace(-90, 90, 9), 40)
    segment = Row("table2_segments", "teen", "dense", "vertex_error_mean[face]", "mm", 0.123, None, 1, 9, "quick", "r")
    write_results(empty / "table2.csv", [*table2_rows(), segment])
    write_curves(empty / "table2_curves.csv", {("teen", "dense"): CURVE})
    posed = flat + np.float32([0, 0, 3]) * np.sin(flat[:, 1:2] / 9)
    for choice, pose in (("folded", 5), ("median", 3), ("worst", 8)):
        vertices = {"truth": posed, "dense": flat}
        record = PoseRecord("teen", pose, flat, faces, vertices, choice=choice, ranked_by="dense")
        save_pose(pose_file(empty, "teen", choice), record)
    manifest = {
        "git": {"commit": "c0ffee", "clean": False},
        "profile": "quick",
        "seeds": [0],
        "stages": {"rig": {"wall_s": 90}},
    }
    (empty / "manifest.json").write_text(json.dumps(manifest))
    return empty


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_notebook_begins_with_its_title_ends_with_where_results_come_from_and_is_thin(path):
    first, code = json.loads(path.read_text())["cells"][0], cells(path, "code")
    assert first["cell_type"] == "markdown" and "".join(first["source"]).startswith("# ")
    assert code[0]["metadata"]["tags"] == ["parameters"]
    assert all(isinstance(node, ast.Assign) for node in ast.parse(code[0]["source"]).body)
    assert "provenance" in code[-1]["source"]
    for cell in code:
        kinds = [type(node) for node in ast.walk(ast.parse(cell["source"]))]
        assert ast.FunctionDef not in kinds and ast.ClassDef not in kinds
        assert "approximation" not in cell["source"] and len(cell["source"].splitlines()) < 15
    ids = [cell["id"] for cell in json.loads(path.read_text())["cells"]]
    assert len(set(ids)) == len(ids) and path.stat().st_size < 1_800_000


MOST_TABLES, MOST_IMPORTS, MOST_LINES = 12, 2, 12  # of a page, of a cell, and of text above the first result
GUIDES = ("own_rig",)  # these say how a thing is done, so that words come first


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_notebook_is_a_page_to_lecture_from(path):
    code = cells(path, "code")
    shown = [output.get("data", {}) for cell in code for output in cell["outputs"]]
    pages = "".join("".join(data.get("text/html", "")) for data in shown)
    assert pages.count("<table") <= MOST_TABLES, "a page has room for so many tables; set CHARACTER for others"
    assert not re.search(r"<t[dh][^>]*>\s*NaN", pages), "a number that is not there is a dash"
    for cell in code:
        imports = [line for line in cell["source"].splitlines() if re.match(r"(from \S+ )?import ", line)]
        assert len(imports) <= MOST_IMPORTS, f"cell {cell['id']} imports what cells below it use"
    assert not any("sys.path" in cell["source"] for cell in code), "the kernel finds the suite by itself"
    lines = [line for cell in cells(path, "markdown") for line in cell["source"].splitlines()]
    headings = [line for line in lines if line.startswith("#")]
    assert len(set(headings)) == len(headings), "a heading stands twice"


@pytest.mark.parametrize("path", [path for path in FILES if path.stem not in GUIDES], ids=lambda path: path.stem)
def test_a_notebook_shows_its_result_before_it_explains(path):
    above = 0
    for cell in json.loads(path.read_text())["cells"]:
        if cell["cell_type"] == "markdown":
            above += sum(bool(line.strip()) for line in cell["source"])
        elif any(kind in output.get("data", {}) for output in cell["outputs"] for kind in RESULT_KINDS):
            break
    assert above <= MOST_LINES, f"{above} lines of text stand above the first picture or table"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_what_a_notebook_imports_is_there(path):
    trees = [ast.parse(cell["source"].replace("%matplotlib", "# ")) for cell in cells(path, "code")]
    imports = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    missing = [
        f"{node.module}.{alias.name}"
        for node in imports
        for alias in node.names
        if not hasattr(import_module(node.module), alias.name) and not find_spec(f"{node.module}.{alias.name}")
    ]
    assert imports and not missing


def test_table2s_notebook_shows_the_results_of_a_folder(folder, monkeypatch):
    outputs = run_cells(TABLE2, monkeypatch)
    titles = [table.title for table in outputs if hasattr(table, "title")]
    assert titles == [
        "What the paper claims, on our characters",
        "Table 2: teen beside the paper's Hiccup",
        "Table 2 by segment: teen, mean errors",
        "Table 2 as ratios: teen beside Hiccup",
    ]
    first, *_ = (what for what in outputs if hasattr(what, "caption"))
    assert "(after Fig. 10)" in first.caption and outputs[0] is first, "a face comes first"
    captions = " ".join(words.caption for words in outputs if hasattr(words, "caption"))
    assert all(f"Test pose {pose} of teen" in captions for pose in (5, 3, 8)) and captions.count("Fig.") == 4


def test_studies_of_table2_show_a_chart_and_their_tables(monkeypatch):
    titles = {}
    for name in ("line", "layouts", "profiles", "clips", "training"):
        outputs = run_cells(notebooks.NOTEBOOKS / f"table2_{name}.ipynb", monkeypatch, "reference")
        assert name == "training" or hasattr(outputs[0], "caption"), "a chart comes first"
        titles[name] = [table.title for table in outputs if hasattr(table, "title")]
    assert titles["layouts"] == ["Two layouts of charts: teen"]
    assert titles["profiles"][:2] == ["Two profiles: teen", "Two profiles: toon"] and len(titles["line"]) >= 4
    assert titles["clips"][0] == "Two splits: teen"
    expected = [table.title for table in trainings_tables(read_results(paths.REFERENCE / "bench_training.csv"))]
    assert titles["training"] == expected


def in_manifest(folder: Path, target: str, characters: dict[str, dict]) -> None:
    """Add a target to the manifest of `folder`."""
    file = folder / "manifest.json"
    manifest = json.loads(file.read_text())
    manifest.setdefault("targets", {})[target] = {"profile": "quick", "characters": characters}
    file.write_text(json.dumps(manifest))


def run_cells(path: Path, monkeypatch, results: str = "quick") -> list:
    """Run a notebook's code on some results and return what it shows: tables, texts, files, words."""
    outputs = []
    for name in ("show_table", "show_text", "show_picture"):
        monkeypatch.setattr(notebooks, name, lambda what, **named: outputs.append(what))
    monkeypatch.setattr(notebooks, "show_tables", lambda tables: outputs.extend(filter(None, tables)))
    monkeypatch.setattr(notebooks, "show", lambda figure, words, *size, **named: outputs.append(words))
    first, *others = (cell["source"] for cell in cells(path, "code"))
    names = {}
    for source in (with_parameters(first, {"RESULTS": results}), *others):
        exec(source, names)
    return outputs


def test_table1s_notebook_shows_the_table_and_the_claim(folder, monkeypatch):
    write_results(folder / "table1.csv", table1_rows())
    in_manifest(folder, "table1", {"teen": {"run": "r", "stages": {"table1-teen": {"wall_s": 60}}}})
    table, chart, claim, full = run_cells(notebooks.NOTEBOOKS / "table1.ipynb", monkeypatch)
    assert table.title == full.title and len(table.body) < len(full.body)
    assert "grey band" in chart.caption and "✔ holds" in claim


@pytest.mark.parametrize(
    ("target", "header", "line"),
    [
        ("figure05", POSES_HEADER, "1,7,jaw_open,1.5,0.0,1.0"),
        ("figure07", SEGMENTS_HEADER, "face,deforms,81,128,2.5,#f3c300"),
        ("figure08", REFINEMENT_HEADER, "face_1,face,20,9,0.0,0.2,0.0,0.2,1.5,0.5,#f3c300"),
    ],
)
def test_a_figures_notebook_shows_the_pictures_that_the_manifest_names(folder, monkeypatch, target, header, line):
    (folder / f"{target}_teen.csv").write_text(f"{','.join(header)}\n{line}\n")
    (folder / f"{target}_teen.png").write_bytes(b"a picture")
    (folder / f"{target}_woman.png").write_bytes(b"one that no manifest names")
    in_manifest(folder, target, {"teen": {"run": "r", "files": [f"{target}_teen.csv", f"{target}_teen.png"]}})
    *heading, picture, table = run_cells(notebooks.NOTEBOOKS / f"{target}.ipynb", monkeypatch)
    assert all("teen" in text for text in heading)
    assert picture == folder / f"{target}_teen.png" and "teen" in table.title and len(table.body) == 1
    assert notebooks.figure_files("quick", "poser", needed=False) == {}
    (folder / f"{target}_teen.png").unlink()
    with pytest.raises(InputError, match=rf"{target}_teen.png: there is no such picture; `make {target}` draws it"):
        notebooks.figure_files("quick", target)


@pytest.mark.parametrize("target", ["figure01", "figure09", "figure10"])
def test_a_notebook_of_poses_shows_the_answer_the_picture_and_the_numbers_of_a_run(folder, monkeypatch, target):
    facts = (None, 1, 1, "quick", "r")
    means = {"refined": 1.5, "dense": 1.25, "lbs32": 2.5}
    rows = [Row(target, "toon", name, "normal_error_mean[folded]", "deg", mean, *facts) for name, mean in means.items()]
    rows.append(Row(target, "toon", "truth", "fold_change_mean[folded]", "deg", 4.0, *facts))
    write_results(folder / f"{target}.csv", rows)
    (folder / f"{target}_toon.png").write_bytes(b"a picture")
    in_manifest(folder, target, {"toon": {"run": "r", "files": [f"{target}_toon.png"]}})
    answer, picture, table = run_cells(notebooks.NOTEBOOKS / f"{target}.ipynb", monkeypatch)
    assert "“Refined” has smaller normal errors than" in answer and "1.50°" in answer
    assert picture == folder / f"{target}_toon.png" and cells_after(as_text(table), "Refined") == ["1.50"]


def test_the_rig_reports_notebook_shows_tables_pictures_and_pairs(folder, monkeypatch):
    write_results(folder / "rig_report.csv", rig_report_rows())
    (folder / "rig_report_teen.png").write_bytes(b"a picture")
    write_pairs(folder / "rig_report_teen_pairs.csv", [("jaw", "smile", "face", "default", 1.5, 9.0, 3.0)])
    in_manifest(folder, "rig_report", {"teen": {"run": "r", "files": ["rig_report_teen.png"]}})
    card, picture, shares, errors, pairs, maps, table = run_cells(notebooks.NOTEBOOKS / "rig_report.ipynb", monkeypatch)
    text = as_text(table)
    assert card.body[0][0] == "teen" and "teen" in shares.alt and "teen" in maps.alt
    assert cells_after(text, "a mean normal error of 0.5°") == ["154"] and cells_after(text, "of 0.25°") == [">", "512"]
    assert picture.name == "rig_report_teen.png" and "teen" in errors.title
    assert pairs.body == (("jaw × smile", "face", "default", "1.50", "9.00", "3.00"),)


def test_table2s_notebook_shows_simple_fits_beside_where_there_are_some(folder, monkeypatch):
    write_results(folder / "rig_report.csv", rig_report_rows())
    tables = [table for table in run_cells(TABLE2, monkeypatch) if hasattr(table, "title")]
    (table,) = (table for table in tables if "simple fits" in table.title)
    assert table.body[-1] == ("PCA basis of these regressions", "0.000", "0.00")


def test_numbers_of_a_variant_are_shown_without_its_meshes(folder):
    rows = read_results(folder / "table2.csv")
    write_results(folder / "table2.csv", [*rows, *(replace(row, character="teen@fine") for row in rows)])
    results = open_table2(folder)
    assert results.characters == ("teen", "teen@fine") and set(results.poses) == {"teen"}


def test_the_claims_notebook_shows_every_claim_with_its_reasons(folder, monkeypatch):
    write_results(folder / "table1.csv", table1_rows())
    write_claims(folder, gather([folder]))
    monkeypatch.setattr(paths, "REFERENCE", folder)
    outputs = run_cells(notebooks.NOTEBOOKS / "claims.ipynb", monkeypatch)
    glance, by_character, own = (table for table in outputs if isinstance(table, Table))
    for table in (glance, by_character):
        assert [line[0].partition(" ")[0] for line in table.body] == [claim.name for claim in CLAIMS]
    rule, *verdicts = [text for text in outputs if isinstance(text, str)]
    assert "95 % interval" in rule
    assert [text.partition(",")[0] for text in verdicts] == [f"**{claim.name}" for claim in CLAIMS]
    assert own.body[0][1] == "not tested" and "no normal_error_mean of linear" in own.body[0][2]
    captions = [words.caption for words in outputs if hasattr(words, "caption")]
    assert len(captions) == 10, "neither the paper nor these results have numbers on C5, C11 to C13 and C15"


@pytest.mark.parametrize(
    "target",
    [
        *"claims table1 table3 table4 rig_report bench_released".split(),
        *(f"figure{k}" for k in "01 05 07 08 09 10 11 12 13".split()),
    ],
)
def test_a_notebook_without_its_results_names_the_target_that_makes_them(folder, monkeypatch, target):
    with pytest.raises(InputError, match=f"`make {target.replace('_', '-')}`"):
        run_cells(notebooks.NOTEBOOKS / f"{target}.ipynb", monkeypatch)


def test_where_a_cell_finds_no_results_the_command_line_says_one_sentence(empty, capsys):
    assert main(["table1", "quick"]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1 and "`make table1`" in errors and not list(empty.iterdir())


def test_a_notebook_is_stale_when_its_own_results_change_and_not_when_others_do(folder, monkeypatch):
    write_results(folder / "table1.csv", table1_rows())
    in_manifest(folder, "table1", {"teen": {"run": "r"}})
    monkeypatch.setattr(notebooks, "execute", lambda source, out, parameters, stamp: out.write_text(stamp))
    notebooks.run_notebook("table1", "quick")
    in_manifest(folder, "figure07", {"teen": {"run": "r"}})
    (folder / "figure07_teen.csv").write_text("another's")
    write_results(folder / "table2.csv", table2_rows(("tiny",)))
    assert notebooks.is_current("table1", "quick")
    in_manifest(folder, "table1", {"teen": {"run": "s"}})
    assert not notebooks.is_current("table1", "quick")
    notebooks.run_notebook("table1", "quick")
    write_results(folder / "table1.csv", table1_rows(large=30.0))
    assert not notebooks.is_current("table1", "quick")


def test_figures_of_a_folder_have_names_of_their_own(folder):
    names = [name for name, _, _ in table2_figures(open_table2(folder), "teen", 10.0)]
    assert len(set(names)) == 6 and all("teen" in name for name in names)
    assert tuple(names) == table2_figure_names(open_table2(folder), "teen")


def test_results_of_one_pose_alone_are_shown(folder):
    for choice in ("median", "worst"):
        pose_file(folder, "teen", choice).unlink()
    names = table2_figure_names(open_table2(folder), "teen")
    assert [name for name in names if "figure10" in name] == ["figure10_teen"]


def test_a_result_that_is_missing_is_named_with_the_target_that_makes_it(folder):
    pose_file(folder, "teen").unlink()
    with pytest.raises(InputError, match=r"table2_teen_pose.npz: there is no such pose; `make table2`"):
        open_table2(folder)


def test_balance_is_told_of_the_characters_whose_manifest_has_it(folder, monkeypatch):
    assert balance_text("quick") == "", "this manifest has no characters"
    stages = {"samples-teen": {"notes": {"samples_per_bin": [1, 3, 0, 96]}}}
    each = {"teen": {"stages": stages}, "tiny": {"stages": {"samples-tiny": {"wall_s": 1}}}, "woman": {}}
    (folder / "manifest.json").write_text(json.dumps({"characters": each}))
    assert balance_text("quick") == f"teen: {draws_text([1, 3, 0, 96])}"


def test_parameters_replace_values_and_keep_comments():
    source = 'RESULTS = "reference"  # or another\nLIMIT = 10.0'
    assert with_parameters(source, {"RESULTS": "quick"}) == 'RESULTS = "quick"  # or another\nLIMIT = 10.0'
    with pytest.raises(InputError, match="to assign SEED once, got 0 times"):
        with_parameters(source, {"SEED": 1})


def test_a_notebook_is_executed_to_the_same_bytes_each_time(tmp_path, capsys):
    import nbformat

    new = nbformat.v4
    source = new.new_notebook(
        cells=[
            new.new_code_cell("WORD = 'a'", id="parameters", metadata={"tags": ["parameters"]}),
            new.new_markdown_cell("text", id="text"),
            new.new_code_cell(
                "import sys\nprint(WORD, flush=True)\nprint(2, file=sys.stderr)\nprint(3)\nWORD * 2", id="body"
            ),
            new.new_code_cell("import ipywidgets\n\nipywidgets.IntSlider()", id="widget"),
        ]
    )
    (tmp_path / "source.ipynb").write_text(nbformat.writes(source))
    for name in ("a.ipynb", "b.ipynb"):
        execute(tmp_path / "source.ipynb", tmp_path / name, {"WORD": "b"})
    assert (tmp_path / "a.ipynb").read_bytes() == (tmp_path / "b.ipynb").read_bytes()
    page = json.loads((tmp_path / "a.ipynb").read_text())
    streams = [output for output in page["cells"][2]["outputs"] if output["output_type"] == "stream"]
    assert ["".join(output["text"]) for output in streams] == ["b\n3\n"]
    assert page["cells"][3]["outputs"] == [], "a widget shows nothing without a kernel"
    assert "".join(page["cells"][2]["outputs"][-1]["data"]["text/plain"]) == "'bb'"
    assert "execution" not in page["cells"][2]["metadata"] and "version" not in page["metadata"]["language_info"]
    assert "2" in capsys.readouterr().err


def test_an_unknown_notebook_or_run_gets_one_sentence(capsys):
    assert main(["table9", "reference"]) == 2
    assert "there is no such notebook; there are" in capsys.readouterr().err
    assert main(["table2", "no-such-profile"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
