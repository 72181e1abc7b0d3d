"""Products of a vector with stored rows against NumPy's."""

import numpy as np
import pytest
from numba.core.errors import TypingError

from replicate.inference import products
from replicate.inference.products import COLUMNS, add_products, has_halves, without_loss
from replicate.kernels.vector_code import PLAIN

RNG = np.random.default_rng(0)


def product(x, matrix, first=0, out=None):
    """Return out + x @ matrix, whose rows lie in a flat array behind `first` other numbers."""
    flat = np.concatenate([np.full(first, 99, matrix.dtype), matrix.ravel()])
    out = np.zeros(matrix.shape[1], np.float32) if out is None else out
    add_products(x, flat, first, matrix.shape[1], out, np.zeros(len(x), np.int64))
    return out


@pytest.mark.parametrize("kind", [np.float32, np.int16, np.int8])
@pytest.mark.parametrize(("inputs", "width"), [(1, 1), (8, 16), (21, 37), (19, COLUMNS + 5)])
def test_every_kind_of_row_gives_numpys_product(kind, inputs, width):
    x = RNG.normal(size=inputs).astype(np.float32)
    matrix = (RNG.normal(size=(inputs, width)) * 20).astype(kind)
    before = RNG.normal(size=width).astype(np.float32)
    expected = before + x.astype(np.float64) @ matrix
    np.testing.assert_allclose(product(x, matrix, 3, before.copy()), expected, rtol=1e-4, atol=1e-3)


@pytest.mark.skipif(not has_halves(), reason="this processor can't read float16")
def test_the_bits_of_float16_are_read_exactly_the_smallest_too():
    matrix = np.array([[1.5, -65504.0, 6e-8, 0.0, -0.333]], np.float16)
    out = product(np.ones(1, np.float32), matrix.view(np.uint16))
    np.testing.assert_array_equal(out, matrix[0].astype(np.float32))


def test_rows_of_zeros_are_not_read():
    x = np.array([0, 2, 0, -1, 0], np.float32)
    matrix = RNG.normal(size=(5, 9)).astype(np.float32)
    matrix[[0, 2, 4]] = np.nan
    np.testing.assert_allclose(product(x, matrix), 2 * matrix[1] - matrix[3], rtol=1e-5)
    np.testing.assert_array_equal(product(np.zeros(5, np.float32), matrix), np.zeros(9))


@pytest.mark.skipif(PLAIN, reason="the plain twins take any type")
def test_weights_of_another_type_are_refused():
    with pytest.raises(TypingError, match=r"weights: expected float32, .* got "):
        product(np.ones(2, np.float32), np.ones((2, 3)))


def test_weights_are_stored_in_16_bits_where_that_loses_nothing(monkeypatch):
    exact, lossy, large = np.float32([0.5, -3.0]), np.float32([0.1, 0.2]), np.float32([1e6])
    assert without_loss(lossy).dtype == np.float32 and without_loss(large, halves=True).dtype == np.float32
    for stored, own in ((without_loss(exact), exact), (without_loss(lossy, halves=True), lossy.astype(np.float16))):
        if has_halves():
            np.testing.assert_array_equal(stored.view(np.float16), own)
    monkeypatch.setattr(products, "has_halves", lambda: False)
    assert without_loss(exact, halves=True).dtype == np.float32
