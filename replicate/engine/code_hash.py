"""Which sources a stage depends on, read from the imports without importing anything."""

import ast
import functools
import hashlib
import os
import sys
from pathlib import Path

from replicate.engine.paths import ROOT

# What carries a stage and checks its configuration: numbers don't pass through it, so it doesn't count.
MACHINERY = ("replicate", "replicate.config", "replicate.engine")


def is_machinery(module: str) -> bool:
    """Return whether a module is part of the engine that runs stages, or holds the configuration in their keys."""
    return module in MACHINERY or module.startswith("replicate.engine.")


def sources_digest(functions: str) -> str:
    """Return a hash of all project sources that a stage's function, or several of them, depend on.

    functions: "module:function", or several after commas: a stage's own, then those that it calls by name. Within its
    own module, what a function reaches counts: definitions that it names, transitively, and the imports that bind them.
    Of every module imported from there, within functions too, all counts. Comments, layout and docstrings do not, nor
    does the engine (`is_machinery`). Modules loaded by a computed name are not seen. Raises ValueError when there is no
    such function.
    """
    digests = [_function_digest(function.strip()) for function in functions.split(",")]
    return digests[0] if len(digests) == 1 else hashlib.sha256("\n".join(digests).encode()).hexdigest()


def _function_digest(function: str) -> str:
    """Return the hash of one function's sources."""
    module, _, name = function.partition(":")
    file = _module_file(module)
    if file is None:
        raise ValueError(f"{function}: there is no module {module} among the sources")
    parts, imported = _reached(_parse(file), name, module, file.name == "__init__.py")
    if not parts:
        raise ValueError(f"{function}: {file} has no function {name}")
    digests = {module: hashlib.sha256("\n".join(parts).encode()).hexdigest()}
    pending = imported | _packages(module)
    while pending:
        found = pending.pop()
        if found in digests or is_machinery(found) or (file := _module_file(found)) is None:
            continue
        digests[found], imported = _whole(file, found)
        pending |= imported | _packages(found)
    return hashlib.sha256(repr(sorted(digests.items())).encode()).hexdigest()


def _packages(module: str) -> set[str]:
    """Return the packages around a module, whose `__init__` runs when it is imported."""
    parts = module.split(".")
    return {".".join(parts[:count]) for count in range(1, len(parts))}


@functools.cache
def _roots(path: tuple[str, ...]) -> tuple[Path, ...]:
    installed = [os.path.realpath(prefix) + os.sep for prefix in (sys.prefix, sys.base_prefix)]
    return (ROOT, *(Path(p) for p in path if p and not os.path.realpath(p).startswith(tuple(installed))))


def project_roots() -> tuple[Path, ...]:
    """Return the folders that sources are looked for in: the project, and what else on the path isn't installed."""
    return _roots(tuple(sys.path))


@functools.cache
def _module_file(module: str) -> Path | None:
    for root in project_roots():
        stem = root.joinpath(*module.split("."))
        for file in (stem.with_name(stem.name + ".py"), stem / "__init__.py"):
            if file.is_file():
                return file
    return None


@functools.cache
def _parse(file: Path) -> ast.Module:
    tree = ast.parse(file.read_text(encoding="utf-8"), str(file))
    for node in ast.walk(tree):
        documented = isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
        if documented and ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:]
    return tree


@functools.cache
def _whole(file: Path, module: str) -> tuple[str, set[str]]:
    """Return the hash of a module and the modules that it imports anywhere."""
    tree = _parse(file)
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest(), _imports(tree, module, file.name == "__init__.py")


def _imports(tree: ast.AST, module: str, is_package: bool) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parts = module.split(".")
            parents = parts[: len(parts) - node.level + is_package] if node.level else []
            base = ".".join([*parents, *([node.module] if node.module else [])])
            found |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return found.union(*(_packages(name) for name in found))


def _reached(tree: ast.Module, name: str, module: str, is_package: bool) -> tuple[list[str], set[str]]:
    """Return the dumps of the statements that a function reaches in its module, and the modules they import."""
    bindings: dict[str, list[ast.stmt]] = {}
    loose = []  # statements that run whenever the module is imported, and bind no single name
    for statement in tree.body:
        names = _bound(statement)
        for bound in names:
            bindings.setdefault(bound, []).append(statement)
        if not names:
            loose.append(statement)
    if name not in bindings:
        return [], set()
    found: set[ast.stmt] = set()
    pending = {*bindings[name], *loose}
    while pending:
        statement = pending.pop()
        found.add(statement)
        named = {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)}
        pending |= {bound for name in named for bound in bindings.get(name, [])} - found
    reached = sorted(found, key=lambda statement: statement.lineno)
    imports = set().union(*(_imports(statement, module, is_package) for statement in reached))
    kept = [s for s in reached if not isinstance(s, (ast.Import, ast.ImportFrom))]
    return [ast.dump(statement) for statement in kept], imports


def _bound(statement: ast.stmt) -> set[str]:
    """Return the names that a top-level definition, assignment or import binds; none for other statements."""
    if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        return {statement.name}
    if isinstance(statement, (ast.Import, ast.ImportFrom)):
        return {alias.asname or alias.name.split(".")[0] for alias in statement.names} - {"*"}
    if isinstance(statement, (ast.Assign, ast.AnnAssign)):
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        return {node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)}
    return set()
