"""Rigs that users bring: any function of parameters."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from box import CONTROLS, MESH, foreign

from data_recipes.rig import Clip, check_rig
from replicate.base.exceptions import InputError


def test_a_plain_numpy_function_is_a_rig():
    rig = check_rig(foreign())
    np.testing.assert_allclose(rig(np.array([0.5, 0])) - MESH.neutral, np.tile([0, 2.5, 0], (4, 1)))
    assert rig(np.zeros((33, 2))).shape == (33, 4, 3)
    assert rig.nodes == () and rig.pose_props(rig.default) == [] and rig.paint is None


def test_a_foreign_jax_rig_has_an_exact_jacobian():
    rig = foreign(function=lambda p: jnp.asarray(MESH.neutral) + jnp.sin(p[:, :1, None]) * jnp.array([0, 5.0, 0]))
    jacobian = rig.jacobian(np.array([0.3, 0.0]))
    np.testing.assert_allclose(jacobian[2], [[0, 0], [5 * np.cos(0.3), 0], [0, 0]], rtol=1e-5)


@pytest.mark.parametrize(
    "changes, part",
    [
        ({"controls": ()}, "no controls"),
        ({"controls": (CONTROLS[0], CONTROLS[0])}, "'lift' is there twice"),
        ({"landmarks": np.array([0, 4])}, r"landmarks\[1\] is 4"),
        ({"control_points": np.array([-1])}, r"control_points\[0\] is -1"),
        ({"control_point_regions": ()}, "expected 1 control_point_regions, .*, got 0"),
        ({"control_point_names": ("chin", "nose")}, "expected 1 control_point_names, .*, got 2"),
        ({"face_marks": np.array([9])}, r"face_marks\[0\] is 9; expected a list of vertices from 0 to 3"),
        ({"clips": (Clip("walk", np.zeros((5, 3), np.float32)),)}, r"'walk': .* \(frames, 2\), got \(5, 3\)"),
        ({"clips": (Clip("nan", np.full((5, 2), np.nan, np.float32)),)}, "clip 'nan': expected finite values, got NaN"),
    ],
)
def test_what_does_not_fit_a_foreign_rig_is_named(changes, part):
    with pytest.raises(InputError, match=part):
        foreign(**changes)


def test_parameters_of_the_wrong_length_are_refused():
    with pytest.raises(InputError, match=r"shape \(2,\) or \(b, 2\), got \(3,\)"):
        foreign()(np.zeros(3))


def test_the_mesh_of_a_rig_is_a_frozen_value(tiny):
    with pytest.raises(dataclasses.FrozenInstanceError):
        tiny.name = "other"
