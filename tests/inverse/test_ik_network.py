"""The IK model: regions don't reach into each other, shared parameters are means, others keep their defaults."""

import numpy as np
import pytest
import torch

from replicate.base.exceptions import InputError
from replicate.inverse.control_points import Region
from replicate.inverse.ik_network import IkModel, load_ik, save_ik

EYE = Region("eye", np.array([0, 1]), np.array([0, 1, 4]))
MOUTH = Region("mouth", np.array([2, 3, 4]), np.array([2, 3, 4]))
DEFAULT = np.array([0, 0.1, 0, 0, 0.2, 0.7], np.float32)


def ik_model(axes=2):
    torch.manual_seed(0)
    neutral = np.random.default_rng(0).normal(size=(5, 3)) * 50
    return IkModel((EYE, MOUTH), (16, 16), 0.2, neutral, np.full((5, axes), 3.0), DEFAULT, np.full(6, 2.0)).eval()


def test_an_eyes_point_moves_no_parameter_that_only_the_mouth_drives():
    model = ik_model()
    points = model.neutral.numpy()[None].repeat(2, 0)
    points[1, 0] += (4, -3, 0)
    rest, moved = model.solve(points)
    np.testing.assert_array_equal(rest[[2, 3, 5]], moved[[2, 3, 5]])
    assert (rest[[0, 1, 4]] != moved[[0, 1, 4]]).all()


def test_a_parameter_that_no_region_drives_keeps_its_default():
    points = np.random.default_rng(1).normal(size=(3, 5, 3)) * 100
    assert (ik_model().solve(points)[:, 5] == DEFAULT[5]).all()


def test_a_shared_parameter_is_the_mean_of_what_its_regions_say():
    model = ik_model()
    points = model.neutral.numpy()[None] + np.float32(5)
    moves = ((torch.from_numpy(points) - model.neutral)[..., :2] / model.spread).flatten(1)
    with torch.no_grad():
        eye, mouth = model.networks[0](moves[:, :4])[0, 2], model.networks[1](moves[:, 4:])[0, 2]
    assert model.solve(points)[0, 4] == pytest.approx(DEFAULT[4] + 2.0 * float(eye + mouth) / 2, abs=1e-5)


def test_depth_counts_in_space_and_not_in_the_image_plane():
    for axes in (2, 3):
        model = ik_model(axes)
        points = model.neutral.numpy()[None].repeat(2, 0)
        points[1, :, 2] += 5
        rest, moved = model.solve(points)
        assert np.array_equal(rest, moved) == (axes == 2)


def test_a_model_that_is_written_reads_the_same(tmp_path):
    model, points = ik_model(), np.random.default_rng(2).normal(size=(3, 5, 3)) * 40
    save_ik(model, tmp_path)
    np.testing.assert_array_equal(load_ik(tmp_path).solve(points), model.solve(points))
    (tmp_path / "model.json").write_text("{}")
    with pytest.raises(InputError, match="no readable IK model"):
        load_ik(tmp_path)
