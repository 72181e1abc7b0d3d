"""Shapes are checked at a function's first calls and no longer at its later ones."""

import numpy as np
import pytest
import typechecker
from jaxtyping import Float, TypeCheckError, jaxtyped


@jaxtyped(typechecker=typechecker.check)
def doubled(values: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return 2 * values


def test_wrong_shapes_are_told_at_first_and_pass_later():
    with pytest.raises(TypeCheckError):
        doubled(np.zeros(3))
    for _ in range(typechecker.CALLS):
        doubled(np.zeros((2, 3)))
    assert doubled(np.zeros(3)).shape == (3,)
