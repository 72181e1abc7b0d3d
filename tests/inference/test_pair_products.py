"""Products of a vector with rows of 8 bits, in pairs, against NumPy's."""

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from replicate.inference import products
from replicate.inference.products import BLOCK, add_pairs, has_pair_instruction, in_pairs
from replicate.kernels.vector_code import PLAIN

RNG = np.random.default_rng(0)
WIDTH = 2 * BLOCK + 3


def rows_of(count, width=WIDTH):
    return RNG.integers(-128, 128, (count, width)).astype(np.int8)


def product(x, rows, first=0, before=None, add=add_pairs):
    """Return before + x @ rows, and where the rows end that lie behind `first` other numbers."""
    stored = np.concatenate([np.full(first, 99, np.int8), in_pairs(rows)])
    out = np.zeros(rows.shape[1], np.float32) if before is None else before.copy()
    end = add(x, stored, first, rows.shape[1], out, np.zeros(BLOCK + len(x), np.int32))
    assert end == len(stored)
    return out


@pytest.mark.parametrize("count", [0, 1, 2, 7, 80])
@pytest.mark.parametrize("width", [1, BLOCK, WIDTH])
def test_products_are_numpys_but_for_the_rounding_of_the_vector(count, width):
    x, rows = RNG.normal(size=count).astype(np.float32), rows_of(count, width)
    before = RNG.normal(size=width).astype(np.float32)
    loss = count * 128 * np.abs(x).max(initial=0) / 65_534
    np.testing.assert_allclose(product(x, rows, 5, before), before + x.astype(np.float64) @ rows, atol=loss + 1e-4)


def test_numbers_that_16_bits_hold_lose_nothing():
    x, rows = np.float32([32_767, -1, 0, 12_345, -32_767]), rows_of(5)
    np.testing.assert_array_equal(product(x, rows), np.float32(x.astype(np.int64) @ rows.astype(np.int64)))


def test_many_rows_of_the_largest_numbers_do_not_overflow():
    count = 2_000
    x, rows = np.full(count, 3.5, np.float32), np.full((count, 5), -128, np.int8)
    np.testing.assert_allclose(product(x, rows), np.full(5, -128 * 3.5 * count), rtol=1e-3)


def test_a_vector_of_zeros_adds_nothing_and_one_that_is_not_finite_shows_everywhere():
    rows, before = rows_of(4), RNG.normal(size=WIDTH).astype(np.float32)
    np.testing.assert_array_equal(product(np.zeros(4, np.float32), rows, before=before), before)
    for bad in (np.nan, np.inf):
        assert np.isnan(product(np.float32([1, bad, 0, 2]), rows, before=before)).all()


@pytest.mark.skipif(PLAIN or not has_pair_instruction(), reason="nothing here has two ways")
def test_a_processor_without_the_instruction_gives_the_same_numbers(monkeypatch):
    x, rows = RNG.normal(size=80).astype(np.float32), rows_of(80)
    pairwise = njit(add_pairs.py_func)  # compiled here: code that an earlier process has kept can't be looked at
    expected = product(x, rows, add=pairwise)
    monkeypatch.setattr(products, "has_pair_instruction", lambda: False)
    plain = njit(add_pairs.py_func)
    np.testing.assert_array_equal(product(x, rows, add=plain), expected)
    assert "pmadd" in "".join(pairwise.inspect_llvm().values())
    assert "pmadd" not in "".join(plain.inspect_llvm().values())


@pytest.mark.skipif(PLAIN, reason="the plain twins take any type")
def test_numbers_of_another_type_are_refused():
    with pytest.raises(TypingError, match="expected int8, int32 and int32, got "):
        add_pairs(np.ones(2, np.float32), np.ones(4), 0, 2, np.zeros(2, np.float32), np.zeros(99, np.int32))
