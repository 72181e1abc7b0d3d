"""A notebook's kernel: it starts wherever temporary files lie, and one that is killed is told in a sentence."""

import subprocess
import sys

import nbformat
import pytest

from replicate.base.exceptions import RunError
from replicate.base.paths import ROOT
from replicate.report.notebooks import execute


def notebook(folder, *cells):
    """Write a notebook whose first cell assigns WORD, followed by some cells; return its file."""
    cells = [nbformat.v4.new_code_cell(source) for source in ("WORD = 'a'", *cells)]
    file = folder / "source.ipynb"
    file.write_text(nbformat.writes(nbformat.v4.new_notebook(cells=cells)))
    return file


def test_a_killed_kernel_is_a_sentence_and_leaves_nothing(tmp_path):
    source = notebook(tmp_path, "import os, signal", "os.kill(os.getpid(), signal.SIGKILL)")
    with pytest.raises(RunError, match=r"source\.ipynb: its kernel was killed") as error:
        execute(source, tmp_path / "out.ipynb", {"WORD": "b"})
    assert "\n" not in str(error.value)
    assert [file.name for file in tmp_path.iterdir()] == ["source.ipynb"]


def test_a_kernel_starts_where_the_path_of_temporary_files_is_too_long_for_a_socket(tmp_path, monkeypatch):
    long = tmp_path / ("t" * 115)
    long.mkdir()
    monkeypatch.setenv("TMPDIR", str(long))
    monkeypatch.setattr("tempfile.tempdir", None)
    execute(notebook(tmp_path, "print(WORD)"), tmp_path / "out.ipynb", {"WORD": "b"})
    assert nbformat.read(tmp_path / "out.ipynb", 4).cells[1].outputs[0].text == "b\n"


def test_no_grammar_of_addresses_is_built_for_a_notebook():
    code = (
        "import sys; from pathlib import Path; from replicate.report.notebooks import execute\n"
        "try: execute(Path('none.ipynb'), Path('out.ipynb'), {})\n"
        "except FileNotFoundError: print('jsonschema' in sys.modules, 'lark' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "True False\n"
