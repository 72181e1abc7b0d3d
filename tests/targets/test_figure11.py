"""Figure 11: its words say how many control points are dragged."""

import numpy as np

from replicate.targets.figure11 import dragged_points


def test_one_number_of_dragged_points_is_said_once_and_two_as_a_range():
    assert dragged_points(np.array([5, 5, 5]), 22) == "5 of the 22 points are dragged"
    assert dragged_points(np.array([4, 5, 3]), 22) == "From 3 to 5 of the 22 points are dragged"
    assert dragged_points(np.array([1, 1]), 22) == "1 of the 22 points is dragged"
