"""Which sources a stage depends on, read from definitions and imports without importing anything.

A function depends on the definitions that it names in its module, on those that it imports from others, on what those
name in turn, and on every statement that runs when one of these modules is imported. Anything else, such as how stages
are put together or how a row is labelled, can change without making an artefact anew.

What is found in a module is kept beside its bytecode, as `__pycache__/<module>.<Python>.opt-outline.json`: to parse all
takes a second and a half of each command.
"""

import ast
import functools
import hashlib
import importlib.util
import json
import os
import sys
import zlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from replicate.base.files import read_sealed, write_sealed
from replicate.base.paths import ROOT

# What runs a stage and checks its configuration. It changes no result, so no stage depends on it.
MACHINERY = ("replicate", "replicate.config", "replicate.base", "replicate.engine", "replicate.cli")
EVERYTHING = "*"  # in place of a definition's name: all of a module


def is_machinery(module: str) -> bool:
    """Return whether a module is part of the engine that runs stages, or holds the configuration in their keys."""
    return module in MACHINERY or module.startswith(tuple(f"{package}." for package in MACHINERY[2:]))


def sources_digest(functions: str) -> str:
    """Return a hash of all project sources that a stage's function, or several functions, depend on.

    functions: "module:function", or several after commas: the stage's function, then those that it calls by name.

    Imports inside functions count as those at the top do. Comments, layout, docstrings and the engine (`is_machinery`)
    don't count. Definitions and modules that are looked up by a computed name are missed. Raises ValueError when there
    is no such function.
    """
    return _digest(_definitions(functions))


def source_texts(functions: str) -> dict[str, str]:
    """Return, for each module that `sources_digest` of some functions reads, a hash of its whole text."""
    return {module: _outline(_module_file(module), module).text for module in _closure(_definitions(functions))}


def are_unchanged(texts: dict[str, str]) -> bool:
    """Return whether modules still have the texts that `source_texts` found, and `sources_digest` is the same."""
    files = {module: _module_file(module) for module in texts}
    return all(file is not None and _hash(file.read_bytes()) == texts[module] for module, file in files.items())


def _definitions(functions: str) -> tuple[tuple[str, str], ...]:
    definitions = []
    for function in functions.split(","):
        module, _, name = function.strip().partition("(")[0].partition(":")
        file = _module_file(module)
        if file is None:
            raise ValueError(f"{function.strip()}: there is no module {module} among the sources")
        if name not in _outline(file, module).bindings:
            raise ValueError(f"{function.strip()}: {file} has no function {name}")
        definitions.append((module, name))
    return tuple(definitions)


def code_digest(code: str) -> str:
    """Return a hash of all project sources that some lines of Python import; the lines themselves don't count."""
    entries = [entry for node in ast.walk(ast.parse(code)) for entry in _import_entries(node, "", False)]
    definitions = [
        (f"{module}.{name}", EVERYTHING) if name and _module_file(f"{module}.{name}") else (module, name or EVERYTHING)
        for _, module, name in entries
    ]
    return _digest(tuple(sorted(definitions)))


@functools.cache
def _digest(definitions: tuple[tuple[str, str], ...]) -> str:
    """Return the hash of everything that some definitions, (module, name) each, depend on."""
    dumps = []
    for module, places in sorted(_closure(definitions).items()):
        statements = _outline(_module_file(module), module).statements
        dumps += [_written(module, place) for place in sorted(places) if not statements[place].is_import]
    return _hash(f"[{', '.join(dumps)}]".encode())


@functools.cache
def _written(module: str, place: int) -> str:
    """Return a statement of a module as it enters a hash; cached, since many hashes share it."""
    return repr((module, _outline(_module_file(module), module).statements[place].dump))


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@functools.cache
def _closure(definitions: tuple[tuple[str, str], ...]) -> dict[str, set[int]]:
    """Return the statements that some definitions, (module, name) each, depend on: by module, their places in it."""
    closure: dict[str, set[int]] = {}
    pending, visits = list(definitions), set()
    while pending:
        module, name = pending.pop()
        if (module, name) in visits or is_machinery(module) or (file := _module_file(module)) is None:
            continue
        visits.add((module, name))
        outline = _outline(file, module)
        if module not in closure:
            closure[module] = set()
            pending += [(package, "") for package in _packages(module)]
            pending += [(other, "") for other in outline.imports]
            fresh = set(outline.loose)  # they run whenever the module is imported
        else:
            fresh = set()
        if name == EVERYTHING or (name and name not in outline.bindings):
            fresh |= set(range(len(outline.statements)))
        else:
            fresh |= set(outline.bindings.get(name, ()))
        for place in fresh - closure[module]:
            closure[module].add(place)
            pending += _reached(module, place)
    return closure


