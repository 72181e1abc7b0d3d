"""Every public function says what it takes and what it returns, and tests hold it to that."""

import ast

import numpy as np
import pytest

from replicate.base.paths import ROOT
from replicate.geometry.mesh import face_normals
from replicate.report.tables import as_text

PUBLIC = ("__init__", "__call__")
SOURCES = sorted(path for package in ("replicate", "data_recipes") for path in (ROOT / package).rglob("*.py"))


def public_functions(body, of_a_class=False):
    """Yield (function, whether it is a method) of all that is public, with what makes and what calls an object."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node.body, True)
        elif isinstance(node, ast.FunctionDef) and (
            not node.name.startswith("_") or node.name in ("__init__", "__call__")
        ):
            yield node, of_a_class and "staticmethod" not in map(ast.unparse, node.decorator_list)


def missing_annotations(code):
    """Return "function: parameter" for each parameter, or "return", that has no annotation."""
    missing = []
    for function, method in public_functions(ast.parse(code).body):
        arguments = function.args
        parameters = [*arguments.posonlyargs, *arguments.args][method:] + arguments.kwonlyargs
        rest = [argument for argument in (arguments.vararg, arguments.kwarg) if argument]
        missing += [f"{function.name}: {a.arg}" for a in (*parameters, *rest) if a.annotation is None]
        if function.returns is None and function.name != "__init__":
            missing.append(f"{function.name}: return")
    return missing


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_public_functions_are_annotated(path):
    assert missing_annotations(path.read_text(encoding="utf-8")) == []


def test_what_lacks_an_annotation_is_noticed():
    code = """
def open_(a, *rest, b: int = 0): ...
def _hidden(a): ...
class Box:
    def __init__(self, size): ...
    def fill(self, share: float) -> None: ...
    @staticmethod
    def load(path) -> "Box": ...
"""
    assert missing_annotations(code) == ["open_: a", "open_: rest", "open_: return", "__init__: size", "load: path"]


def test_wrong_types_and_shapes_end_a_test():
    with pytest.raises(Exception, match="violates type hint"):
        as_text("a table")
    with pytest.raises(Exception, match="Type-check error"):
        face_normals(np.zeros((3, 2), np.float32), np.zeros((1, 3), np.int32))
