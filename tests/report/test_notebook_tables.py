"""What committed notebooks show, tables, texts and captions, is what their cells make of results/reference today.

The cells run in the tests' process, one notebook after the other. Nothing is drawn in pixels. Of a cell that is left
out the imports alone run, for the cells behind it.
"""

import ast
import contextlib
import io
import itertools
import json
import sys
from pathlib import Path
from unittest.mock import MagicMock

import IPython.display
import jaxtyping
import pytest

from replicate.report import notebooks

FILES = sorted(notebooks.NOTEBOOKS.glob("*.ipynb"))
PICTURES = {
    "bench_regional": ("figure",),
    "table2": ("table2-3", "table2-10", "table2-14", "table2-23"),
}  # no tables: they take most of a minute
NEED_A_CACHE = {  # cells that need a rig or trained networks, which no table of the reference results holds
    "figure11": ("open", "widget", "play"),
    "own_rig": tuple(f"own-rig-{k:02}" for k in (2, 5, 6, 8, 10, 13)),
    "rig_tour": (
        *("setup", "build-up", "layers", "layer-table", "folds", "strain"),
        *("panel", "panel-still", "derivative", "provenance"),
    ),
}


def left_out(notebook: Path) -> tuple[str, ...]:
    return PICTURES.get(notebook.stem, ()) + NEED_A_CACHE.get(notebook.stem, ())


def code_cells(notebook: Path) -> list[dict]:
    return [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]


def stored_texts(cell: dict) -> list[str]:
    """Return what a cell has shown: all that it printed, then each text and table."""
    printed = ["".join(output["text"]) for output in cell["outputs"] if output["output_type"] == "stream"]
    shown = []
    for output in cell["outputs"]:
        data = output.get("data", {})
        kinds = [kind for kind in ("text/markdown", "text/html") if kind in data] or ["text/plain"]
        if not {"image/png", "image/jpeg"} & data.keys():
            shown += ["".join(data[kind]) for kind in kinds if kind in data]
    return ["".join(printed), *shown]


def fresh_texts(source: str, names: dict, displayed: list[str]) -> list[str]:
    """Run a cell and return the same. names: of the notebook. displayed: where `display` puts its texts."""
    displayed.clear()
    body = ast.parse(source).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(ast.Module(body, []), "cell", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names) if last else None
    if value is not None:
        displayed.append(value._repr_html_() if hasattr(value, "_repr_html_") else repr(value))
    return [printed.getvalue(), *displayed]


def imports_of(source: str) -> str:
    nodes = ast.parse(source).body
    return "\n".join(ast.unparse(node) for node in nodes if isinstance(node, ast.Import | ast.ImportFrom))


def first_difference(stored: list[str], fresh: list[str]) -> str:
    pairs = itertools.zip_longest("\n".join(stored).splitlines(), "\n".join(fresh).splitlines(), fillvalue="nothing")
    return next((f"it shows\n  {old}\nand its cell makes\n  {new}\n" for old, new in pairs if old != new), "")


@pytest.fixture
def displayed(monkeypatch, tmp_path) -> list[str]:
    """The texts that cells display, in place of the screen; pictures are not drawn."""
    texts = []

    def display(*things: object, raw: bool = False) -> None:
        if raw:  # a table
            texts.extend(things[0][kind] for kind in ("text/markdown", "text/html"))
        else:
            texts.extend(thing.data for thing in things if isinstance(thing, IPython.display.Markdown))

    monkeypatch.setattr(IPython.display, "display", display)
    monkeypatch.setattr(notebooks, "png", lambda *arguments: b"a picture")
    for kind in ("DataFrame", "Series"):
        monkeypatch.setattr(f"pandas.{kind}.plot", MagicMock())
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # checks of millions of small calls take minutes
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.chdir(notebooks.NOTEBOOKS)
    for variable in ("REPLICATE_CACHE", "REPLICATE_RESULTS"):
        monkeypatch.setenv(variable, str(tmp_path / variable))
    return texts


@pytest.mark.parametrize("notebook", FILES, ids=lambda path: path.stem)
def test_a_notebook_shows_what_its_cells_make_of_the_reference(notebook, displayed):
    names = {"__name__": "__main__"}
    for cell in code_cells(notebook):
        source = "".join(cell["source"])
        if cell["id"] in left_out(notebook):
            exec(imports_of(source), names)
            continue
        stored, fresh = stored_texts(cell), fresh_texts(source, names, displayed)
        place = f"{notebook.name}, cell {cell['id']}: {first_difference(stored, fresh)}"
        assert stored == fresh, f"{place}`make reference` executes the notebooks again"


@pytest.mark.parametrize("notebook", FILES, ids=lambda path: path.stem)
def test_cells_that_are_left_out_exist_and_those_of_pictures_show_no_table(notebook):
    cells = {cell["id"]: cell for cell in code_cells(notebook)}
    assert set(left_out(notebook)) <= set(cells)
    for name in PICTURES.get(notebook.stem, ()):
        assert not any("| " in text for text in stored_texts(cells[name]))


def test_a_changed_number_is_found_in_its_line():
    assert first_difference(["", "a\n| 0.47 |\nb"], ["", "a\n| 0.48 |\nb"]).split("\n")[1::2] == [
        "  | 0.47 |",
        "  | 0.48 |",
    ]
    assert first_difference(["same"], ["same"]) == ""
