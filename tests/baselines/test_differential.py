"""Differential coordinates and anchors: the Laplacian of a known mesh, exact reconstruction, anchors that spread."""

import numpy as np
import pytest
import torch

from replicate.base.progress import progress
from replicate.baselines.differential import (
    AnchorNetworks,
    Reconstruction,
    choose_anchors,
    descend,
    differences,
    umbrella,
)
from replicate.config import TrainingConfig

FAN = np.int32([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])  # a pyramid without its base


def grid(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and faces of a flat square of side² vertices, 1 mm apart."""
    y, x = np.divmod(np.arange(side**2), side)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    right, up = corner + 1, corner + side
    faces = np.concatenate([np.stack([corner, right, up + 1], 1), np.stack([corner, up + 1, up], 1)])
    return np.stack([x, y, 0 * x], 1).astype(np.float32), faces.astype(np.int32)


def test_the_umbrella_of_a_pyramid_has_its_valences_and_neighbours():
    expected = [[4, -1, -1, -1, -1], [-1, 3, -1, 0, -1], [-1, -1, 3, -1, 0], [-1, 0, -1, 3, -1], [-1, -1, 0, -1, 3]]
    assert (umbrella(FAN, 5).toarray() == expected).all()
    alone = umbrella(FAN, 6).toarray()
    assert (alone[5] == 0).all() and (alone[:, 5] == 0).all()


def test_an_offset_differs_from_the_mean_of_its_neighbours():
    offsets = np.zeros((2, 6, 3), np.float32)
    offsets[0, 1:5, 2], offsets[1] = [1, 2, 3, 6], 7  # the second pose is moved as a whole
    found = differences(umbrella(FAN, 6), offsets)
    assert found[0, 0].tolist() == [0, 0, -3] and found[0, 1, 2] == pytest.approx(1 - (2 + 6) / 3)
    assert np.abs(found[1, :5]).max() < 1e-6 and (found[:, 5] == 0).all()


def test_exact_local_shape_and_anchors_give_the_offsets_back():
    rest, faces = grid(20)
    laplacian = umbrella(faces, len(rest) + 1)  # the last vertex is in no face
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(3, len(rest) + 1, 3))
    anchors = choose_anchors(np.vstack([rest, [[50, 0, 0]]]), laplacian, np.ones(len(rest) + 1), 0.02)
    assert len(rest) in anchors
    delta = (laplacian @ truth.transpose(1, 0, 2).reshape(len(truth[0]), -1)).reshape(-1, 3, 3).transpose(1, 0, 2)
    delta = delta / np.maximum(laplacian.diagonal(), 1)[:, None]
    solver = Reconstruction(laplacian, anchors)
    np.testing.assert_allclose(solver.offsets(delta, truth[:, anchors]), truth, atol=1e-6)


def test_an_anchors_share_of_a_face_is_what_solving_for_it_alone_gives():
    rest, faces = grid(9)
    solver = Reconstruction(umbrella(faces, len(rest)), np.array([3, 40, 77]))
    held = np.zeros((1, 3, 3))
    held[0, 1] = [0, 0, 2]
    alone = solver.offsets(np.zeros((1, len(rest), 3)), held)[0]
    np.testing.assert_allclose(alone[:, 2], 2 * solver.pins()[:, 1], atol=1e-5)
    np.testing.assert_allclose(solver.pins().sum(1), 1, atol=1e-4)  # all anchors together carry the whole face
    assert solver.nonzeros >= len(rest)


def test_anchors_are_denser_where_much_moves_spread_out_and_always_the_same():
    rest, faces = grid(30)
    motion = np.where(rest[:, 0] < 15, 9.0, 0.0)
    laplacian = umbrella(faces, len(rest))
    anchors = choose_anchors(rest, laplacian, motion, 0.05)
    assert len(anchors) == 45 == len(set(anchors)) and (np.diff(anchors) > 0).all()
    moving = (rest[anchors, 0] < 15).sum()
    assert 1.5 * (45 - moving) < moving < 43
    apart = np.linalg.norm(rest[anchors][:, None] - rest[anchors], axis=-1) + 99 * np.eye(45)
    assert apart.min() > 2
    assert (anchors == choose_anchors(rest, laplacian, motion, 0.05)).all()


def test_every_part_of_a_mesh_has_an_anchor_however_few_there_shall_be():
    rest, faces = grid(6)
    both, moved = np.vstack([rest, rest + 100]), np.vstack([faces, faces + len(rest)])
    anchors = choose_anchors(both, umbrella(moved, len(both)), np.zeros(len(both)), 1e-4)
    assert sorted(anchors // len(rest)) == [0, 1]


def test_an_anchor_sees_the_parameters_that_move_it_and_no_others():
    sees = np.array([[True, False, True], [False, True, False]])
    networks = AnchorNetworks(sees, (8, 8))
    networks.start(torch.Generator().manual_seed(0))
    one = networks(torch.tensor([[0.5, -1.0, 2.0]]))
    other = networks(torch.tensor([[0.5, 3.0, 2.0]]))
    assert one.shape == (1, 2, 3) and torch.equal(one[:, 0], other[:, 0]) and not torch.equal(one[:, 1], other[:, 1])
    assert networks.seen_weights() == 3 * 8 + 2 * (8 * 8 + 8 * 3)


def test_a_descent_is_that_of_torch_and_goes_on_where_it_stopped(tmp_path):
    inputs = torch.randn(16, 4, generator=torch.Generator().manual_seed(1))

    def network() -> torch.nn.Linear:
        layer = torch.nn.Linear(4, 2)
        with torch.no_grad():
            layer.weight.fill_(0.3)
            layer.bias.fill_(-0.1)
        return layer

    def loss(layer, step):
        return (layer(inputs[step % 16 :]) - inputs[step % 16 :, :2]).square().mean()

    def run(layer, steps, folder):
        schedule = TrainingConfig("paper", steps, rates=(0.1,), shares=(1.0,))
        return descend(layer, lambda step: loss(layer, step), schedule, 0.9, folder, progress, "small", lambda: (0, 0))

    reference, whole, stopped = network(), network(), network()
    optimiser = torch.optim.SGD(reference.parameters(), 0.1, momentum=0.9)
    for step in range(30):
        optimiser.zero_grad()
        loss(reference, step).backward()
        optimiser.step()
    run(whole, 30, tmp_path / "whole")
    assert torch.allclose(whole.weight, reference.weight, atol=1e-6)
    run(stopped, 12, tmp_path / "stopped")  # its checkpoint is that of a run that was killed after 12 steps
    resumed = network()
    log = run(resumed, 30, tmp_path / "stopped")
    assert torch.equal(resumed.weight, whole.weight) and log[-1]["step"] == 30
