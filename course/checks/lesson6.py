"""Lesson 6: Eq. 1 and its balance, a network beside a straight line, gates."""

from collections.abc import Callable
from functools import cache

import numpy as np
import torch
from torch import nn

from course import lesson6
from course.checks import passed, require
from replicate.approximation.losses import reference_loss, unit_normals
from replicate.base.paths import REFERENCE
from replicate.report.pose_record import TRUTH, load_pose, pose_file

# Eq. 1.


def check_loss(loss: Callable) -> None:
    """Compare a loss with the suite's on small meshes, then on the teen."""
    generator = torch.Generator().manual_seed(1)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3], [0, 3, 4], [1, 2, 3], [2, 3, 4], [0, 1, 4], [1, 3, 4]])
    for batch, alpha in ((1, 5.0), (3, 0.7)):
        target = 10 * torch.randn(batch, 5, 3, generator=generator)
        vertices = (target + torch.randn(batch, 5, 3, generator=generator)).requires_grad_()
        before = vertices.detach().clone(), target.clone()
        value = loss(vertices, target, faces, alpha)
        _is_scalar(value)
        unchanged = torch.equal(vertices.detach(), before[0]) and torch.equal(target, before[1])
        require(unchanged, "You changed an argument in place: compute with new tensors, the batch is still needed.")
        right = reference_loss(vertices, target, faces, alpha, 5, len(faces))
        if not torch.isclose(value, right, rtol=1e-4):
            _explain(value.item(), vertices.detach(), target, faces, alpha)
        (slope,) = torch.autograd.grad(value, vertices)
        (true_slope,) = torch.autograd.grad(right, vertices)
        require(
            torch.allclose(slope, true_slope, rtol=1e-3, atol=1e-5),
            "The value is right, the gradient is not: both normals' lengths must stay in the graph, without .detach().",
        )
    _counts_faces_without_area(loss, faces)
    guess, truth, faces = _teen()
    ours, theirs = (reference_loss(guess, truth, faces, alpha, guess.shape[1], len(faces)) for alpha in (5.0, 0.0))
    value = float(loss(guess, truth, faces, 5.0))
    require(
        abs(value - float(ours)) < 1e-3 * float(ours), "On the teen your loss is not Eq. 1: do you index its faces?"
    )
    passed(
        f"your Eq. 1 equals the suite's in value and gradient; on the teen's dense networks it is {value:.3f}, of "
        f"which {float(theirs):.3f} are distances"
    )


def _is_scalar(value: object) -> None:
    require(value is not None, "Your loss returns None: end it with `return`.")
    require(
        isinstance(value, torch.Tensor), f"Expected a torch tensor, got {type(value).__name__}: no gradient passes."
    )
    require(value.ndim == 0, f"Expected one number, got the shape {tuple(value.shape)}: average over the batch, too.")
    require(value.requires_grad, "Your loss has no gradient: stay in torch, without .detach(), .item() or .numpy().")


def _explain(value: float, vertices: torch.Tensor, target: torch.Tensor, faces: torch.Tensor, alpha: float) -> None:
    """Raise Wrong with the usual mistake that gives a value, or say how far off it is."""
    (batch, n, _), f = vertices.shape, len(faces)
    apart = vertices - target
    turned = unit_normals(vertices, faces) - unit_normals(target, faces)
    long = _crosses(vertices, faces) - _crosses(target, faces)
    distance, normals = (part.abs().sum() / batch for part in (apart, turned))
    right = distance / n + alpha * normals / f
    mistakes = (
        (distance / (3 * n) + alpha * normals / (3 * f), "You average over the three coordinates: Eq. 1 adds them."),
        (batch * right, "You add up the batch: divide by its size, or α and the learning rate depend on it."),
        (distance + alpha * normals, "You add up vertices and faces: Eq. 1 divides by n and by f."),
        (apart.norm(dim=-1).sum() / batch / n + alpha * turned.norm(dim=-1).sum() / batch / f,
         "You take Euclidean lengths: |·|₁ in Eq. 1 is the sum of the three absolute values."),
        ((apart**2).sum() / batch / n + alpha * (turned**2).sum() / batch / f,
         "You take squares: |·|₁ in Eq. 1 is the sum of absolute values."),
        (distance / n + alpha * long.abs().sum() / batch / f,
         "Your normals have the lengths of their cross products: divide each by its length before you compare."),
        (alpha * distance / n + normals / f, "Your α is at the distances: it weighs the normals."),
        (distance / n + normals / f, "Your α does nothing: multiply the normals' term by it."),
        (distance / n + alpha * normals / n, "You divide both terms by n: the normals' has f faces."),
        (distance / n, "The normals are missing: are yours the same for both meshes?"),
    )  # fmt: skip
    require(np.isfinite(value), "Your loss is not a finite number on a plain mesh: what do you divide by?")
    for wrong, sentence in mistakes:
        require(abs(value - float(wrong)) > 1e-3 * abs(float(wrong)), sentence)
    require(False, f"On {batch} poses of a small mesh Eq. 1 is {float(right):.4f}, yours {value:.4f}: print each term.")


