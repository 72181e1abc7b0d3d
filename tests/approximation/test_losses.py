"""Eq. 1 against hand-computed cases, against finite differences, and its compiled form against plain torch."""

import numpy as np
import pytest
import torch
from small_face import small_mesh

from replicate.approximation.losses import FacialLoss, reference_loss, unit_normals

TRIANGLE = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
FACE = torch.tensor([[0, 1, 2]], dtype=torch.int32)


def test_a_shift_costs_its_own_length_and_no_normal():
    moved = TRIANGLE + torch.tensor([0.3, -0.2, 0.1])
    assert reference_loss(moved, TRIANGLE, FACE, 5.0, 3, 1).item() == pytest.approx(0.6)


def test_a_triangle_tipped_by_a_right_angle_costs_alpha_times_two():
    tipped = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 0, 1]]])  # normal (0, −1, 0) instead of (0, 0, 1)
    vertex = 2 / 3
    assert reference_loss(tipped, TRIANGLE, FACE, 5.0, 3, 1).item() == pytest.approx(vertex + 5 * 2)
    loss = FacialLoss(TRIANGLE[0].numpy(), FACE.numpy(), 5.0, 3, 1)
    assert loss(tipped - TRIANGLE, torch.zeros(1, 3, 3)).item() == pytest.approx(vertex + 5 * 2)


def test_the_reference_gradient_agrees_with_central_differences():
    torch.manual_seed(0)
    vertices = torch.randn(1, 4, 3, dtype=torch.float64)
    target = torch.randn(1, 4, 3, dtype=torch.float64)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]], dtype=torch.int32)
    assert torch.autograd.gradcheck(
        lambda x: reference_loss(x, target, faces, 5.0, 4, 2), vertices.requires_grad_(), eps=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("batch", [1, 8, 11])
def test_the_compiled_loss_equals_its_twin_in_value_and_gradient(batch):
    mesh = small_mesh()
    generator = torch.Generator().manual_seed(3)
    offsets, target = torch.randn(2, batch, len(mesh.neutral), 3, generator=generator)
    neutral, faces = torch.from_numpy(mesh.neutral), torch.from_numpy(mesh.faces)
    counts = (len(mesh.neutral), len(mesh.faces))
    fast = offsets.clone().requires_grad_()
    value = FacialLoss(mesh.neutral, mesh.faces, 5.0, *counts)(fast, target)
    value.backward()
    clear = offsets.clone().requires_grad_()
    expected = reference_loss(neutral + clear, neutral + target, faces, 5.0, *counts)
    expected.backward()
    assert expected.item() > 0.1
    assert value.item() == pytest.approx(expected.item(), rel=1e-5)
    scale = clear.grad.abs().max()
    assert scale > 0
    torch.testing.assert_close(fast.grad / scale, clear.grad / scale, atol=1e-5, rtol=0)


def test_the_normal_term_is_there_and_scales_with_alpha():
    mesh = small_mesh()
    offsets = torch.randn(2, len(mesh.neutral), 3, generator=torch.Generator().manual_seed(1))
    values = [
        FacialLoss(mesh.neutral, mesh.faces, alpha, len(mesh.neutral), len(mesh.faces))(offsets, 0 * offsets).item()
        for alpha in (0.0, 5.0, 10.0)
    ]
    assert values[1] - values[0] > 0.5
    assert values[2] - values[1] == pytest.approx(values[1] - values[0], rel=1e-4)


def test_a_face_without_area_gives_no_nan():
    flat = TRIANGLE.clone()
    flat[0, 2] = flat[0, 1]
    assert not unit_normals(flat, FACE).any()
    x = (flat - TRIANGLE).requires_grad_()
    FacialLoss(TRIANGLE[0].numpy(), FACE.numpy(), 5.0, 3, 1)(x, torch.zeros(1, 3, 3)).backward()
    assert torch.isfinite(x.grad).all()
    posed = flat.clone().requires_grad_()
    reference_loss(posed, TRIANGLE, FACE, 5.0, 3, 1).backward()
    torch.testing.assert_close(x.grad, posed.grad)


def test_a_perfect_approximation_costs_nothing():
    mesh = small_mesh()
    offsets = torch.from_numpy(np.random.default_rng(0).normal(size=(3, len(mesh.neutral), 3)).astype(np.float32))
    assert FacialLoss(mesh.neutral, mesh.faces, 5.0, 1, 1)(offsets, offsets).item() == 0
