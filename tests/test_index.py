"""The indices of the paper's ideas and of ours: what they point to is there; of the paper's, it says what it is."""

import ast
import re

import pytest

import replicate
import replicate.regional
from replicate.base.paths import ROOT

LINE = re.compile(r"^(Fig\. \d+|Eq\. \d+|§[\d.]+|Table \d)  +\S.*?  +(\S+)$", re.MULTILINE)
ENTRIES = [(match[1], match[2]) for match in LINE.finditer(replicate.__doc__)]
NAMES = {"Fig.": r"Fig(?:\.|ure|s) ?(?:\d+ and )?", "Table": "Table ", "Eq.": "Eq\\. (?:\\d+ and )?", "§": "§"}


def docstrings(file):
    """Return all docstrings of a file, its module's first."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    return "\n".join(ast.get_docstring(node) or "" for node in ast.walk(tree) if isinstance(node, kinds))


def test_the_index_has_the_equations_tables_and_figures_that_the_suite_has():
    names = {name for name, _ in ENTRIES}
    assert {"Eq. 1", "Eq. 2", "Eq. 3", "Eq. 4", "Eq. 5", "Eq. 11", "Table 1", "Table 2"} <= names
    targets = {path.name for path in (ROOT / "replicate/targets").iterdir() if re.match(r"(table|figure)\d", path.name)}
    folders = {path.split("/")[1] for _, path in ENTRIES if path.startswith("targets/")}
    assert targets == folders


@pytest.mark.parametrize(("name", "path"), ENTRIES, ids=[f"{name} {path}" for name, path in ENTRIES])
def test_what_the_index_points_to_says_what_it_is(name, path):
    place = ROOT / "replicate" / path
    file = place / "__init__.py" if path.endswith("/") else place
    assert file.is_file(), f"{path} is not there"
    kind, number = re.match(r"(§|\D+)\s*([\d.]+)", name).groups()
    pattern = rf"{NAMES[kind.strip()]}0?{re.escape(number)}(?!\d)"
    assert re.search(pattern, docstrings(file)), f"no docstring of {path} names {name}"


IDEAS = re.findall(r"^\S.*?  +(\w+/\S+?)(?:: ([\w.]+))?$", replicate.regional.__doc__, re.MULTILINE)


@pytest.mark.parametrize(("path", "name"), IDEAS, ids=[f"{path} {name}" for path, name in IDEAS])
def test_an_idea_of_our_own_method_stands_where_its_index_says(path, name):
    file = ROOT / "replicate" / path
    assert file.is_file(), f"{path} is not there"
    found = ast.parse(file.read_text(encoding="utf-8")).body if name else []
    for part in filter(None, name.split(".")):
        kinds = (ast.ClassDef, ast.FunctionDef)
        (one,) = (node for node in found if isinstance(node, kinds) and node.name == part)
        found = one.body


def test_the_index_of_our_own_method_leaves_out_no_module_of_it():
    own = {f"regional/{file.name}" for file in (ROOT / "replicate/regional").glob("[a-z]*.py")}
    assert own <= {path for path, _ in IDEAS} and len(IDEAS) > 15
