"""The course's project: a method gets a row, and none that has seen test poses or the rig."""

import re
import subprocess
import sys

import numpy as np
import pytest
import rigs

from course.project import leaderboard
from replicate.base.command_line import guard
from replicate.base.paths import ROOT
from replicate.config import resolve
from replicate.engine.stage import in_order
from replicate.methods.method_registry import VARIABLE, method_named

PROJECT = ROOT / "course" / "project"
NEAREST = (PROJECT / "nearest.py").read_text(encoding="utf-8")
METHOD = """
import numpy as np

from replicate.methods import artefacts
from replicate.methods.method import Method


def stages(plan):
    return (artefacts.samples_stage(plan),)


def load(inputs, settings):
    neutral = artefacts.load_mesh(inputs).neutral
    params, offsets = np.zeros((1, 49)), np.zeros((1, *neutral.shape))
    return lambda wanted: neutral + offsets[[np.square(params - pose).sum(1).argmin() for pose in wanted]]


METHOD = Method("mine", "Mine", stages, load)
"""
NOTHING = "params, offsets = np.zeros((1, 49)), np.zeros((1, *neutral.shape))"
BY_OTHER_NAMES = (
    "samples = artefacts.load_samples(inputs)\n"
    "    params, offsets = (np.array(getattr(samples, 'test' + name)) for name in ('_params', '_offsets'))"
)
BY_FILES = "params, offsets = (np.load(inputs['samples'] / f'test_{name}.npy') for name in ('params', 'offsets'))"
THE_RIG = "return getattr(artefacts, 'rig' + '_of')('tiny')"
ANOTHER_GRAPH = (
    "    from replicate.methods.plan import Plan\n"
    "    return (plan.stage('mine', load, None, artefacts.samples_stage(Plan(plan.config))),)"
)
CAREFUL = (
    "assert not [name for name in inputs if 'hidden' in name] and not (inputs['rig'] / 'rig').exists()\n    " + NOTHING
)


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """A folder with a cache for all tests, and the leaderboard of the three given methods as it is measured here."""
    folder = tmp_path_factory.mktemp("project")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REPLICATE_CACHE", str(folder / "cache"))
        rigs.put_into(folder / "cache")
        patch.setenv(VARIABLE, "")
        patch.setattr(sys, "path", list(sys.path))
        for method in ("neutral", "linear", written(folder, "project_nearest", NEAREST)):
            leaderboard.main([str(method), "--name", leaderboard.GIVEN, "--to", str(folder / "board.csv")])
        yield folder


def written(folder, name, text=METHOD, *changes):
    """Write a method's file into a folder of its own, with (old, new) pairs changed."""
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    (folder / name).mkdir(exist_ok=True)
    file = folder / name / f"{name}.py"
    file.write_text(text, encoding="utf-8")
    return file


def refused(capsys, *arguments):
    """Return the one sentence that the program ends with for bad input."""
    capsys.readouterr()
    assert guard(lambda: leaderboard.main([str(word) for word in arguments])) == 2
    *progress, said = capsys.readouterr().err.splitlines()
    assert all(re.fullmatch(r"[\w-]+: .*|.* under way.*", line) for line in progress)
    return said


def test_the_starting_point_is_the_text_of_reproducing():
    text = (ROOT / "REPRODUCING.md").read_text(encoding="utf-8")
    assert re.search(r"<!-- nearest\.py -->\n```python\n(.*?)```", text, re.DOTALL)[1] == NEAREST


def test_the_page_for_students_says_what_the_program_checks():
    text = (PROJECT / "README.md").read_text(encoding="utf-8")
    for number in (
        f"**{leaderboard.MOST_LINES} lines",
        f"below {leaderboard.LEAST_RATIO}",
        f"{leaderboard.EXACT_DEG}°",
    ):
        assert number in text
    assert f"needs {leaderboard.check_source(PROJECT / 'nearest.py')}" in text


def test_given_methods_have_their_rows_the_line_first_and_no_movement_last(board):
    rows = leaderboard.read_rows(board / "board.csv")
    assert [row.method for row in rows] == ["linear", "nearest", "neutral"]
    assert [row.lines for row in rows] == [None, 17, None]
    assert rows[0].size_mb > 0 and rows[1].size_mb > 10 and rows[2].size_mb is None
    assert rows[0].vertex_error_mm < rows[1].vertex_error_mm < rows[2].vertex_error_mm


