"""The examples: the one page that trains a character runs from anywhere, and beats the neutral pose."""

import ast
import re
import subprocess
import sys

import pytest
from PIL import Image

from replicate.base.paths import ROOT

TRAIN_ONE = ROOT / "examples" / "train_one.py"


def run(folder, *words):
    return subprocess.run([sys.executable, TRAIN_ONE, *words], cwd=folder, capture_output=True, text=True)


def test_training_one_character_prints_its_errors_and_draws_them(tmp_path):
    process = run(tmp_path, "tiny", "--steps", "60", "--out", "picture.png")
    assert process.returncode == 0, process.stderr
    names, row = process.stdout.splitlines()
    assert names.split() == ["CNN", "linear", "neutral"] and row.startswith("tiny ")
    cnn, linear, neutral = (tuple(map(float, pair)) for pair in re.findall(r"([\d.]+) mm +([\d.]+)°", row))
    assert 0 < cnn[0] < neutral[0] and 0 < linear[0] < neutral[0]
    assert re.search("training .* for 60 steps", process.stderr)
    with Image.open(tmp_path / "picture.png") as picture:
        assert picture.width > 2 * picture.height
    assert [file.name for file in tmp_path.iterdir()] == ["picture.png"]


@pytest.mark.parametrize(
    ("words", "message"), [(["nobody"], "there is no character"), (["tiny", "--steps", "0"], "steps")]
)
def test_bad_words_end_it_before_anything_is_built(tmp_path, words, message):
    process = run(tmp_path, *words)
    assert process.returncode == 2 and message in process.stderr and "Traceback" not in process.stderr


@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.py")), ids=lambda file: file.name)
def test_an_example_is_one_short_page_that_parses_and_says_how_it_is_run(example):
    text = example.read_text("utf-8")
    assert f"python {example.name}" in ast.get_docstring(ast.parse(text)).replace("examples/", "")
    assert len(text.splitlines()) <= 110
