"""Imports run one way, and what needs a screen or a mesh library is loaded by nothing that doesn't."""

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter

import pytest

from replicate.base.paths import ROOT

SOURCES = sorted(path for folder in ("replicate", "data_recipes") for path in (ROOT / folder).rglob("*.py"))
DISPLAY_ONLY = {"pyvista", "trimesh", "vtk", "vtkmodules"}


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in SOURCES}


def imports(path, only_at_the_top=False):
    """Return the modules that a file imports; anywhere, or only those that importing it loads."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    package = module_name(path).split(".")[: None if path.name == "__init__.py" else -1]
    inside = {id(n) for f in ast.walk(tree) if isinstance(f, (ast.FunctionDef, ast.Lambda)) for n in ast.walk(f)}
    modules = set()
    for node in ast.walk(tree):
        if only_at_the_top and id(node) in inside:
            continue
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*base, *([node.module] if node.module else [])])
            submodules = {f"{base}.{alias.name}" for alias in node.names} & MODULES.keys()
            whole = {base} if len(submodules) < len(node.names) else set()
            modules |= submodules | whole
    return modules


def room(module):
    """Return the folder, or the single module, that a module belongs to at the first level below its package."""
    return ".".join(module.split(".")[:2])


def floors(graph):
    """Return each node's floor: one above the highest that it needs. Raises CycleError for a circle."""
    heights = {}
    for node in TopologicalSorter(graph).static_order():
        heights[node] = 1 + max((heights[dependency] for dependency in graph.get(node, ())), default=-1)
    return heights


def graph_of(name):
    """Return who imports whom; name: a module → its node. What a node imports of itself is left out."""
    graph = {}
    for module, path in MODULES.items():
        own = imports(path) & MODULES.keys()
        graph.setdefault(name(module), set()).update({name(other) for other in own} - {name(module)})
    return graph


def test_rooms_form_no_circle_and_each_has_a_floor():
    floor_of = floors(graph_of(room))
    assert floor_of["replicate.base"] == 0
    upwards = ("base", "engine", "methods", "report", "cli", "targets")
    heights = [floor_of[f"replicate.{name}"] for name in upwards]
    assert heights == sorted(heights) and len(set(heights)) == len(heights)


def test_modules_form_no_circle():
    floors(graph_of(lambda module: module))


def test_a_circle_is_noticed():
    with pytest.raises(CycleError):
        floors({"a": {"b"}, "b": {"a"}})


def test_recipes_see_the_ground_and_geometry_alone_and_are_seen_by_contract_and_catalogue():
    for module, path in MODULES.items():
        for dependency in imports(path):
            if module.startswith("data_recipes") and dependency.startswith("replicate"):
                assert room(dependency) in ("replicate.base", "replicate.geometry"), f"{module} imports {dependency}"
            if module.startswith("replicate") and dependency.startswith("data_recipes"):
                interface = ("data_recipes.rig", "data_recipes.catalogue", "data_recipes.recipe_paths")
                assert dependency in interface, f"{module} imports {dependency}"


def test_the_engine_knows_nothing_of_faces():
    for module, path in MODULES.items():
        if module.startswith("replicate.engine"):
            outside = {room(name) for name in imports(path) & MODULES.keys()} - {"replicate.engine", "replicate.base"}
            assert not outside, f"{module} imports {outside}"


def test_the_house_stays_small_enough_to_be_read():
    rooms = {module.split(".")[1] for module in MODULES if module.startswith("replicate.") and module.count(".") > 1}
    assert len(rooms) <= 22 and len(SOURCES) <= 400, "find the place that a new idea belongs to before another is built"


def test_a_target_has_three_modules_at_most():
    folders = [path.parent for path in SOURCES if path.parent.parent.name == "targets"]
    assert max(map(folders.count, folders)) <= 3


def test_only_what_draws_loads_what_draws():
    for path in SOURCES:
        packages = {name.split(".")[0] for name in imports(path, only_at_the_top=True)}
        assert not packages & DISPLAY_ONLY, f"{module_name(path)} loads {packages & DISPLAY_ONLY} when it is imported"


def test_everything_works_without_pyvista_and_trimesh_until_it_draws():
    modules = [name for name in sorted(MODULES) if name not in ("replicate.__main__", "replicate.engine.worker")]
    program = f"""
import importlib, sys
for name in {sorted(DISPLAY_ONLY)}:
    sys.modules[name] = None  # an import of it fails
for name in {modules}:
    importlib.import_module(name)
"""
    process = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr


def test_the_command_line_loads_nothing_heavy_to_see_that_nothing_is_to_be_done():
    heavy = "{'jax', 'torch', 'scipy', 'numba', 'pandas', 'matplotlib', 'pyvista', 'dask', 'distributed'}"
    program = (
        "import sys, replicate.__main__, replicate.engine.scheduler, replicate.engine.cache_report\n"
        "from replicate.cli.target_list import targets\nfrom replicate.methods.method_registry import methods\n"
        "import replicate.targets.table2\n"
        f"targets(), methods()\nprint(sorted({heavy} & set(sys.modules)))"
    )
    process = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "[]"
