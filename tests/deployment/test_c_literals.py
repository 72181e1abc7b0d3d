"""Numbers as C source: the compiler reads what was written, byte by byte and bit by bit."""

import ctypes

import numpy as np
from c_compiler import library

from replicate.deployment.c_face import byte_rows, float_list, float_number, in_comment, index_list, quoted


def test_a_compiler_reads_every_byte_float_and_index_as_it_was(tmp_path):
    rng = np.random.default_rng(0)
    each = np.arange(256, dtype=np.uint8)
    pairs = np.stack([np.repeat(each, 10), np.tile(np.frombuffer(b"0123456789", np.uint8), 256)], 1).ravel()
    rows = np.stack([pairs, np.resize(np.frombuffer(b'??=??/\\"', np.uint8), len(pairs)), rng.permutation(pairs)])
    floats = np.concatenate([np.float32([0, -0.0, 1, 1e-30, -3e30, 0.1]), rng.normal(size=50).astype(np.float32)])
    indices = np.array([0, 65535, 4_000_000_000])
    source = tmp_path / "numbers.c"
    parts = [byte_rows("rows", rows), float_list("floats", floats), index_list("indices", indices)]
    getters = [
        "const void *first(void) { return rows; }",
        "const void *second(void) { return floats; }",
        "const void *third(void) { return indices; }",
        f"const char *word(void) {{ return {quoted('smile “wide” 7?')}; }}",
    ]
    source.write_text("\n".join(["#include <stdint.h>", "typedef unsigned char byte;", *parts, *getters]), "ascii")
    made = library(source, tmp_path)
    for name in ("first", "second", "third", "word"):
        getattr(made, name).restype = ctypes.c_char_p if name == "word" else ctypes.c_void_p
    read = ctypes.string_at(made.first(), rows.shape[0] * (rows.shape[1] + 1))
    read = np.frombuffer(read, np.uint8).reshape(rows.shape[0], -1)
    np.testing.assert_array_equal(read, np.pad(rows, ((0, 0), (0, 1))))
    assert ctypes.string_at(made.second(), 4 * len(floats)) == floats.tobytes()
    assert ctypes.string_at(made.third(), 4 * len(indices)) == indices.astype(np.uint32).tobytes()
    assert made.word().decode() == "smile “wide” 7?"


def test_a_comment_can_not_be_left():
    assert in_comment("a */ b /* c") == "a * / b / * c"


def test_whole_floats_have_a_point():
    assert [float_number(value) for value in (2.0, 0.5, 1e20)] == ["2.0f", "0.5f", "1e+20f"]
