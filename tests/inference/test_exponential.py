"""The exponential in plain arithmetic: as near as float32 needs, and finite wherever it is asked."""

import numpy as np
from numba import njit

from replicate.inference.regional_evaluation import exponential


@njit
def of_all(values):
    out = np.empty_like(values)
    for k in range(len(values)):
        out[k] = exponential(values[k])
    return out


def test_it_is_the_exponential_within_the_range_of_float32():
    x = np.linspace(-87, 87, 100_001, dtype=np.float32)
    true = np.exp(x.astype(np.float64))
    error = np.abs(of_all(x) / true - 1)
    assert error.max() < 5e-6  # the larger x * log2(e), the fewer bits are left behind its point
    assert error[np.abs(x) < 5].max() < 5e-7 and np.abs(of_all(np.zeros(1, np.float32)) - 1).max() < 2e-7


def test_beyond_that_range_it_stays_where_it_is():
    x = np.array([87.4, 1e3, 3e38, np.inf], np.float32)
    for sign in (1, -1):
        ends = of_all(np.float32(sign) * x)
        assert np.isfinite(ends).all() and (ends == ends[0]).all() and ends[0] > 0