@functools.cache
def _reached(module: str, place: int) -> frozenset[tuple[str, str]]:
    """Return the definitions, (module, name) each, that a module's statement names or imports."""
    outline = _outline(_module_file(module), module)
    named = {(module, other) for other in outline.statements[place].names if other in outline.definitions}
    return frozenset(named.union(_imports_of(outline, place)))


@dataclass(frozen=True)
class _Statement:
    """A statement at a module's top, as hashing sees it.

    is_import, dump: whether it is an import; else its syntax tree as text.
    names: all names in it.
    attributes: (name, attribute) wherever it reads an attribute of a name.
    bare: names that it uses in another way.
    imports: what it imports, also inside functions: (bound name, module, name there or "").
    """

    is_import: bool
    dump: str
    names: frozenset[str]
    attributes: frozenset[tuple[str, str]]
    bare: frozenset[str]
    imports: tuple[tuple[str, str, str], ...]


@dataclass(frozen=True)
class _Outline:
    """A module as hashing sees it.

    text: a hash of the file's bytes.
    statements: those at the module's top.
    bindings: the places of the statements that bind each name.
    definitions: the names that something other than an import binds.
    loose: the places of the statements that bind no name.
    imports: the modules that it imports.
    """

    text: str
    statements: tuple[_Statement, ...]
    bindings: dict[str, tuple[int, ...]]
    definitions: frozenset[str]
    loose: tuple[int, ...]
    imports: frozenset[str]


def _imports_of(outline: _Outline, place: int) -> list[tuple[str, str]]:
    """Return the (module, name) pairs that a statement uses, through imports inside it or at the module's top.

    Where a name stands for a module, these are the attributes that the statement reads, or everything in the module if
    the name is used in another way.
    """
    statement = outline.statements[place]
    entries = list(statement.imports)
    for name in statement.names:
        for other in outline.bindings.get(name, ()):
            above = outline.statements[other]
            entries += [entry for entry in above.imports if above.is_import and entry[0].split(".")[0] == name]
    pairs = []
    for bound, module, name in entries:
        if name and _module_file(f"{module}.{name}") is None:
            pairs.append((module, name))
            continue
        attributes = {attribute for root, attribute in statement.attributes if root == bound}
        names = attributes if attributes and bound not in statement.bare else {EVERYTHING}
        pairs += [(f"{module}.{name}" if name else module, attribute) for attribute in names]
    return pairs


def _packages(module: str) -> set[str]:
    """Return the packages around a module, whose `__init__` runs when it is imported."""
    parts = module.split(".")
    return {".".join(parts[:count]) for count in range(1, len(parts))}


@functools.cache
def _roots(path: tuple[str, ...]) -> tuple[Path, ...]:
    return (ROOT, *(Path(folder) for folder in path if folder and not _is_installed(os.path.realpath(folder))))


def _is_installed(folder: str) -> bool:
    """Return whether a folder has installed packages: of this environment, of the user, or of another environment."""
    prefixes = tuple(os.path.realpath(prefix) + os.sep for prefix in (sys.prefix, sys.base_prefix))
    return folder.startswith(prefixes) or Path(folder).name in ("site-packages", "dist-packages")


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
def _outline(file: Path, module: str) -> _Outline:
    text = file.read_bytes()
    key = _hash(b"\n".join([_own_text(), sys.version.encode(), module.encode(), text]))
    place = Path(importlib.util.cache_from_source(str(file), optimization="outline")).with_suffix(".json")
    kept = read_sealed(place, lambda stream: json.loads(zlib.decompress(stream.read()))) if place.exists() else None
    if kept is not None and kept["key"] == key:
        return _from_json(kept["outline"])
    outline = _read(text, file, module)
    if not sys.dont_write_bytecode:
        with suppress(OSError):  # as of a tree that can't be written to
            data = zlib.compress(json.dumps({"key": key, "outline": _as_json(outline)}).encode(), 1)
            write_sealed(place, lambda stream: stream.write(data), durable=False)
    return outline


