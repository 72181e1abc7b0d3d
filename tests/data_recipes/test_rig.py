"""The Rig contract: what it asks of any rig, and what it refuses."""

import numpy as np
import pytest
from box import foreign, lift
from plain_rig import PlainRig

from data_recipes.rig import AlteredRig, Rig, check_rig
from replicate.base.exceptions import InputError


def test_our_rigs_and_those_of_users_keep_the_contract(tiny):
    assert isinstance(tiny, Rig) and isinstance(foreign(), Rig)
    assert check_rig(tiny) is tiny


@pytest.mark.parametrize(
    "function, part",
    [
        (lambda p: np.zeros((len(p), 3, 3)), r"shape \(1, 4, 3\) for one pose, got \(1, 3, 3\)"),
        (lambda p: lift(p) + np.array([0, 0, 0.1]), "vertex 0 lies 0.1 mm from the neutral; expected at most 0.001 mm"),
        (lambda p: lift(p) * np.where(np.arange(4) == 2, np.nan, 1)[:, None], "vertex 2"),
    ],
)
def test_a_function_that_is_no_rig_is_refused(function, part):
    with pytest.raises(InputError, match=part):
        check_rig(foreign(function=function))


def test_a_rig_without_display_meshes_has_none_by_the_contract():
    class Bare(Rig):
        def __call__(self, params):
            return np.zeros((0, 3), np.float32)

    assert Bare().pose_props(np.zeros(0)) == []


def test_an_altered_rig_is_the_other_one_but_for_some_fields():
    rig = foreign()
    other = AlteredRig(rig, control_points=np.array([2]), control_point_regions=("top",))
    assert isinstance(other, Rig) and (other.control_points.tolist(), other.control_point_regions) == ([2], ("top",))
    assert (other.name, other.mesh, other.controls, other.paint) == (rig.name, rig.mesh, rig.controls, None)
    np.testing.assert_array_equal(other(np.float32([0.5, 1])), rig(np.float32([0.5, 1])))
    assert other.pose_props(rig.default) == [] and isinstance(AlteredRig(PlainRig()), Rig)
