"""The course: notebooks equal their sources, solutions run, students' versions stop at the first exercise."""

import json
import os
import re
import subprocess
import sys

import nbformat
import pytest
from docutils.utils.math.latex2mathml import tex2mathml
from lesson_source import builder
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT

build = builder()
LESSONS = [source.stem for source in build.SOURCES]
LARGEST = 600_000  # bytes of a notebook
DRAFT = """
from replicate.drawing import light, render
render.SUPERSAMPLING = 1
render.trace = lambda *scene: light.trace(*scene[:-1], light.quick(scene[-1]))
"""  # pictures that nobody sees are drawn in a sixth of the time


def bare(notebook):
    """Return the cells of a notebook without what executing it adds."""
    return [
        (cell.cell_type, cell.source, json.dumps(cell.metadata, sort_keys=True), cell.id) for cell in notebook.cells
    ]


def committed(folder, lesson):
    return nbformat.read(folder / f"{lesson}.ipynb", as_version=4)


def source_of(lesson):
    return build.COURSE / "lessons" / f"{lesson}.py"


@pytest.mark.parametrize("lesson", LESSONS)
def test_both_notebooks_are_what_the_source_makes(lesson):
    made = build.read_lesson(source_of(lesson))
    assert bare(committed(build.SOLUTIONS, lesson)) == bare(made)
    assert bare(committed(build.STUDENT, lesson)) == bare(build.without_solutions(made))


@pytest.mark.parametrize("lesson", LESSONS)
def test_a_student_gets_expected_pictures_and_no_solution(lesson):
    solved, student = committed(build.SOLUTIONS, lesson), committed(build.STUDENT, lesson)
    for ours, theirs in zip(solved.cells, student.cells, strict=True):
        if ours.cell_type == "code":
            given = build.kind(ours) == "given"
            assert theirs.outputs == (ours.outputs if given else [])
            assert ours.execution_count is not None
        if build.kind(ours) == "exercise":
            assert "BEGIN SOLUTION" in ours.source and "raise NotImplementedError" in theirs.source
            assert "SOLUTION" not in theirs.source
    for folder in (build.SOLUTIONS, build.STUDENT):
        assert (folder / f"{lesson}.ipynb").stat().st_size < LARGEST
    assert any("image/png" in out.data or "image/jpeg" in out.data for out in results(student))


def results(notebook):
    return [out for cell in notebook.cells if cell.cell_type == "code" for out in cell.outputs if "data" in out]


@pytest.mark.parametrize("lesson", LESSONS)
def test_a_lesson_has_goals_minutes_exercises_a_question_and_papers(lesson):
    cells = build.read_lesson(source_of(lesson)).cells
    text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    kinds = [build.kind(cell) for cell in cells]
    assert cells[0].source.startswith(f"# Lesson {lesson[6]}: ") and " minutes" in cells[0].source
    assert 2 <= kinds.count("exercise") <= 4 and kinds.count("check") == kinds.count("exercise")
    for words in ("You need", "Afterwards you can", "**Think.**", "<summary>Answer</summary>", "## Go further"):
        assert words in text, words
    names = [cell.metadata.nbgrader.grade_id for cell in cells if "nbgrader" in cell.metadata]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("lesson", LESSONS)
def test_the_site_can_set_the_formulas(lesson):
    texts = [cell.source for cell in build.read_lesson(source_of(lesson)).cells if cell.cell_type == "markdown"]
    text = re.sub(r"```.*?```", "", "\n\n".join(texts), flags=re.DOTALL)
    formulas = re.findall(r"\$\$(.+?)\$\$|(?<!\$)\$([^$]+)\$", text, re.DOTALL)
    assert formulas and all(tex2mathml(block or inline, as_block=bool(block)) for block, inline in formulas)
    for formula in map("".join, formulas):
        assert not re.search(r"frac\d\d", formula), f"{formula}: it reads 12 as one number, so write {{1}}{{2}}"
        accent = re.search(r"\\(bar|dot|hat|overline|tilde)(\{[^{}]*\}| ?\w)_", formula)
        assert not accent, f"{formula}: it sets the index below the letter, so write {{}}_"


