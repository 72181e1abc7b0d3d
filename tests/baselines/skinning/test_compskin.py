"""Compressed skinning: linearised bones are matched, limits hold after each step, and weights sum to 1."""

import numpy as np
import pytest
import torch

from replicate.baselines.differential import umbrella
from replicate.baselines.skinning.compskin import (
    MM,
    CompressedNetwork,
    CompressedShapes,
    Limits,
    compress,
    first_bones,
    first_motions,
    keep_largest,
    matrices,
    project_weights,
    weighted_rest,
)

SIDE, BONES, SHAPES = 12, 3, 5


def sheet() -> tuple[np.ndarray, np.ndarray]:
    """Return a bent sheet of 60 mm and its faces."""
    y, x = np.divmod(np.arange(SIDE**2), SIDE)
    rest = np.stack([x, y, np.cos(x)], 1) * 60 / SIDE
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    faces = [
        np.stack([corner, corner + 1, corner + SIDE + 1], 1),
        np.stack([corner, corner + SIDE + 1, corner + SIDE], 1),
    ]
    return rest.astype(np.float32), np.concatenate(faces).astype(np.int32)


def known_skin() -> tuple[CompressedShapes, np.ndarray]:
    """Return a skin of random motions, and the offsets (s, n, 3) in mm that its bones give by ω × (v − c) + t."""
    rest, _ = sheet()
    rng = np.random.default_rng(0)
    centres = rest[[20, 70, 130]] / MM
    weights = np.exp(-(np.linalg.norm(rest[:, None] / MM - centres, axis=-1) ** 2))
    weights = (weights / weights.sum(1, keepdims=True)).astype(np.float32)
    motions = rng.normal(size=(SHAPES, BONES, 6)).astype(np.float32) * [0.1, 0.1, 0.1, 0.3, 0.3, 0.3]
    turns, shifts = motions[:, :, None, :3], motions[:, :, None, 3:]
    moved = np.cross(np.broadcast_to(turns, (SHAPES, BONES, len(rest), 3)), (rest / MM - centres[:, None])) + shifts
    offsets = MM * np.einsum("nb,sbnk->snk", weights, moved)
    return CompressedShapes(weights, motions.astype(np.float32), centres.astype(np.float32)), offsets


def coefficients_only(count: int) -> CompressedNetwork:
    """Return a network whose coefficients are its inputs."""
    network = CompressedNetwork(count, (count,), 1.0, count + 1, BONES, SIDE**2)
    with torch.no_grad():
        for layer in (network.hidden[0], network.output):
            layer.weight.copy_(torch.eye(count))
            layer.bias.zero_()
    return network


def test_a_skin_gives_what_its_bones_turn_and_shift():
    skin, offsets = known_skin()
    network = coefficients_only(SHAPES - 1)
    network.skin(skin, sheet()[0])
    with torch.no_grad():
        found = network(torch.tensor([[0.0, 0, 0, 0], [0, 2, 0, -1]])).numpy()
    np.testing.assert_allclose(found[0], offsets[4], atol=1e-4)
    np.testing.assert_allclose(found[1], offsets[4] + 2 * offsets[1] - offsets[3], atol=1e-4)
    assert (network.numbers(), network.weights()) == (SHAPES * BONES * 6, SIDE**2 * BONES)


def test_motions_of_known_bones_are_found_by_least_squares(monkeypatch):
    skin, offsets = known_skin()
    monkeypatch.setattr("replicate.baselines.skinning.compskin.STIFF", 0.0)
    z = weighted_rest(*map(torch.from_numpy, (skin.weights, sheet()[0] / MM, skin.centres)))
    goal = torch.from_numpy(offsets.transpose(1, 0, 2).astype(np.float32) / MM).flatten(1)
    found = first_motions(z, goal)
    np.testing.assert_allclose(found.numpy(), skin.motions, atol=1e-4)
    again = z @ matrices(found).flatten(1, 2).transpose(0, 1).flatten(1)
    np.testing.assert_allclose(again.numpy(), goal.numpy(), atol=1e-5)


def test_shapes_that_are_linearised_bones_are_matched_and_limits_hold_after_each_step():
    _, offsets = known_skin()
    rest, faces = sheet()
    limits, seen = Limits(weights=2, numbers=60, smoothness=0.0, steps=200, rate=1e-2), []

    def watch(weights, motions):
        kept = (weights > 0).sum(1).max() <= 2 and (weights >= 0).all() and motions.count_nonzero() <= 60
        total = weights.sum(1)
        seen.append((bool(kept), bool(len(seen) < 200 or ((total - 1).abs() < 1e-5).all())))

    skin = compress(rest, umbrella(faces, len(rest)), offsets, BONES, limits, 0, watch=watch)
    assert len(seen) == 400 and all(map(all, seen))
    np.testing.assert_allclose(skin.weights.sum(1), 1, atol=1e-5)
    network = coefficients_only(SHAPES - 1)
    network.skin(skin, rest)
    with torch.no_grad():
        found = network(torch.zeros(1, SHAPES - 1)).numpy()[0]
    assert np.abs(found - offsets[-1]).mean() < 0.5 * np.abs(offsets[-1]).mean()
    free = Limits(weights=BONES, numbers=SHAPES * BONES * 6, smoothness=0.0, steps=400, rate=3e-3)
    network.skin(compress(rest, umbrella(faces, len(rest)), offsets, BONES, free, 0), rest)
    with torch.no_grad():
        found = network(torch.zeros(1, SHAPES - 1)).numpy()[0]
    assert np.abs(found - offsets[-1]).mean() < 0.05 * np.abs(offsets[-1]).mean()


def test_smoothing_flattens_what_is_rough():
    rest, faces = sheet()
    _, offsets = known_skin()
    laplacian = umbrella(faces, len(rest))

    def roughness(smoothness: float) -> float:
        limits = Limits(BONES, SHAPES * BONES * 6, smoothness, 100, 1e-2)
        network = coefficients_only(SHAPES - 1)
        network.skin(compress(rest, laplacian, offsets, BONES, limits, 0), rest)
        with torch.no_grad():
            moved = network(torch.zeros(1, SHAPES - 1)).numpy()[0]
        return float(np.square(laplacian @ moved).mean())

    assert roughness(100.0) < 0.7 * roughness(0.0)


def test_first_weights_are_few_and_fall_to_zero_without_a_step():
    rest = np.stack([np.linspace(0, 9, 400), np.zeros(400), np.zeros(400)], 1).astype(np.float32)
    weights, centres = first_bones(rest, np.where(rest[:, 0] < 3, 5.0, 0.5), 10, 3, 0)
    assert (weights > 0).sum(1).max() <= 3 and np.abs(np.diff(weights, axis=0)).max() < 0.1
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-5)
    assert (centres[:, 0] < 3).sum() >= 4  # of ten, on a third of the line


def test_the_largest_numbers_stay_and_the_largest_weights_of_each_vertex():
    values = torch.tensor([[1.0, -5.0, 2.0], [0.5, 3.0, -0.1]])
    keep_largest(values, 3)
    assert values.tolist() == [[0, -5, 2], [0, 3, 0]]
    weights = torch.tensor([[0.2, 0.6, -1.0, 0.4], [0.0, -0.5, 0.0, -2.0]])
    project_weights(weights, 2, normalised=False)
    assert weights.tolist() == [[0, pytest.approx(0.6), 0, pytest.approx(0.4)], [0, 0, 0, 0]]
    project_weights(weights, 1, normalised=True)
    assert weights.tolist() == [[0, 1, 0, 0], [0, 0, 0, 0]]
