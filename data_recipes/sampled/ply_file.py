"""PLY files, in text or binary: elements with their properties, in the order of the file.

Libraries that read them split vertices at seams, or know faces of one number of corners only.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

TYPES = {
    **dict.fromkeys(("char", "int8"), "b"),
    **dict.fromkeys(("uchar", "uint8"), "B"),
    **dict.fromkeys(("short", "int16"), "h"),
    **dict.fromkeys(("ushort", "uint16"), "H"),
    **dict.fromkeys(("int", "int32"), "i"),
    **dict.fromkeys(("uint", "uint32"), "I"),
    **dict.fromkeys(("float", "float32"), "f"),
    **dict.fromkeys(("double", "float64"), "d"),
}
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_HEADER = 100_000  # bytes

Properties = dict[str, list]  # name → a value a row: a number, or a tuple of numbers for a list


@dataclass
class _Element:
    count: int
    properties: dict[str, tuple[str, ...]] = field(default_factory=dict)  # name → (type,), or (type of length, type)


def read_ply(data: bytes) -> dict[str, Properties]:
    """Return the elements of a PLY file by name. Raises ValueError, with the reason, for anything else."""
    order, elements, body = _header(data)
    read = _words(body) if order == "" else _binary(body, order)
    found = {}
    for name, element in elements.items():
        rows = list(_rows(element, read))
        columns = zip(*rows, strict=True) if rows else ((),) * len(element.properties)
        found[name] = dict(zip(element.properties, map(list, columns), strict=True))
    return found


def _header(data: bytes) -> tuple[str, dict[str, _Element], bytes]:
    """Return the order of bytes ("" for text), the elements that are to come, and what follows the header."""
    end = data.find(b"end_header", 0, LONGEST_HEADER)
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("it has no header of a PLY")
    after = data[end + len(b"end_header") :]
    body = after[2:] if after.startswith(b"\r\n") else after[1:]
    order, elements, last = None, {}, None
    for line in data[:end].decode("ascii", errors="replace").splitlines()[1:]:
        match line.split():
            case ["format", name, _] if name in FORMATS:
                order = FORMATS[name]
            case ["element", name, count] if count.isdecimal():
                elements[name] = last = _Element(int(count))
            case ["property", "list", of_length, kind, name] if last and {of_length, kind} <= TYPES.keys():
                last.properties[name] = (TYPES[of_length], TYPES[kind])
            case ["property", kind, name] if last and kind in TYPES:
                last.properties[name] = (TYPES[kind],)
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"its header says {line.strip()!r}")
    if order is None:
        raise ValueError("its header states no format")
    return order, elements, body


Read = Callable[[str, int], tuple]  # the types of values to come, how many times → the values


def _rows(element: _Element, read: Read) -> Iterator[list]:
    """Yield the values of each row of an element. Runs of single values are read at once."""
    types = list(element.properties.values())
    if not types:
        return
    if all(len(kind) == 1 for kind in types):
        together = "".join(kind for (kind,) in types)
        for _ in range(element.count):
            yield list(read(together, 1))
        return
    for _ in range(element.count):
        row = []
        for kind in types:
            first = read(kind[0], 1)[0]
            row.append(first if len(kind) == 1 else read(kind[1], _length(first)))
        yield row


def _length(stated: float) -> int:
    if stated < 0 or stated != int(stated):
        raise ValueError(f"a list has the length {stated}")
    return int(stated)


def _words(body: bytes) -> Read:
    words, at = body.split(), 0

    def read(types: str, times: int) -> tuple:
        nonlocal at
        count = len(types) * times
        if at + count > len(words):
            raise ValueError("it ends too early")
        taken, at = words[at : at + count], at + count
        return tuple(
            float(word) if kind in "fd" else int(word) for word, kind in zip(taken, types * times, strict=True)
        )

    return read


def _binary(body: bytes, order: str) -> Read:
    at = 0

    def read(types: str, times: int) -> tuple:
        nonlocal at
        size = struct.calcsize(order + types) * times
        if at + size > len(body):
            raise ValueError("it ends too early")
        start, at = at, at + size
        return struct.unpack_from(order + types * times, body, start)

    return read