@pytest.mark.parametrize("lesson", LESSONS)
def test_a_student_stops_at_the_first_exercise_and_a_solution_runs_to_the_end(lesson):
    """Both in one kernel: it has all of the lesson's solution once it has gone back to the first exercise."""
    solution = build.read_lesson(source_of(lesson))
    student = build.without_solutions(solution)
    first = next(k for k, cell in enumerate(student.cells) if build.kind(cell) == "check")
    exercise = max(k for k in range(first) if build.kind(student.cells[k]) == "exercise")
    client = NotebookClient(student, timeout=300, resources={"metadata": {"path": str(ROOT / "notebooks")}})
    places = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    with client.setup_kernel(env=os.environ | {"PYTHONPATH": places}):
        client.execute_cell(nbformat.v4.new_code_cell(DRAFT), 0)
        for k, cell in enumerate(student.cells[:first]):
            client.execute_cell(cell, k)
        with pytest.raises(CellExecutionError) as stop:
            client.execute_cell(student.cells[first], first)
        assert stop.value.ename == "NotImplementedError"
        for k, cell in enumerate(solution.cells[exercise:], exercise):
            client.execute_cell(cell, k)


def test_nbgrader_makes_a_release_with_pictures_and_without_solutions(tmp_path):
    assert build.main(["--release", str(tmp_path / "out")]) == 0
    for lesson in LESSONS:
        ours = nbformat.read(tmp_path / "out" / "source" / lesson[:7] / f"{lesson}.ipynb", as_version=4)
        assert bare(ours) == bare(build.read_lesson(source_of(lesson)))
    assert not (tmp_path / "out" / "release").exists()
    page = (build.COURSE / "LECTURERS.md").read_text(encoding="utf-8")
    words = re.search(r"^nbgrader (generate_assignment lesson1)\b", page, re.MULTILINE)[1].split()
    program = [sys.executable, "-m", "nbgrader", *words]
    path = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])  # as activated: it calls alembic
    done = subprocess.run(
        program, cwd=tmp_path / "out", capture_output=True, text=True, timeout=600, env=os.environ | {"PATH": path}
    )
    assert done.returncode == 0, done.stderr
    theirs = nbformat.read(tmp_path / "out" / "release" / "lesson1" / f"{LESSONS[0]}.ipynb", as_version=4)
    student = committed(build.STUDENT, LESSONS[0])
    assert [cell.source for cell in theirs.cells] == [cell.source for cell in student.cells]
    assert results(theirs) == results(student) != []
    marked = [cell for cell in theirs.cells if "nbgrader" in cell.metadata]
    assert marked and all(cell.metadata.nbgrader.checksum for cell in marked)


def test_a_cell_that_has_changed_since_shows_no_old_output():
    executed = committed(build.SOLUTIONS, LESSONS[0])
    place = next(k for k, cell in enumerate(executed.cells) if build.kind(cell) == "given" and cell.get("outputs"))
    lesson = build.read_lesson(source_of(LESSONS[0]))
    lesson.cells[place].source += "  # changed"
    assert not build.with_given_outputs(lesson, executed).cells[place].outputs
    assert results(lesson)


def test_the_lecturers_page_has_the_points_of_each_lesson():
    page = (build.COURSE / "LECTURERS.md").read_text(encoding="utf-8")
    told = {int(lesson): int(points) for lesson, points in re.findall(r"^\| (\d) [^|]+\| (\d+) \|", page, re.MULTILINE)}
    marks = {
        int(lesson[6]): [cell.metadata.get("nbgrader", {}) for cell in committed(build.STUDENT, lesson).cells]
        for lesson in LESSONS
    }
    assert told == {lesson: sum(mark.get("points", 0) for mark in cells) for lesson, cells in marks.items()}
    assert f"{sum(told.values())} points in all" in page


def test_the_copy_for_students_has_no_answers():
    page = (build.COURSE / "LECTURERS.md").read_text(encoding="utf-8")
    left_out = [ROOT / folder for folder in re.findall(r"':!(\S+)'", page)]
    assert all(folder.is_dir() for folder in left_out)
    for file in (*build.COURSE.rglob("*.ipynb"), *build.COURSE.rglob("*.md"), *build.COURSE.rglob("lesson*.py")):
        if not any(file.is_relative_to(folder) for folder in left_out):
            text = file.read_text(encoding="utf-8")
            assert file.name == "LECTURERS.md" or not re.search(r"BEGIN SOLUTION|\*\*Exam", text), file


def test_a_release_overwrites_nothing(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="expected an empty or a new folder"):
        build.release(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_an_unknown_lesson_is_told(capsys):
    assert build.main(["--lessons", "9"]) == 2
    assert "got '9'" in capsys.readouterr().err
