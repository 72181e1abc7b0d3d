"""LBS that sees rig parameters: turns are rotations, bones carry what their weights say, and it learns."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from small_face import small_mesh, small_samples

from replicate.base.progress import progress
from replicate.baselines.skinning import ssdr as lbs
from replicate.baselines.skinning.bone_network import (
    BoneNetwork,
    bone_centres,
    load_driven,
    rotation_less_identity,
    save,
    train_driven,
    usual_motion,
)
from replicate.config import DrivenConfig, TrainingConfig


def two_bones() -> lbs.Skin:
    """A bar of which each half is a bone of its own, but for the middle, which both share."""
    neutral = np.stack([np.linspace(-50, 50, 11), np.linspace(0, 3, 11) ** 2, np.zeros(11)], 1).astype(np.float32)
    first = np.repeat([1.0, 0.5, 0.0], [5, 1, 5]).astype(np.float32)
    index = np.tile(np.int32([0, 1]), (11, 1))
    return lbs.Skin(neutral, index, np.stack([first, 1 - first], 1), 2)


def test_turns_are_rotations_of_row_vectors_small_ones_too():
    turns = np.random.default_rng(0).normal(size=(40, 3)) * np.logspace(-9, 0.4, 40)[:, None]
    matrices = rotation_less_identity(torch.from_numpy(turns)).numpy() + np.eye(3)
    np.testing.assert_allclose(matrices, Rotation.from_rotvec(turns).as_matrix().transpose(0, 2, 1), atol=1e-9)


def test_at_rest_the_derivative_is_finite():
    turn = torch.zeros(2, 3, requires_grad=True)
    rotation_less_identity(turn)[:, 0, 1].sum().backward()
    assert torch.isfinite(turn.grad).all() and (turn.grad != 0).any()


def test_a_bone_turns_about_its_centre_and_the_skin_follows_its_weights():
    skin = two_bones()
    network = BoneNetwork(1, skin, (4,), 0.2)
    turn, shift = np.float32([0.0, 0.0, 0.4]), np.float32([1.0, 2.0, 3.0])
    with torch.no_grad():
        network.output.weight.zero_()
        network.output.bias.zero_()
        assert not network(torch.ones(1, 1)).any()
        bias = network.output.bias.view(2, 2, 3)  # turns, then shifts
        bias[0, 1], bias[1, 1] = torch.from_numpy(turn), torch.from_numpy(shift)
        moved = network(torch.ones(1, 1))[0].numpy()
    centre = bone_centres(skin)[1]
    rotation = Rotation.from_rotvec(turn).as_matrix()
    whole = (skin.neutral - centre) @ rotation.T + centre + shift - skin.neutral
    np.testing.assert_allclose(moved, whole * skin.dense_weights()[:, 1:], atol=1e-4)
    posed = skin.neutral + moved
    usual_turn, usual_shift = usual_motion(skin, posed[None])
    np.testing.assert_allclose(usual_turn, [1e-3, 0.4], atol=2e-3)
    np.testing.assert_allclose(usual_shift, [1e-2, np.linalg.norm(shift)], rtol=2e-2, atol=1e-2)


def test_training_learns_and_a_saved_model_predicts_the_same(tmp_path):
    mesh = small_mesh()
    samples = small_samples(mesh)
    rng = np.random.default_rng(1)
    skin = lbs.fit(mesh.neutral, mesh.neutral + samples.offsets(np.arange(60)), 8, rng, iterations=10, faces=mesh.faces)
    config = DrivenConfig(hidden=(64, 64), training=TrainingConfig("one_cycle", steps=300, peak_rate=5e-3))
    model, log = train_driven(mesh, skin, samples, config, tmp_path / "scratch", progress, seed=0)
    still = np.linalg.norm(samples.validation_offsets, axis=-1).mean()
    truth = mesh.neutral + samples.validation_offsets
    oracle = np.linalg.norm(skin.deform(*lbs.refit(skin, truth)) - truth, axis=-1).mean()
    assert oracle < log[-1]["mm"] < 0.5 * still
    save(model, skin, tmp_path, config)
    params = samples.validation_params
    np.testing.assert_array_equal(load_driven(tmp_path).offsets(params), model.offsets(params))
    again, _ = train_driven(mesh, skin, samples, config, tmp_path / "again", progress, seed=0)
    np.testing.assert_array_equal(again.offsets(params), model.offsets(params))