def _crosses(vertices: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    a, b, c = (vertices[:, faces[:, k]] for k in range(3))
    return torch.linalg.cross(b - a, c - a)


def _counts_faces_without_area(loss: Callable, faces: torch.Tensor) -> None:
    generator = torch.Generator().manual_seed(2)
    target = torch.randn(2, 5, 3, generator=generator)
    vertices = target.clone()
    vertices[:, 1] = vertices[:, 0] + 1
    vertices[:, 4] = vertices[:, 1]  # faces with both corners have no area
    vertices.requires_grad_()
    value, right = (each(vertices, target, faces, 5.0) for each in (loss, _reference))
    (slope,), (true_slope,) = (torch.autograd.grad(each, vertices) for each in (value, right))
    require(
        torch.isfinite(value) and torch.isfinite(slope).all(),
        "A face without area makes your loss or its gradient NaN, and one is enough to ruin all weights: replace its "
        "squared length by 1 before the root and the division (torch.where), and its normal by 0 after it.",
    )
    require(
        torch.isclose(value, right, rtol=1e-4),
        f"With faces without area Eq. 1 is {right.item():.4f}, yours {value.item():.4f}: give them the normal 0 and, "
        "unlike lesson 4, count them in f.",
    )
    require(
        torch.allclose(slope, true_slope, rtol=1e-3, atol=1e-5),
        f"At a face without area your gradient reaches {float(slope.abs().max()):.0e}, the suite's "
        f"{float(true_slope.abs().max()):.2g}: a tiny divisor, as in normalize, has a huge slope; use "
        "torch.where twice.",
    )


# Its balance.


def check_units(alpha_in_mm: Callable) -> None:
    """Compare the α of Eq. 1 in mm with known cases, and the gradients of both losses on the teen."""
    first = alpha_in_mm(1.0, 5.0, 1.0)
    require(first is not None, "alpha_in_mm returns None: end it with `return`.")
    require(
        np.isclose(first, 5.0), f"In mm, with weights 1 and 5, nothing is to be converted: expected 5, got {first}."
    )
    metres = alpha_in_mm(1.0, 5.0, 1000.0)
    sentence = (
        "The wrong way round: in metres distances are 1000 times smaller, so 5 weighs the normals 1000 times more."
    )
    require(not np.isclose(metres, 0.005), sentence)
    require(np.isclose(metres, 5000.0), f"With weights 1 and 5 and metres expected α = 5000 for mm, got {metres}.")
    ten = alpha_in_mm(10.0, 5.0, 1.0)
    sentence = f"If distances count ten times, α is a tenth: with weights 10 and 5 in mm expected 0.5, got {ten}."
    require(np.isclose(ten, 0.5), sentence)
    released = alpha_in_mm(10.0, 50.0 / 3, 450.0)
    require(np.isclose(released, 750.0), f"For the released code's weights and its unit expected 750, got {released}.")
    passed(
        f"same gradients up to a factor on the teen (cosine {_cosine(released):.6f}); the normals' share of the loss "
        f"of its dense networks is {_share(5.0):.0%} with the paper's 5, {_share(released):.0%} with the released "
        f"{released:g}, {_share(metres):.1%} if positions are in metres"
    )


@cache
def _teen() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    record = load_pose(pose_file(REFERENCE, "teen"))
    guess, truth = (torch.from_numpy(record.vertices[name])[None].double() for name in ("dense", TRUTH))
    return guess, truth, torch.from_numpy(record.faces.astype(np.int64))


def _teens_loss(guess: torch.Tensor, alpha: float) -> torch.Tensor:
    _, truth, faces = _teen()
    return reference_loss(guess, truth, faces, alpha, guess.shape[1], len(faces))


def _share(alpha: float) -> float:
    guess = _teen()[0]
    return 1 - float(_teens_loss(guess, 0.0) / _teens_loss(guess, alpha))


def _cosine(alpha: float) -> float:
    """Return the cosine between gradients of Eq. 1 in mm and of the released code's loss in units of 450 mm."""
    guess = _teen()[0].clone().requires_grad_()
    _, truth, faces = _teen()
    ours = _teens_loss(guess, alpha)
    unit, counts = 450.0, (guess.shape[1], len(faces))
    distance = reference_loss(guess / unit, truth / unit, faces, 0.0, *counts)
    both = reference_loss(guess / unit, truth / unit, faces, 1.0, *counts)
    theirs = 10 * distance + 50 / 3 * (both - distance)
    slopes = [torch.autograd.grad(value, guess)[0].flatten() for value in (ours, theirs)]
    return float(nn.functional.cosine_similarity(*slopes, dim=0))


# A network beside a line.


class _Ones(nn.Module):
    """A network that gives the same number everywhere, through a weight."""

    def __init__(self, vertices: int, value: float):
        super().__init__()
        self.vertices, self.value = vertices, nn.Parameter(torch.tensor(value))

    def forward(self, params: torch.Tensor) -> torch.Tensor:
        return self.value * torch.ones(len(params), self.vertices, 3)


def check_beside(make: Callable, steps: int = 200) -> None:
    """Look at a model of network and line, then train it and the network alone by the same steps.

    make: (network, weights, params, offsets) → the model. steps: of both trainings.
    """
    face = lesson6.tiny_face()
    weights, line = lesson6.ridge_line(face, face.params[:1])
    sizes = len(face.neutral), 3
    still = make(_Ones(sizes[0], 0.0), weights, face.params, face.offsets)
    require(isinstance(still, nn.Module), f"Expected a torch module, got {type(still).__name__}.")
    got = still(torch.from_numpy(face.params[:1]))
    require(got is not None, "forward returns None: end it with `return`.")
    require(got.shape == (1, *sizes), f"Expected offsets of the shape (1, {sizes[0]}, 3), got {tuple(got.shape)}.")
    require(
        got.dtype == torch.float32, f"Expected float32 as the network has, got {got.dtype}: convert the line's weights."
    )
    got, rest = got.detach().numpy(), weights[-1].reshape(1, *sizes)
    require(
        not np.allclose(got, line - rest, atol=1e-3), "The line's constant is missing: it is the last row of weights."
    )
    require(np.abs(got).max() > 0, "With a network that gives 0, yours gives 0: where is the line?")
    require(
        np.allclose(got, line, atol=1e-3), "With a network that gives 0, yours must be the line, in mm and unscaled."
    )
    saved = sum(value.numel() for value in still.state_dict().values())
    require(
        saved > weights.size,
        "The line's weights are a plain attribute: they would be missing in a saved model; use self.register_buffer.",
    )
    model = make(_Ones(sizes[0], 1.0), weights, face.params, face.offsets)
    trained = [weight for weight in model.parameters() if weight.requires_grad]
    require(trained, "Nothing in your model can be trained: keep the network as an attribute, as self.network.")
    require(
        sum(weight.numel() for weight in trained) == 1,
        "The line's weights are trained, too: keep them as a buffer, by self.register_buffer, so they stay ridge's.",
    )
    given = model(torch.from_numpy(face.params[:1]))
    require(
        not np.allclose(given.detach().numpy(), line, atol=1e-4),
        "Your model gives the line alone: does forward add the network, times its unit?",
    )
    sentence = "No gradient reaches the network: leave out .detach() and torch.no_grad()."
    require(given.requires_grad, sentence)
    unit = float((given.detach().numpy() - line).mean())
    left = lesson6.rms(face.offsets - lesson6.ridge_line(face, face.params)[1])
    whole = lesson6.rms(face.offsets)
    require(
        abs(unit - whole) > 1e-3, f"Your unit is the RMS of all offsets, {whole:.2f} mm: take that of what is left."
    )
    require(abs(unit - 1) > 1e-3, "Your network gives mm as it is: multiply it by the RMS of what the line leaves.")
    require(
        abs(unit - left) < 1e-2 * left,
        f"Expected the unit {left:.3f} mm, the RMS of what the line leaves, got {unit:.3f}.",
    )
    ridge = lesson6.errors(face, lesson6.ridge_line(face, face.test_params)[1])
    alone = _trained_alone(steps)
    model = make(lesson6.small_network(face), weights, face.params, face.offsets)
    both = lesson6.train(model, face, _reference, steps, every=steps)[-1][1:]
    for k, unit_name in enumerate((" mm", "°")):
        for other, name in ((ridge, "the line"), (alone, "the network alone")):
            sentence = (
                f"After {steps} steps your model has {both[k]:.2f}{unit_name} and {name} {other[k]:.2f}{unit_name}"
            )
            require(both[k] < other[k], f"{sentence}: does the network add to the line in forward?")
    passed(
        f"after {steps} steps: line {ridge[0]:.2f} mm, {ridge[1]:.2f}°; network {alone[0]:.2f} mm, {alone[1]:.2f}°; "
        f"both {both[0]:.2f} mm, {both[1]:.2f}°, below either"
    )


def _reference(vertices: torch.Tensor, target: torch.Tensor, faces: torch.Tensor, alpha: float) -> torch.Tensor:
    return reference_loss(vertices, target, faces, alpha, vertices.shape[1], len(faces))


@cache
def _trained_alone(steps: int) -> tuple[float, float]:
    face = lesson6.tiny_face()
    model = lesson6.Alone(lesson6.small_network(face), lesson6.rms(face.offsets))
    return lesson6.train(model, face, _reference, steps, every=steps)[-1][1:]


# Gates.


def check_gate(gated: Callable, product_gates: Callable) -> None:
    """Compare a gated layer with the suite's, and two gates with a product."""
    from replicate.regional.networks import GatedNetwork

    generator = torch.Generator().manual_seed(3)
    x = 2 * torch.rand(6, 4, generator=generator) - 1
    gate, value = (torch.randn(4, 5, generator=generator) for _ in range(2))
    shift, constant = (torch.randn(5, generator=generator) for _ in range(2))
    network = GatedNetwork(4, (5,), 5, line=False)
    with torch.no_grad():
        network.layers[0].weight.copy_(torch.cat([gate.T, value.T]))
        network.layers[0].bias.copy_(torch.cat([shift, constant]))
        network.output.weight.copy_(torch.eye(5))
        network.output.bias.zero_()
        right = network(x)
    got = gated(x, gate, shift, value, constant)
    require(got is not None, "gated returns None: end it with `return`.")
    require(got.shape == right.shape, f"Expected {tuple(right.shape)}, a row a pose, got {tuple(got.shape)}.")
    a, b = x @ gate + shift, x @ value + constant
    silu = nn.functional.silu
    for wrong, sentence in (
        (torch.sigmoid(a) * b, "Yours has a sigmoid: silu(a) is a · sigmoid(a)."),
        (a * silu(b), "You have gate and value the wrong way round: silu is for U and d."),
        (silu(a) * silu(b), "Only one of the two maps goes through silu."),
        (silu(a) + b, "Your layer adds the two maps: it multiplies them."),
        (silu(x @ gate) * (x @ value), "The constants d and c are missing."),
        (a * b, "silu is missing: without it a layer is a polynomial of degree 2, and two layers one of degree 4."),
    ):
        require(not torch.allclose(got, wrong, atol=1e-5), sentence)
    require(
        torch.allclose(got, right, atol=1e-5), "Your layer is not the suite's: print its two maps one after the other."
    )
    answer = product_gates()
    require(
        isinstance(answer, tuple) and len(answer) == 3, "product_gates: expected a tuple of three tensors, U, V and w."
    )
    first, second, weights = (torch.as_tensor(part, dtype=torch.float32) for part in answer)
    shapes = tuple(first.shape), tuple(second.shape), tuple(weights.shape)
    require(shapes == ((2, 2), (2, 2), (2,)), f"Expected the shapes (2, 2), (2, 2) and (2,), got {shapes}.")
    pairs = 6 * torch.rand(500, 2, generator=generator) - 3
    zero = torch.zeros(2)
    product = gated(pairs, first, zero, second, zero) @ weights
    off = (product - pairs.prod(1)).abs()
    in_first = off[(pairs > 0).all(1)].max()
    require(
        in_first > 1e-4 or off.max() < 1e-4,
        "Right for positive x and y only: a second gate with −x has to give what the first one lacks.",
    )
    require(off.max() < 1e-4, f"Your gates miss x·y by up to {off.max():.2f}: silu(a) − silu(−a) = a helps.")
    passed(f"your layer equals the suite's, and two gates multiply numbers from −3 to 3 to within {off.max():.0e}")
