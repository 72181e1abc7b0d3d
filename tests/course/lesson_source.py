"""What a lesson's exercises are when they are solved, from its source."""

import ast
import importlib.util
import sys
from functools import cache

import pytest

from course.checks import Wrong
from replicate.base.paths import ROOT


def builder():
    """Return the module course/build.py."""
    if "course_build" not in sys.modules:
        spec = importlib.util.spec_from_file_location("course_build", ROOT / "course" / "build.py")
        sys.modules["course_build"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["course_build"])
    return sys.modules["course_build"]


@cache
def answers(lesson):
    """Return what the solved exercises of a lesson, "lesson3", define: name → function or value.

    Of the cells that are given, only lines that import are executed, and assignments of CAPITALS.
    """
    build = builder()
    (source,) = build.chosen([lesson])
    names = {}
    for cell in build.read_lesson(source).cells:
        if cell.cell_type != "code" or build.kind(cell) == "check":
            continue
        tree = ast.parse(cell.source)
        if build.kind(cell) == "given":
            tree.body = [node for node in tree.body if is_import(node) or is_constant(node)]
        exec(compile(tree, str(source), "exec"), names)
    return names


def is_import(node):
    return isinstance(node, ast.Import | ast.ImportFrom)


def is_constant(node):
    return isinstance(node, ast.Assign) and all(isinstance(t, ast.Name) and t.id.isupper() for t in node.targets)


def assert_told_as_not_begun(check, *given):
    """See that a check lets an exercise's own NotImplementedError pass, and says that None is no answer."""

    def begun(*arguments):
        raise NotImplementedError

    with pytest.raises(NotImplementedError):
        check(begun, *given)
    with pytest.raises(Wrong, match="returns None"):
        check(lambda *arguments: None, *given)
