"""A skin as a row: its size and the multiplications of its blend, from what is stored."""

import numpy as np
from small_face import small_mesh

from replicate.baselines.skinning.ssdr import Skin
from replicate.methods import skinned


def test_a_skin_says_its_size_and_the_work_of_its_blend(tmp_path):
    weights = np.float32([[0.5, 0.5], [1.0, 0.0], [0.25, 0.75]])
    Skin(np.zeros((3, 3), np.float32), np.int32([[0, 1], [1, 0], [0, 1]]), weights, 2).save(tmp_path / skinned.FILE)
    inputs = {"lbs2": tmp_path, "lbs2-teen": tmp_path, "rig": tmp_path / "rig"}
    assert skinned.facts(inputs, small_mesh()) == [("model_size", "MB", 8 * 6 / 1e6)]
    assert skinned.multiplications(inputs, skinned.RefitSettings(2, 1, 0.0)) == 12 * 5