@functools.cache
def _own_text() -> bytes:
    return Path(__file__).read_bytes()


def _as_json(outline: _Outline) -> dict[str, Any]:
    """Return an outline as JSON holds it, sets as lists; `_from_json` turns it back."""
    statements = [
        [each.is_import, each.dump, sorted(each.names), sorted(each.attributes), sorted(each.bare), each.imports]
        for each in outline.statements
    ]
    return vars(outline) | {
        "statements": statements,
        "definitions": sorted(outline.definitions),
        "imports": sorted(outline.imports),
    }


def _from_json(kept: dict[str, Any]) -> _Outline:
    statements = tuple(
        _Statement(
            is_import,
            dump,
            frozenset(names),
            frozenset(map(tuple, attributes)),
            frozenset(bare),
            tuple(map(tuple, imports)),
        )
        for is_import, dump, names, attributes, bare, imports in kept["statements"]
    )
    bindings = {name: tuple(places) for name, places in kept["bindings"].items()}
    sets = {name: frozenset(kept[name]) for name in ("definitions", "imports")}
    return _Outline(kept["text"], statements, bindings, loose=tuple(kept["loose"]), **sets)


def _read(text: bytes, file: Path, module: str) -> _Outline:
    tree = ast.parse(text, str(file))
    _drop_docstring(tree)
    package = file.name == "__init__.py"
    bindings = {}
    loose, statements = [], []
    for place, node in enumerate(tree.body):
        bound = _bound(node)
        for name in bound:
            bindings.setdefault(name, []).append(place)
        if not bound:
            loose.append(place)
        statements.append(_statement(node, module, package))
    imports = {
        whole
        for node, statement in zip(tree.body, statements, strict=True)
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for _, source, name in statement.imports
        for whole in (source, f"{source}.{name}" if name else source)
    }
    bindings = {name: tuple(places) for name, places in bindings.items()}
    definitions = {name for name, places in bindings.items() if not all(statements[k].is_import for k in places)}
    return _Outline(_hash(text), tuple(statements), bindings, frozenset(definitions), tuple(loose), frozenset(imports))


def _drop_docstring(node: ast.AST) -> None:
    if ast.get_docstring(node, clean=False) is not None:
        node.body = node.body[1:]


def _statement(node: ast.stmt, module: str, package: bool) -> _Statement:
    """Return a statement as hashing sees it, without docstrings; its nodes are visited once."""
    imports, names, roots = [], [], {}
    for inner in ast.walk(node):
        if isinstance(inner, ast.Name):
            names.append(inner)
        elif isinstance(inner, ast.Attribute):
            if isinstance(inner.value, ast.Name):
                roots[id(inner.value)] = (inner.value.id, inner.attr)
        elif isinstance(inner, (ast.Import, ast.ImportFrom)):
            imports += _import_entries(inner, module, package)
        elif isinstance(inner, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            _drop_docstring(inner)
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        return _Statement(True, "", frozenset(), frozenset(), frozenset(), tuple(imports))
    bare = frozenset(name.id for name in names if id(name) not in roots)
    used = frozenset(name.id for name in names)
    return _Statement(False, ast.dump(node), used, frozenset(roots.values()), bare, tuple(imports))


def _import_entries(node: ast.AST, module: str, package: bool) -> list[tuple[str, str, str]]:
    """Return (bound name, module, name there) of an import; "import a.b" binds a and imports all of a.b."""
    if isinstance(node, ast.Import):
        return [(alias.asname or alias.name, alias.name, "") for alias in node.names]
    if not isinstance(node, ast.ImportFrom):
        return []
    parts = module.split(".")
    parents = parts[: len(parts) - node.level + package] if node.level else []
    base = ".".join([*parents, *([node.module] if node.module else [])])
    return [(alias.asname or alias.name, base, alias.name) for alias in node.names]


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
