"""Frozen dataclasses that check their own fields, and their form as JSON."""

import dataclasses
import importlib
import math
import typing
from dataclasses import dataclass, field
from typing import Literal

from replicate.engine.exceptions import InputError


def number(default, lower, upper=None):
    """Declare a field whose values, or whose elements, lie in [lower, upper]."""
    return field(default=default, metadata={"range": (lower, upper)})


@dataclass(frozen=True)
class Checked:
    """A dataclass whose fields are checked against their annotations and ranges when it is made."""

    def __post_init__(self):
        hints = typing.get_type_hints(type(self))
        for entry in dataclasses.fields(self):
            value = getattr(self, entry.name)
            allowed = _allowed(value, hints[entry.name], entry.metadata.get("range", (None, None)))
            if allowed:
                raise InputError(f"{entry.name} is {value!r}: allowed is {allowed}")
            if hints[entry.name] is float:  # 5 and 5.0 are the same configuration, and have the same key
                object.__setattr__(self, entry.name, float(value))
            elif hints[entry.name] == tuple[float, ...]:
                object.__setattr__(self, entry.name, tuple(float(item) for item in value))


def _allowed(value, hint, bounds) -> str:
    """Return "" if `value` is of type `hint` and within `bounds`, else what is allowed, in words."""
    if typing.get_origin(hint) is Literal:
        options = typing.get_args(hint)
        return "" if value in options else "one of " + ", ".join(options)
    if typing.get_origin(hint) is tuple:
        element = typing.get_args(hint)[0]
        if isinstance(value, tuple) and value and not any(_allowed(item, element, bounds) for item in value):
            return ""
        return f"a list with at least one element, each {_words(element, bounds)}"
    kinds = {float: (float, int), int: (int,), str: (str,), bool: (bool,)}.get(hint, (hint,))
    lower, upper = bounds
    fits = isinstance(value, kinds) and (hint is bool or not isinstance(value, bool))
    fits = fits and not (isinstance(value, float) and not math.isfinite(value))
    if fits and (lower is None or value >= lower) and (upper is None or value <= upper):
        return ""
    return _words(hint, bounds)


def _words(hint, bounds) -> str:
    lower, upper = bounds
    kinds = {float: "a number", int: "a whole number", str: "text", bool: "true or false"}
    kind = kinds.get(hint, f"a {hint.__name__}")
    if lower is not None:
        kind += f" of at least {lower}"
    return kind + (f" and at most {upper}" if upper is not None else "")


def to_json(value):
    """Return a configuration as JSON-ready data that `from_json` turns back into the same dataclasses."""
    if dataclasses.is_dataclass(value):
        fields = {entry.name: to_json(getattr(value, entry.name)) for entry in dataclasses.fields(value)}
        return {"dataclass": f"{type(value).__module__}:{type(value).__qualname__}", "fields": fields}
    if isinstance(value, (tuple, list)):
        return [to_json(item) for item in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"a configuration holds {type(value).__name__}: use numbers, text, tuples and dataclasses")


def from_json(data):
    """Return what `to_json` was given; lists come back as tuples."""
    if isinstance(data, list):
        return tuple(from_json(item) for item in data)
    if isinstance(data, dict) and "dataclass" in data:
        module, _, name = data["dataclass"].partition(":")
        fields = {key: from_json(item) for key, item in data["fields"].items()}
        return getattr(importlib.import_module(module), name)(**fields)
    return data
