"""The Rig contract: what it asks of any rig, and what it refuses."""

import numpy as np
import pytest
from box import foreign, lift

from data_recipes.rig import Rig, check_rig
from replicate.engine.exceptions import InputError


def test_our_rigs_and_those_of_users_keep_the_contract(tiny):
    assert isinstance(tiny, Rig) and isinstance(foreign(), Rig)
    assert check_rig(tiny) is tiny


@pytest.mark.parametrize(
    "function, part",
    [
        (lambda p: np.zeros((len(p), 3, 3)), "shape"),
        (lambda p: lift(p) + np.array([0, 0, 0.1]), "vertex 0 lies 0.1 mm"),
        (lambda p: lift(p) * np.where(np.arange(4) == 2, np.nan, 1)[:, None], "vertex 2"),
    ],
)
def test_a_function_that_is_no_rig_is_refused(function, part):
    with pytest.raises(InputError, match=part):
        check_rig(foreign(function=function))
