"""Settings: frozen dataclasses that check their fields, are read from TOML tables and are stored as JSON.

A field's annotation is its type (`float`, `int`, `Literal`, `tuple[float, ...]`, another dataclass), its metadata says
which values it may have; `number`, `numbers`, `span`, `table`, `names`, `groups` and `identifier` declare such fields.
Recipes, ICT-FaceKit's recipes and configurations are all read by `read_table`.
"""

import dataclasses
import importlib
import math
import typing
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field
from typing import Any, Literal

from replicate.base.exceptions import InputError

LONGEST = 100  # characters of a value in a message, and bytes of a name that file names are built from


class _Unfit(ValueError):
    """A value doesn't fit its field; the text says what is expected."""


def number(default: Any = MISSING, lower: float = 0, upper: float | None = None, even: bool = False) -> Any:
    """Declare a number in [lower, upper]; with a tuple as annotation, a list of one or more such numbers."""
    return field(default=default, metadata={"range": (lower, upper), "even": even})


def numbers(default: Any, length: int, lower: float, upper: float, optional: bool = False) -> Any:
    """Declare a list of `length` numbers in [lower, upper], which may be empty if it is optional."""
    return field(default=default, metadata={"range": (lower, upper), "length": length, "optional": optional})


def span(default: Any = MISSING, lower: int = 0, upper: int | None = None) -> Any:
    """Declare two whole numbers in [lower, upper], the smaller first."""
    return field(default=default, metadata={"range": (lower, upper), "length": 2, "ordered": True})


def table(default: Any, width: int, lower: float, upper: float) -> Any:
    """Declare a list of rows of `width` numbers each in [lower, upper]."""
    return field(default=default, metadata={"range": (lower, upper), "width": width, "optional": not default})


def identifier() -> Any:
    """Declare a required name of letters, digits and _, short enough for a file name."""
    return field(metadata={"identifier": True})


def names(default: tuple[str, ...] = (), what: str = "names") -> Any:
    """Declare a list of texts, which may be empty; what: the plural noun for them in messages."""
    return field(default=default, metadata={"what": what, "optional": True})


def groups(default: dict[str, tuple[str, ...]], options: tuple[str, ...], what: str) -> Any:
    """Declare a table of lists of `options`, or of any texts if there are none; what: their plural noun in messages."""
    return field(default_factory=lambda: dict(default), metadata={"options": options, "what": what})


@dataclass(frozen=True)
class Checked:
    """A dataclass whose fields are checked against their annotations and metadata whenever one is constructed."""

    def __post_init__(self) -> None:
        hints = typing.get_type_hints(type(self))
        for entry in dataclasses.fields(self):
            value = getattr(self, entry.name)
            # 5 and 5.0 are the same configuration, and have the same key
            object.__setattr__(self, entry.name, _check(entry.name, value, hints[entry.name], entry.metadata))


def read_table(base: Any, table: dict[str, Any], prefix: str = "", **extra: Any) -> Any:
    """Return a Checked dataclass with the values of a nested table, as TOML gives it.

    base: a Checked class, or an instance whose values stay where the table has none.
    prefix: the table's name and a dot, for messages.
    extra: fields that don't come from the table.

    Raises InputError for an unknown or missing key and for a value that doesn't fit.
    """
    kind = base if isinstance(base, type) else type(base)
    hints = typing.get_type_hints(kind)
    entries = {entry.name: entry for entry in dataclasses.fields(kind) if entry.name not in extra}
    for key in table:
        if key not in entries:
            raise InputError(f"unknown key {prefix}{cut(key)}: expected {either(entries)}")
    values = dict(extra)
    for key, entry in entries.items():
        section = hints[key] if dataclasses.is_dataclass(hints[key]) else None
        if key not in table:
            if base is kind and entry.default is MISSING and entry.default_factory is MISSING:
                raise InputError(
                    f"{prefix}{key} is missing: expected {f'a table [{prefix}{key}]' if section else 'a value'}"
                )
        elif section is None:
            values[key] = _check(f"{prefix}{key}", table[key], hints[key], entry.metadata)
        elif isinstance(table[key], dict):
            inner = section if base is kind else getattr(base, key)
            values[key] = read_table(inner, table[key], f"{prefix}{key}.")
        else:
            raise InputError(f"{prefix}{key}: expected a table [{prefix}{key}], got {shown(table[key])}")
    try:
        return kind(**values) if base is kind else dataclasses.replace(base, **values)
    except InputError as error:
        raise InputError(f"{prefix}{error}") from None


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Put a file's name in front of any InputError that lacks it."""
    try:
        yield
    except InputError as error:
        if str(error).startswith(f"{source}: "):
            raise
        raise InputError(f"{source}: {error}") from error


def cut(text: str) -> str:
    """Return a text for use in a message: whole, or its beginning if it is long."""
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