def test_the_committed_rows_are_what_is_measured(board):
    committed = {row.method: row for row in leaderboard.read_rows(leaderboard.LEADERBOARD)}
    for row in leaderboard.read_rows(board / "board.csv"):
        ours = committed[row.method]
        assert (ours.name, ours.seed, ours.lines) == (leaderboard.GIVEN, 0, row.lines)
        assert ours.normal_error_deg == pytest.approx(row.normal_error_deg, rel=0.02)
        assert ours.vertex_error_mm == pytest.approx(row.vertex_error_mm, rel=0.02)


def test_a_students_row_is_put_beside_the_given_ones_and_replaced(board, capsys):
    file, to = written(board, "project_careful", METHOD, (NOTHING, CAREFUL)), board / "ada.csv"
    for _ in range(2):
        leaderboard.main([str(file), "--name", "Ada  Lovelace", "--to", str(to)])
    rows = leaderboard.read_rows(to)
    assert sorted((row.name, row.method) for row in rows) == [
        ("Ada Lovelace", "mine"),
        *((leaderboard.GIVEN, name) for name in ("linear", "nearest", "neutral")),
    ]
    mine, still = (next(row for row in rows if row.method == name) for name in ("mine", "neutral"))
    assert mine.normal_error_deg == still.normal_error_deg
    assert "Ada Lovelace  mine" in capsys.readouterr().out


def test_a_method_without_a_size_is_warned_of(board, capsys):
    file = written(board, "project_renamed", NEAREST, ('Method("nearest"', 'Method("mine"'))
    leaderboard.main([str(file), "--name", "Ada", "--to", str(board / "renamed.csv")])
    assert "mine: it has no size; call context.note(size_mb=…) in a stage" in capsys.readouterr().err
    changes = [(f'"nearest"{end}', f'"mine"{end}') for end in (", tabulate", "] /", ', "Nearest')]
    file = written(board, "project_whole", NEAREST, *changes)
    leaderboard.main([str(file), "--name", "Ada", "--to", str(board / "whole.csv")])
    assert "it has no size" not in capsys.readouterr().err
    assert next(row for row in leaderboard.read_rows(board / "whole.csv") if row.method == "mine").size_mb > 10


def test_predictions_of_another_shape_are_told_in_a_sentence(board, capfd):
    change = ("return lambda wanted: neutral + offsets[", "return lambda wanted: neutral[None, :5] + offsets[:, :5][")
    file = written(board, "project_shape", METHOD, change)
    words = [str(file), "--name", "Ada", "--to", str(board / "shape.csv")]
    assert guard(lambda: leaderboard.main(words)) == 1
    assert re.search(r"method mine: expected vertices \(\d+, 918, 3\), .* got ndarray", capfd.readouterr().err)


def test_decoys_and_hidden_poses_are_halves_of_the_unique_test_poses():
    params = np.repeat(np.arange(9.0), 2)[:, None]
    decoys, hidden = leaderboard.halves(params, 0)
    assert sorted([*decoys, *hidden]) == list(range(0, 18, 2)) and abs(len(decoys) - len(hidden)) == 1
    assert list(leaderboard.halves(params, 1)[0]) != list(decoys)


def test_what_a_method_gets_reaches_neither_hidden_poses_nor_the_rig():
    plan = leaderboard.OpenPlan(resolve("tiny", "quick"))
    closed = {stage.identifier for stage in plan.closed}
    inputs = leaderboard.score_stage(plan, method_named("linear")).inputs
    assert [stage.name for stage in inputs if stage.identifier in closed] == ["hidden"]
    linear = next(stage for stage in in_order([*inputs]) if stage.name == "linear")
    assert closed.isdisjoint(stage.identifier for stage in linear.inputs)


@pytest.mark.parametrize("way", [BY_OTHER_NAMES, BY_FILES])
def test_a_method_that_knows_the_test_poses_by_heart_is_refused(board, capsys, way):
    file = written(board, f"project_heart_{len(way)}", METHOD, (NOTHING, way))
    said = refused(capsys, file, "--name", "Eve", "--to", board / "board.csv")
    assert re.search(r"is 0\.\d\d° on the test poses that it could read, and 1\.\d\d° on hidden ones", said)
    assert "Eve" not in (board / "board.csv").read_text()


def test_a_method_that_is_the_rig_is_refused(board, capsys):
    file = written(board, "project_rig", METHOD, (NOTHING, THE_RIG))
    said = refused(capsys, file, "--name", "Eve", "--to", board / "board.csv")
    assert "as only the rig's can be" in said


def test_a_stage_that_builds_another_graph_to_read_all_poses_is_refused(board, capsys):
    file = written(board, "project_graph", METHOD, ("    return (artefacts.samples_stage(plan),)", ANOTHER_GRAPH))
    assert "its stage mine reads what methods must not" in refused(capsys, file, "--name", "Eve")


