"""Numbers as C99 source that compiles in seconds: bytes as strings, few numbers as lists."""

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float, Int, UInt8

BYTES_A_LINE = 48
NUMBERS_A_LINE = 12
PLAIN = {code for code in range(32, 127) if chr(code) not in '"\\?'}  # "??" begins a trigraph
SHORT = [chr(code) if code in PLAIN else f"\\{code:o}" for code in range(256)]
LONG = [chr(code) if code in PLAIN else f"\\{code:03o}" for code in range(256)]  # before a digit
DIGITS = set(b"01234567")


def byte_rows(name: str, rows: UInt8[np.ndarray, "r k"]) -> str:
    """Return `static const byte name[r][k + 1]`: strings a row, and a zero at its end."""
    strings = ",\n".join(_strings(row.tobytes()) for row in rows)
    return f"static const byte {name}[{rows.shape[0]}][{rows.shape[1] + 1}] = {{\n{strings}}};\n"


def float_list(name: str, values: Float[np.ndarray, "*shape"]) -> str:
    """Return `static const float name[k]`, to the last bit."""
    return _list("float", name, list(map(float_number, np.asarray(values, np.float32).ravel().tolist())))


def index_list(name: str, values: Int[np.ndarray, " k"]) -> str:
    """Return `static const uint32_t name[k]`."""
    return _list("uint32_t", name, list(map(str, np.asarray(values).tolist())))


def float_number(value: float) -> str:
    """Return a number as C has it, float32 to the last bit."""
    text = f"{value:.9g}"
    return f"{text}f" if set(text) & set(".e") else f"{text}.0f"


def quoted(text: str) -> str:
    """Return a text as a string of C in ASCII."""
    return _string(text.encode())


def in_comment(text: str) -> str:
    """Return a text that doesn't end the comment in which it stands."""
    return text.replace("*/", "* /").replace("/*", "/ *")


def structures(rows: Iterable[Sequence[str]]) -> str:
    """Return the rows of an array of structures."""
    return ",\n".join(f"    {{{', '.join(row)}}}" for row in rows)


def _list(kind: str, name: str, words: list[str]) -> str:
    lines = ",\n".join(", ".join(words[i : i + NUMBERS_A_LINE]) for i in range(0, len(words), NUMBERS_A_LINE))
    return f"static const {kind} {name}[{len(words)}] = {{\n{lines}}};\n"


def _strings(data: bytes) -> str:
    """Return bytes as strings that C joins, one a line."""
    return "\n".join(_string(data[i : i + BYTES_A_LINE]) for i in range(0, len(data), BYTES_A_LINE))


def _string(data: bytes) -> str:
    following = data[1:] + b" "
    return (
        f'"{"".join((LONG if after in DIGITS else SHORT)[code] for code, after in zip(data, following, strict=True))}"'
    )
