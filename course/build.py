"""Make the notebooks of the course from the lessons' sources: `make course`.

A source is a Python file in jupytext's percent format. `exercise="name"` behind a cell's `# %%` marks what students
write, and `check="name" points=2` the check; a solution stands between `### BEGIN SOLUTION` and `### END SOLUTION`.
course/solutions/ gets the whole lessons, executed. course/student/ gets them without solutions; outputs of given cells
stay there, as what is to be expected.
"""

import argparse
import copy
import sys
import tempfile
import time
from pathlib import Path

import jupytext
import nbformat
from nbformat import NotebookNode

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from replicate.base.command_line import guard
from replicate.base.exceptions import InputError
from replicate.report.notebooks import METADATA, execute

COURSE = ROOT / "course"
SOURCES = sorted((COURSE / "lessons").glob("lesson*.py"))
SOLUTIONS, STUDENT = COURSE / "solutions", COURSE / "student"
STUB = "# your code here\nraise NotImplementedError"
NBGRADER = {"grade": False, "locked": False, "schema_version": 3, "solution": False, "task": False}
CONFIG = f"""import os

from nbgrader.converters import GenerateAssignment
from nbgrader.preprocessors import ClearOutput

os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, ({{suite!r}}, os.environ.get("PYTHONPATH"))))  # has the checks
c = get_config()
c.CourseDirectory.course_id = "faces_that_move"
c.CourseDirectory.root = {{root!r}}
c.ClearSolutions.code_stub = {{{{"python": {STUB!r}}}}}
c.ExecutePreprocessor.timeout = 300
# students see what given cells put out; what they hand in is cleared before it runs, as ever
c.GenerateAssignment.preprocessors = [step for step in GenerateAssignment().preprocessors if step is not ClearOutput]
"""


def read_lesson(source: Path) -> NotebookNode:
    """Return a lesson with its solutions and without outputs, its exercises and checks marked for nbgrader."""
    notebook = jupytext.reads(source.read_text(encoding="utf-8"), fmt="py:percent")
    notebook.metadata = nbformat.from_dict(METADATA)
    for place, cell in enumerate(notebook.cells):
        marks, cell.metadata, cell.id = cell.metadata, NotebookNode(), f"cell-{place + 1}"
        name = marks.get("exercise") or marks.get("check")
        if name and "exercise" in marks:
            cell.metadata.nbgrader = NBGRADER | {"grade_id": name, "solution": True}
        elif name:
            points = {"points": int(marks.get("points", 1))}
            cell.metadata.nbgrader = NBGRADER | {"grade_id": f"check_{name}", "grade": True, "locked": True} | points
    return notebook


def kind(cell: NotebookNode) -> str:
    """Return what a cell is to students: an "exercise", a "check" or "given"."""
    marks = cell.metadata.get("nbgrader", {})
    return "exercise" if marks.get("solution") else "check" if marks.get("grade") else "given"


def without_solutions(notebook: NotebookNode) -> NotebookNode:
    """Return a lesson as students get it; what cells that are given have put out stays."""
    from nbgrader.preprocessors import ClearSolutions

    clear = ClearSolutions()
    clear.code_stub = {"python": STUB}
    student, _ = clear.preprocess(copy.deepcopy(notebook), {})
    for cell in student.cells:
        if kind(cell) != "given" and cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    return student


def with_given_outputs(notebook: NotebookNode, executed: NotebookNode) -> NotebookNode:
    """Return a lesson with what its given cells put out when it was executed, but for cells that have changed since."""
    for cell, there in zip(notebook.cells, executed.cells, strict=False):
        if cell.cell_type == "code" and kind(cell) == "given" and cell.source == there.source:
            cell.outputs, cell.execution_count = there.outputs, there.execution_count
    return notebook


def write(notebook: NotebookNode, file: Path) -> None:
    """Write a notebook, in the same bytes each time."""
    nbformat.validate(notebook)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(nbformat.writes(notebook, version=4).rstrip("\n") + "\n", encoding="utf-8")


def make(source: Path) -> float:
    """Execute a lesson and write both of its notebooks; return how many seconds it took."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / f"{source.stem}.ipynb"
        write(read_lesson(source), whole)
        execute(whole, whole, {})
        solved = nbformat.read(whole, as_version=4)
    write(solved, SOLUTIONS / whole.name)
    write(without_solutions(solved), STUDENT / whole.name)
    return time.monotonic() - began


def release(folder: Path) -> None:
    """Write a course for nbgrader: source/ with the solutions, and settings by which nbgrader makes release/ of it.

    Raises InputError if something is there already.
    """
    if folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder}: expected an empty or a new folder for the course, got one with files in it.")
    for source in SOURCES:
        file = f"{source.stem}.ipynb"
        notebook = with_given_outputs(read_lesson(source), nbformat.read(SOLUTIONS / file, as_version=4))
        write(notebook, folder / "source" / source.stem.partition("_")[0] / file)
    (folder / "nbgrader_config.py").write_text(
        CONFIG.format(root=str(folder.resolve()), suite=str(ROOT)), encoding="utf-8"
    )


def chosen(words: list[str]) -> list[Path]:
    """Return the sources of some lessons, "3" or "lesson3"; all if none is named. Raises InputError for others."""
    by_number = {source.stem.partition("_")[0].removeprefix("lesson"): source for source in SOURCES}
    words = " ".join(words).replace(",", " ").split()
    for word in words:
        if word.removeprefix("lesson") not in by_number:
            raise InputError(f"expected a lesson's number, {', '.join(by_number)}, got {word!r}.")
    return [by_number[word.removeprefix("lesson")] for word in words] or SOURCES


def main(arguments: list[str] | None = None) -> int:
    """Make the notebooks, or a course for nbgrader; return the exit code."""
    parser = argparse.ArgumentParser(prog="make course", description=__doc__.partition("\n")[0])
    parser.add_argument("--lessons", nargs="+", default=[], metavar="N", help="only these lessons, such as 3 4")
    parser.add_argument("--release", type=Path, metavar="PATH", help="write a course for nbgrader into this folder")
    words = parser.parse_args(arguments)

    def run() -> None:
        if words.release:
            release(words.release.expanduser())
            print(f"{words.release}: a course for nbgrader; course/LECTURERS.md says how to grade with it")
            return
        for source in chosen(words.lessons):
            print(f"{source.stem}: {make(source):.0f} s", flush=True)

    return guard(run)


if __name__ == "__main__":
    sys.exit(main())
