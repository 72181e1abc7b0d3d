"""The list of mutants fits the sources that it changes, and its runner tells killed, surviving and stale ones apart."""

import ast
import shutil
import subprocess

import pytest
from mutants import main, mutated, read_list

from replicate.base.paths import ROOT

MUTANTS = read_list(ROOT)
TOY = {
    "toy.py": "def double(x):\n    return 2 * x\ndef half(x):\n    return x / 2\n",
    "tests/test_toy.py": "from toy import double\ndef test_double():\n    assert double(3) == 6\n",
    "pyproject.toml": '[tool.pytest.ini_options]\npythonpath = ["."]\n',
}


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: f"{mutant.file.rpartition('/')[2]}: {mutant.why}")
def test_a_mutants_line_is_there_once_and_its_change_is_one_of_the_code(mutant):
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    changed = mutated(mutant, text)
    assert changed is not None, f"{mutant.file} has {mutant.line!r} {text.count(mutant.line)} times"
    assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(text))
    assert mutant.tests and all((ROOT / test).is_file() for test in mutant.tests)
    assert mutant.why.endswith(".") and mutant.why.count("\n") == 0


def test_there_are_forty_mutants_at_least_and_no_two_are_one():
    assert len({(mutant.file, mutant.line, mutant.becomes) for mutant in MUTANTS}) == len(MUTANTS) >= 40


def toy_project(folder, *mutants, **files):
    """Make a project whose only function with a test is `double`."""
    if shutil.which("git") is None:
        pytest.skip("needs git")
    entry = '[[mutant]]\nfile = "toy.py"\nline = "{}"\nbecomes = "{}"\ntests = ["tests/test_toy.py"]\nwhy = "{}"\n'
    for name, text in {**TOY, **files, "tests/mutants.toml": "".join(entry.format(*each) for each in mutants)}.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    for command in (["init", "-q"], ["add", "."]):
        subprocess.run(["git", "-C", str(folder), *command], check=True)
    return folder


def test_killed_surviving_and_stale_mutants_are_told_apart(tmp_path, capsys):
    doubled, halved, gone = ("2 * x", "3 * x", "Two."), ("x / 2", "x / 3", "Half."), ("4 * x", "5 * x", "Gone.")
    root = toy_project(tmp_path, doubled, halved, gone)
    assert main(["--jobs", "2"], root) == 1
    output = capsys.readouterr().out
    for words in ("killed in ", "SURVIVED in ", "STALE: its line is not there: toy.py: Gone.", "1 of 3 mutants killed"):
        assert words in output
    assert (root / "toy.py").read_text() == TOY["toy.py"], "the working tree stays as it is"
    assert main(["--only", "two"], root) == 0 and "1 of 1 mutants killed" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2"):
        main(["--only", "nothing like that"], root)


def test_red_tests_prove_nothing(tmp_path, capsys):
    red = {"tests/test_toy.py": TOY["tests/test_toy.py"].replace("6", "7")}
    assert main([], toy_project(tmp_path, ("2 * x", "3 * x", "Two."), **red)) == 1
    output = capsys.readouterr().out
    assert "assert 6 == 7" in output and "red ones prove nothing" in output and "killed" not in output