def test_an_oracle_is_refused(capsys, board):
    assert "it is an oracle" in refused(capsys, "attachment", "--name", "Eve")


@pytest.mark.parametrize(
    "line",
    [
        "x = samples.test_params",
        "x = [poses.test_offsets for poses in y]",
        "x = load_rig(inputs)",
        "from replicate.methods.artefacts import rig_of as innocent",
        "import data_recipes.catalogue",
        "from data_recipes import catalogue",
        "x = catalogue.build_rig('tiny')",
    ],
)
def test_a_source_that_names_test_poses_or_the_rig_is_refused_beforehand(tmp_path, capsys, line):
    file = written(tmp_path, "project_names", f'"""No test_params, no load_rig."""\n# no rig_of either\n{line}\n')
    said = refused(capsys, file, "--name", "Eve")
    assert f"{file}, line 3: it names " in said and said.count(", but ") == 1


def test_words_and_comments_may_name_what_code_must_not(tmp_path):
    text = '"""test_params"""\n\n\nx = (\n    "load_rig",\n    2,\n)  # rig_of\ny = 1; z = 2\n'
    assert leaderboard.check_source(written(tmp_path, "project_words", text)) == 3


def test_a_file_of_31_lines_or_two_files_are_refused(tmp_path, capsys):
    long = written(tmp_path, "project_long", "x = 1\n" * 31)
    assert "expected at most 30 lines of code, got 31" in refused(capsys, long, "--name", "Eve")
    two = written(tmp_path, "project_two", "import other\n")
    two.with_name("other.py").write_text("")
    assert "line 1: it imports other.py, but a method is one file" in refused(capsys, two, "--name", "Eve")


def test_what_is_no_method_is_told_in_a_sentence(tmp_path, board, capsys):
    empty, broken = written(tmp_path, "project_empty", ""), written(tmp_path, "project_broken", "def (:\n")
    for word, sentence in {
        tmp_path / "gone.py": "there is no such file",
        broken: "expected Python, got something else",
        empty: "it has no METHOD",
        "liner": "did you mean linear?",
        "lbs": "expected one method, got 3",
    }.items():
        assert sentence in refused(capsys, word, "--name", "Eve")


def test_bad_names_seeds_and_files_are_told_in_a_sentence(tmp_path, capsys):
    (tmp_path / "table.csv").write_text("name,points\nAda,3\n")
    cells = "Ada,mine,0,good,1,,1,9\n"
    (tmp_path / "cells.csv").write_text(",".join(column.name for column in leaderboard.COLUMNS) + "\n" + cells)
    for option, word, sentence in (
        ("--name", " ", "expected a name of at most 40 letters, got ' '"),
        ("--name", "x" * 41, "expected a name of at most 40 letters"),
        ("--seed", "-1", "--seed: expected a whole number from 0 to"),
        ("--to", tmp_path, "expected a regular file, got a folder"),
        ("--to", tmp_path / "gone" / "table.csv", "--to: there is no folder"),
        ("--to", tmp_path / "table.csv", "line 1: expected the header 'name,method,seed,"),
        ("--to", tmp_path / "cells.csv", "line 2: normal_error_deg: expected a finite number, got 'good'"),
    ):
        name = () if option == "--name" else ("--name", "Eve")
        assert sentence in refused(capsys, "neutral", *name, f"{option}={word}")


def test_the_leaderboard_is_never_left_half_written(tmp_path, monkeypatch, cache):
    file = tmp_path / "board.csv"
    row = leaderboard.Row("Ada", "mine", 0, 1.5, 2.5, None, 0.1, 20)
    leaderboard.put_row(file, row)
    before = file.read_bytes()

    def fail(*arguments, **options):
        raise OSError("a power cut")

    with monkeypatch.context() as patch:
        patch.setattr("os.replace", fail)
        patch.setattr("pathlib.Path.replace", fail)
        with pytest.raises(OSError, match="power cut"):
            leaderboard.put_row(file, leaderboard.Row("Eve", "mine", 0, 0.5, 0.5, None, 0.1, 20))
    assert file.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir() if each.name != "cache"] == ["board.csv"]
    assert leaderboard.put_row(file, row) == leaderboard.read_rows(file)


def test_the_program_runs_from_anywhere_and_explains_itself(tmp_path):
    program = [sys.executable, str(PROJECT / "leaderboard.py")]
    told, wrong = (
        subprocess.run([*program, *words], cwd=tmp_path, capture_output=True, text=True)
        for words in (["--help"], ["gone.py", "--name", "Ada"])
    )
    assert told.returncode == 0 and "--to FILE" in told.stdout
    assert (wrong.returncode, wrong.stderr) == (2, "gone.py: there is no such file\n")