def either(names: Iterable[str]) -> str:
    """Return names as a sentence lists them: "auto, cpu or cuda"."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last


def shown(value: Any) -> str:
    """Return a value for use in a message, however large it is."""
    try:
        return cut(repr(list(value) if isinstance(value, tuple) else value))
    except (ValueError, RecursionError):  # whole numbers of thousands of digits, lists in lists in lists
        return f"a {type(value).__name__} too long to be shown"


def _check(name: str, value: Any, hint: Any, rule: typing.Mapping) -> Any:
    try:
        return _fit(value, hint, rule)
    except _Unfit as error:
        raise InputError(f"{name}: expected {error}, got {shown(value)}") from None


def _fit(value: Any, hint: Any, rule: typing.Mapping) -> Any:
    """Return a value in its field's type. Raises _Unfit if it doesn't fit."""
    origin = typing.get_origin(hint)
    if hint in (int, float):
        return _number(value, hint, rule)
    if rule.get("identifier"):
        if not isinstance(value, str) or not value.isidentifier() or len(value.encode()) > LONGEST:
            raise _Unfit(f"a name of at most {LONGEST} letters, digits and _")
        return value
    if hint is bool or hint is str:
        if not isinstance(value, hint):
            raise _Unfit("true or false" if hint is bool else "text")
        return value
    if origin is Literal:
        if value not in typing.get_args(hint) or not isinstance(value, str):
            raise _Unfit(either(typing.get_args(hint)))
        return value
    if origin is tuple:
        return _list(value, typing.get_args(hint)[0], rule)
    if origin is dict:
        return _groups(value, rule)
    if not isinstance(value, hint):
        raise _Unfit(f"a {hint.__name__}")
    return value


def _number(value: Any, hint: type, rule: typing.Mapping) -> Any:
    lower, upper = rule.get("range", (None, None))
    fits = isinstance(value, (int, float) if hint is float else int) and not isinstance(value, bool)
    fits = fits and not (isinstance(value, float) and not math.isfinite(value))
    fits = fits and (lower is None or value >= lower) and (upper is None or value <= upper)
    try:
        if fits and not (rule.get("even") and value % 2):
            return hint(value)
    except OverflowError:  # a whole number beyond all floats
        pass
    kind = "a number" if hint is float else "an even number" if rule.get("even") else "a whole number"
    raise _Unfit(kind + _reach(rule))


def _reach(rule: typing.Mapping) -> str:
    lower, upper = rule.get("range", (None, None))
    if lower is None:
        return ""
    return f" of at least {_plain(lower)}" if upper is None else f" from {_plain(lower)} to {_plain(upper)}"


def _plain(bound: float) -> str:
    return f"{bound}" if isinstance(bound, int) else f"{bound:g}"


def _list(value: Any, element: Any, rule: typing.Mapping) -> tuple:
    if isinstance(value, (tuple, list)) and not len(value) and rule.get("optional"):
        return ()
    demand = _list_words(element, rule)
    if not isinstance(value, (tuple, list)) or len(value) != rule.get("length", len(value)) or not len(value):
        raise _Unfit(demand)
    try:
        if "width" in rule:
            inner = {"range": rule["range"], "length": rule["width"]}
            return tuple(_list(row, typing.get_args(element)[0], inner) for row in value)
        items = tuple(_fit(item, element, rule) for item in value)
    except _Unfit:
        raise _Unfit(demand) from None
    if (rule.get("ordered") and items[0] > items[1]) or "" in items:
        raise _Unfit(demand)
    return items


def _list_words(element: Any, rule: typing.Mapping) -> str:
    if element is str:
        return f"a list of {rule['what']}"
    if "width" in rule:
        return f"rows of {rule['width']} numbers{_reach(rule)}"
    kind = ("whole numbers" if element is int else "numbers") + _reach(rule)
    if rule.get("ordered"):
        return f"two {kind}, the smaller first"
    return f"{rule['length']} {kind}" if "length" in rule else f"a list of one or more {kind}"


def _groups(value: Any, rule: typing.Mapping) -> dict[str, tuple[str, ...]]:
    fits = isinstance(value, dict) and all(
        isinstance(members, (list, tuple)) and all(_is_option(member, rule["options"]) for member in members)
        for members in value.values()
    )
    if not fits:
        raise _Unfit(f"a table of lists of {rule['what']} {', '.join(rule['options'])}".rstrip())
    return {name: tuple(members) for name, members in value.items()}


def _is_option(member: Any, options: tuple[str, ...]) -> bool:
    return member in options if options else isinstance(member, str)


def to_json(value: Any) -> Any:
    """Return a configuration as JSON-ready data that `from_json` turns back into the same dataclasses."""
    if dataclasses.is_dataclass(value):
        fields = {entry.name: to_json(getattr(value, entry.name)) for entry in dataclasses.fields(value)}
        return {"dataclass": f"{type(value).__module__}:{type(value).__qualname__}", "fields": fields}
    if isinstance(value, dict):  # as pairs, since their order can mean something
        return {"pairs": [[key, to_json(item)] for key, item in value.items()]}
    if isinstance(value, (tuple, list)):
        return [to_json(item) for item in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"a configuration holds {type(value).__name__}: use numbers, text, tuples and dataclasses")


def from_json(data: Any) -> Any:
    """Return the value behind `to_json`'s data; lists come back as tuples."""
    if isinstance(data, list):
        return tuple(from_json(item) for item in data)
    if isinstance(data, dict) and "pairs" in data:
        return {key: from_json(item) for key, item in data["pairs"]}
    if isinstance(data, dict) and "dataclass" in data:
        module, _, name = data["dataclass"].partition(":")
        fields = {key: from_json(item) for key, item in data["fields"].items()}
        return getattr(importlib.import_module(module), name)(**fields)
    return data
