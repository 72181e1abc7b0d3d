"""Imports run one way, and what needs a screen or a mesh library is loaded by nothing that doesn't."""

import ast
import subprocess
import sys

from replicate.engine.paths import ROOT

SOURCES = sorted(path for folder in ("replicate", "data_recipes") for path in (ROOT / folder).rglob("*.py"))
DISPLAY_ONLY = {"pyvista", "trimesh", "vtk", "vtkmodules"}


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path) for path in SOURCES}


def imports(path, only_at_the_top=False):
    """Return the modules that a file imports; anywhere, or only those that importing it loads."""
    tree = ast.parse(path.read_text())
    package = module_name(path).split(".")[: None if path.name == "__init__.py" else -1]
    inside = {id(n) for f in ast.walk(tree) if isinstance(f, (ast.FunctionDef, ast.Lambda)) for n in ast.walk(f)}
    found = set()
    for node in ast.walk(tree):
        if only_at_the_top and id(node) in inside:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*base, *([node.module] if node.module else [])])
            submodules = {f"{base}.{alias.name}" for alias in node.names} & MODULES
            whole = {base} if len(submodules) < len(node.names) else set()
            found |= submodules | whole
    return found


def test_only_figures_load_what_draws():
    for path in SOURCES:
        loaded = {name.split(".")[0] for name in imports(path, only_at_the_top=True)}
        assert not loaded & DISPLAY_ONLY or {"drawing", "rig_tour"} & set(path.parts), (
            f"{module_name(path)} loads {loaded & DISPLAY_ONLY}"
        )


def test_everything_but_figures_works_without_pyvista_and_trimesh():
    left_out = ("replicate.figures", "replicate.__main__", "replicate.engine.worker", "replicate.benchmarks")
    modules = [name for name in sorted(MODULES) if not name.startswith(left_out)]
    program = f"""
import importlib, sys
for name in {sorted(DISPLAY_ONLY)}:
    sys.modules[name] = None  # an import of it fails
for name in {modules}:
    importlib.import_module(name)
"""
    told = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr


def test_the_command_line_loads_nothing_heavy_to_see_that_nothing_is_to_be_done():
    program = "import sys, replicate.__main__, replicate.engine.scheduler, replicate.engine.cache_report\n"
    if "replicate.pipeline" in MODULES:
        program += "import replicate.pipeline\n"
    program += "print(sorted({'jax', 'torch', 'scipy', 'numba', 'pandas', 'matplotlib', 'pyvista'} & set(sys.modules)))"
    told = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
