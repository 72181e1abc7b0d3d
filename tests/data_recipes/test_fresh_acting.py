"""The performance that is captured: within limits, from rest to rest, and not in the animation."""

import numpy as np
import pytest
import rigs

from data_recipes.catalogue import performance
from data_recipes.controls import Control
from data_recipes.function_rig import FunctionRig
from replicate.base.exceptions import InputError


def test_the_performance_is_within_limits_and_of_no_clip():
    rig = rigs.rig("tiny")
    values = performance(rig)
    assert values.shape[1] == len(rig.controls) and len(values) > 150
    assert (values >= rig.lower).all() and (values <= rig.upper).all()
    np.testing.assert_allclose(values[[0, -1]], np.tile(rig.default, (2, 1)), atol=0.02)
    assert (np.ptp(values, axis=0) > 0.05).mean() > 0.5
    frames = {frame.tobytes() for clip in rig.clips for frame in clip.values}
    moving = values[np.abs(values - rig.default).max(axis=1) > 0.1]
    assert not any(frame.tobytes() in frames for frame in moving)
    np.testing.assert_array_equal(values, performance(rig))


def test_a_rig_with_other_controls_cannot_perform():
    mesh = rigs.rig("tiny").mesh
    rest = (Control("hum", 0.0, 0.0, 1.0, "face"),)
    none = np.zeros(0, np.int32)
    strange = FunctionRig("strange", mesh, rest, none, none, (), None, lambda p: np.tile(mesh.neutral, (len(p), 1, 1)))
    with pytest.raises(InputError, match="'strange': it has none of the controls"):
        performance(strange)
