"""beartype as the tests use it: a whole number may stand where a float is asked for (PEP 484).

Shapes are checked at a function's first calls alone, for they cost more than many a function.
"""

import functools
import inspect
import sys
from collections import Counter
from operator import attrgetter

from beartype import BeartypeConf, beartype

# Functions and classes, not assignments. Exporters are files that run in other programs, too.
SKIPPED = ("data_recipes.exporters",)
CONF = BeartypeConf(is_pep484_tower=True, claw_is_pep526=False, claw_skip_package_names=SKIPPED)
CALLS = 100  # of a function whose shapes are checked in a process, as some are called a million times
_calls = Counter()


def check(function):
    """The typechecker that jaxtyping applies to a function's arguments, and once more to these with its result."""
    checked = beartype(conf=CONF)(function)
    name = f"{function.__module__}:{function.__qualname__}"

    @functools.wraps(checked)
    def counted(*arguments, **keywords):
        _calls[name] += 1
        if _calls[name] == 2 * CALLS and "<" not in name:
            leave_unchecked(function.__module__, function.__qualname__)
        return checked(*arguments, **keywords)

    return counted


def leave_unchecked(module, name):
    """Leave a function's shapes unchecked from here on: jaxtyping looks for this attribute at every call."""
    found = attrgetter(name)(sys.modules[module])
    for inner in ("fget", "func", "__func__"):  # of a property, a cached one, a method of a class
        found = getattr(found, inner, found)
    inspect.unwrap(found).__no_type_check__ = True
