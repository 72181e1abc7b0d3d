"""The list of methods: the modules of this folder that have a `METHOD`, and files from outside."""

import importlib
import importlib.util
import os
import pkgutil
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import ModuleType

from data_recipes.recipe_paths import sample_folder
from replicate.base.exceptions import InputError
from replicate.base.paths import with_home
from replicate.base.schema import Checked
from replicate.base.spelling import nothing_named
from replicate.base.user_files import is_file, shown_path
from replicate.config import Config
from replicate.engine.stage import Stage
from replicate.methods.method import Method
from replicate.methods.plan import Plan

VARIABLE = "REPLICATE_METHODS"  # lists files of methods from outside, for worker processes and notebooks
PACKAGE = "replicate.methods"
PRINTED = "printed"  # part of the names of the rows that are trained as the text prints


def methods(config: Config | None = None) -> dict[str, Method]:
    """Return all methods by name, in the order of the tables: the project's, then those from outside.

    config: decides which numbers of bones LBS has; None for the paper's.
    """
    own = _suite_methods(config)
    brought = [method for module in map(_outside_module, _outside_files()) for method in _brought(module, config)]
    return {method.name: method for method in _sort([*own, *brought])}


def sections(profile: str) -> dict[str, Checked]:
    """Return the methods' sections of the configuration, by the methods' names."""
    return {name: method.default_section(profile) for name, method in methods().items() if method.default_section}


def method_named(name: str) -> Method:
    """Return the method of that name; an unknown one, as in old results, gets its name as label."""
    if name in (registry := methods()):
        return registry[name]
    for module in _suite_modules():
        if hasattr(module, "method_named") and (method := module.method_named(name)):
            return method
    return Method(name, name, lambda plan: (), lambda inputs, settings: lambda params: None)


def outside_names() -> set[str]:
    """Return the names of the methods from outside."""
    return {method.name for file in _outside_files() for method in _methods_in(_outside_module(file), None)}


def in_order(names: Iterable[str]) -> list[str]:
    """Return methods' names in the order of the tables: the paper's first, each group by place."""
    return [method.name for method in _sort(map(method_named, dict.fromkeys(names)))]


def choose(words: Sequence[str], config: Config | None = None) -> list[Method]:
    """Return the methods that some words name, in the order of the tables.

    words: names, "standard", "all", "lbs" for all numbers of bones, "printed" for the text's recipe in all readings, or
        paths of .py files with a method; without any, the standard methods. "all" leaves out the text's recipe, whose
        many steps take most of a day, and methods that differentiate the rig if that is known only by its samples.
    config: as for `methods`.

    Raises InputError for an unknown name and for a file without a method.
    """
    outside = {word: _bring(Path(word)) for word in words if word.endswith(".py")}
    registry = methods(config)
    selection: dict[str, Method] = {}
    for word in words or ("standard",):
        if word == "all":
            sampled = config is not None and sample_folder(config.character) is not None
            selection |= {
                name: method
                for name, method in registry.items()
                if not (sampled and method.needs_derivatives) and PRINTED not in name
            }
        elif word == "standard":
            selection |= {name: method for name, method in registry.items() if method.standard}
        elif word in outside:
            selection |= {method.name: method for method in _brought(outside[word], config)}
        elif word == "lbs":
            selection |= {name: method for name, method in registry.items() if re.fullmatch(r"lbs\d+", name)}
        elif word == PRINTED:
            selection |= {name: method for name, method in registry.items() if PRINTED in name}
        elif word in registry:
            selection[word] = registry[word]
        else:
            groups = ("standard", "all", "lbs", PRINTED)
            usual = [name for name, method in registry.items() if method.standard]
            others = (
                f": there are {', '.join((*groups, *usual))}, {len(registry) - len(usual)} more with all or {PRINTED}, "
                "and paths of .py files"
            )
            raise InputError(nothing_named("method", word, (*groups, *registry), others))
    return _sort(selection.values())


def _sort(methods: Iterable[Method]) -> list[Method]:
    return sorted(methods, key=lambda method: (not method.in_paper, method.place, method.name))


@cache
def _suite_methods(config: Config | None) -> tuple[Method, ...]:
    return tuple(method for module in _suite_modules() for method in _methods_in(module, config))


@cache
def _suite_modules() -> tuple[ModuleType, ...]:
    names = [name for _, name, _ in pkgutil.iter_modules(importlib.import_module(PACKAGE).__path__)]
    modules = [importlib.import_module(f"{PACKAGE}.{name}") for name in names]
    return tuple(module for module in modules if _holds_methods(module))


def _holds_methods(module: ModuleType) -> bool:
    return any(hasattr(module, name) for name in ("METHOD", "METHODS", "methods_of"))


def _methods_in(module: ModuleType, config: Config | None) -> tuple:
    if hasattr(module, "methods_of"):
        return module.methods_of(config)
    return (module.METHOD,) if hasattr(module, "METHOD") else tuple(module.METHODS)


def _brought(module: ModuleType, config: Config | None) -> list[Method]:
    """Return the methods of a module from outside, whose mistakes in `stages` are told in a sentence."""
    return [
        replace(method, stages=partial(_stages, method, str(module.__file__))) for method in _methods_in(module, config)
    ]


def _stages(method: Method, file: str, plan: Plan) -> tuple[Stage, ...]:
    try:
        return tuple(method.stages(plan))
    except InputError:
        raise
    except Exception as error:
        said = f"{type(error).__name__}: {error}".removesuffix(": ")
        raise InputError(f"{file}: the method {method.name!r} can't say its stages ({said})") from error


def _outside_files() -> list[Path]:
    return [Path(file) for file in os.environ.get(VARIABLE, "").split(os.pathsep) if file]


def _bring(file: Path) -> ModuleType:
    """Import a method's file and list it in the environment, which other processes inherit."""
    file = with_home(str(file), "METHODS").resolve()
    module = _outside_module(file)
    files = dict.fromkeys([*map(str, _outside_files()), str(file)])
    os.environ[VARIABLE] = os.pathsep.join(files)
    return module


def _outside_module(file: Path) -> ModuleType:
    """Import a file as the module of its name; its folder joins the path, so that it may import its neighbours."""
    if not is_file(file):
        raise InputError(f"{shown_path(file)}: there is no such file; METHODS expects names and paths of .py files")
    name, folder = file.stem, str(file.parent)
    if not name.isidentifier():
        raise InputError(f"{file}: a module can't be called {name!r}: use letters, digits and _")
    if folder not in sys.path:
        sys.path.append(folder)
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None or Path(spec.origin).resolve() != file:
        raise InputError(f"{file}: there is another module {name}; give the file another name")
    try:
        module = importlib.import_module(name)
        found = _methods_in(module, None) if _holds_methods(module) else ()
    except (Exception, SystemExit) as error:
        raise InputError(f"{file}: it can't be imported ({type(error).__name__}: {error})") from error
    if not _holds_methods(module):
        raise InputError(f"{file}: it has no METHOD; README shows what a method's file looks like")
    for method in found:
        if not isinstance(method, Method) or not re.fullmatch(r"[a-z]\w*", method.name):
            raise InputError(f"{file}: METHOD must be a Method whose name has only small letters, digits and _")
        if method.name in {known.name for m in _suite_modules() for known in _methods_in(m, None)}:
            raise InputError(f"{file}: the suite has a method {method.name!r} already; give yours another name")
    return module
