"""Lesson 6's checks: they accept the solution, and say of usual mistakes what is wrong."""

import json
import re

import numpy as np
import pytest
import torch
from lesson_source import answers
from torch import nn

from course import lesson6, lesson6_pictures
from course.checks import Wrong
from course.checks.lesson6 import _trained_alone as trained_alone
from course.checks.lesson6 import check_beside, check_gate, check_loss, check_units
from replicate.approximation.losses import reference_loss, unit_normals
from replicate.base.paths import REFERENCE, ROOT

SOLVED = answers("lesson6")
normalize = nn.functional.normalize


def normals(positions, faces, unit=True):
    a, b, c = (positions[:, faces[:, k]] for k in range(3))
    cross = torch.linalg.cross(b - a, c - a)
    return normalize(cross, dim=-1) if unit else cross


def terms(vertices, target, faces, unit=True):
    turned = normals(vertices, faces, unit) - normals(target, faces, unit)
    return (vertices - target).abs().sum(-1).mean(), turned.abs().sum(-1).mean()


def right(vertices, target, faces, alpha):
    return reference_loss(vertices, target, faces, alpha, vertices.shape[1], len(faces))


def by_plain_division(vertices, target, faces, alpha):
    def unit(positions):
        cross = normals(positions, faces, unit=False)
        return cross / cross.norm(dim=-1, keepdim=True)

    distance, _ = terms(vertices, target, faces)
    return distance + alpha * (unit(vertices) - unit(target)).abs().sum(-1).mean()


def leaving_out_empty_faces(vertices, target, faces, alpha):
    distance, _ = terms(vertices, target, faces)
    turned = (unit_normals(vertices, faces) - unit_normals(target, faces)).abs().sum(-1)
    full = normals(vertices, faces, unit=False).detach().abs().sum(-1) > 0
    return distance + alpha * turned[full].mean()


def with_normalize(vertices, target, faces, alpha):
    distance, turned = terms(vertices, target, faces)
    return distance + alpha * turned


def in_place(vertices, target, faces, alpha):
    value = right(vertices, target, faces, alpha)
    target += 1
    return value


def averaged_over_coordinates(vertices, target, faces, alpha):
    turned = unit_normals(vertices, faces) - unit_normals(target, faces)
    return (vertices - target).abs().mean() + alpha * turned.abs().mean()


def euclidean(vertices, target, faces, alpha):
    turned = unit_normals(vertices, faces) - unit_normals(target, faces)
    return (vertices - target).norm(dim=-1).mean() + alpha * turned.norm(dim=-1).mean()


def with_long_normals(vertices, target, faces, alpha):
    distance, turned = terms(vertices, target, faces, unit=False)
    return distance + alpha * turned


def weighing_distances(vertices, target, faces, alpha):
    distance, turned = terms(vertices, target, faces)
    return alpha * distance + turned


@pytest.fixture(scope="module")
def made_up():
    """A bumpy sheet of 36 vertices that moves by sums and products of 5 controls: quicker than a rig."""
    rng = np.random.default_rng(0)
    side = np.arange(6)
    points = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    neutral = np.concatenate([10 * points, rng.normal(size=(36, 1))], 1).astype(np.float32)
    corners = (points[:, 0] + 6 * points[:, 1]).reshape(6, 6)
    a, b, c, d = (corners[i : 5 + i, j : 5 + j].ravel() for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    faces = np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)]).astype(np.int32)
    line, products = rng.normal(size=(5, 36, 3)), rng.normal(size=(5, 5, 36, 3))

    def moved(count):
        params = rng.random((count, 5)).astype(np.float32)
        offsets = np.einsum("bi,inc->bnc", params, line) + np.einsum("bi,bj,ijnc->bnc", params, params, products)
        return params, offsets.astype(np.float32)

    return lesson6.Face(None, neutral, faces, np.ones(5, np.float32), *moved(500), *moved(50))


@pytest.fixture
def on_sheet(made_up, monkeypatch):
    monkeypatch.setattr(lesson6, "tiny_face", lambda: made_up)
    trained_alone.cache_clear()
    yield
    trained_alone.cache_clear()


def test_the_solved_loss_passes(capsys):
    check_loss(SOLVED["loss"])
    assert "equals the suite's" in capsys.readouterr().out


def test_the_suites_own_loss_passes():
    check_loss(lambda v, t, f, alpha: reference_loss(v, t, f, alpha, v.shape[1], len(f)))


@pytest.mark.parametrize(
    ("loss", "sentence"),
    [
        (lambda *_: None, "returns None"),
        (lambda *given: right(*given).item(), "got float"),
        (lambda *given: right(*given).detach(), "no gradient"),
        (lambda v, t, f, a: (v - t).abs().sum(-1), "one number"),
        (lambda v, t, f, a: len(v) * right(v, t, f, a) if len(v) > 1 else right(v, t, f, a), "add up the batch"),
        (averaged_over_coordinates, "over the three coordinates"),
        (euclidean, "Euclidean"),
        (with_long_normals, "lengths of their cross products"),
        (weighing_distances, "α is at the distances"),
        (lambda v, t, f, a: terms(v, t, f)[0], "normals are missing"),
        (lambda v, t, f, a: right(v, t, f, a) + 0.1, "yours"),
        (in_place, "in place"),
        (by_plain_division, "without area"),
        (leaving_out_empty_faces, "unlike lesson 4"),
        (with_normalize, "a tiny divisor"),
    ],
)
def test_a_wrong_loss_is_told_why(loss, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_loss(loss)


@pytest.mark.usefixtures("on_sheet")
def test_a_missing_answer_says_so_itself():
    def nothing(*_):
        raise NotImplementedError

    for check in (check_loss, check_units, check_beside):
        with pytest.raises(NotImplementedError):
            check(nothing)


@pytest.mark.usefixtures("on_sheet")
def test_curves_bear_any_names_and_training_takes_its_rate_as_an_argument(made_up):
    logs = {}
    for rate in (0.005, 0.02):
        model = lesson6.Alone(lesson6.small_network(made_up), lesson6.rms(made_up.offsets))
        logs[f"rate {rate}"] = lesson6.train(model, made_up, right, steps=8, every=8, rate=rate)
    assert logs["rate 0.005"][0] == logs["rate 0.02"][0] and logs["rate 0.005"][-1] != logs["rate 0.02"][-1]
    _, words = lesson6_pictures.curves((1.0, 1.0), logs)
    assert "over 8 steps" in words.alt


def test_the_line_and_a_network_are_compared_pose_by_pose(made_up):
    truth = made_up.test_offsets
    assert "on 100% in mm, on 100% in degrees" in lesson6.wins(made_up, truth, 0 * truth)


def test_the_solved_balance_passes(capsys):
    check_units(SOLVED["alpha_in_mm"])
    assert "750" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("alpha_in_mm", "sentence"),
    [
        (lambda d, n, u: None, "returns None"),
        (lambda d, n, u: n / d / u, "wrong way round"),
        (lambda d, n, u: n * u, "expected 0.5"),
        (lambda d, n, u: d * n * u, "expected 0.5"),
        (lambda d, n, u: d / n, "expected 5"),
    ],
)
def test_a_wrong_balance_is_told_why(alpha_in_mm, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_units(alpha_in_mm)


@pytest.mark.usefixtures("on_sheet")
def test_the_solved_model_beats_the_line_and_the_network(capsys):
    check_beside(SOLVED["BesideLine"], steps=300)
    assert "below either" in capsys.readouterr().out


def changed(**parts):
    """Return the solution's class with other methods."""
    return type("Changed", (SOLVED["BesideLine"],), parts)


class Trainable(SOLVED["BesideLine"]):
    def __init__(self, *given):
        super().__init__(*given)
        weights = self.weights
        del self.weights
        self.weights = nn.Parameter(weights)


class Plain(SOLVED["BesideLine"]):
    def __init__(self, *given):
        super().__init__(*given)
        weights = self.weights
        del self.weights
        self.weights = weights.clone()


class WholeUnit(SOLVED["BesideLine"]):
    def __init__(self, network, weights, params, offsets):
        super().__init__(network, weights, params, offsets)
        self.unit_mm = float(np.sqrt(np.square(offsets, dtype=np.float64).mean()))


@pytest.mark.usefixtures("on_sheet")
@pytest.mark.parametrize(
    ("model", "sentence"),
    [
        (Trainable, "trained, too"),
        (Plain, "plain attribute"),
        (changed(forward=lambda self, p: self.line(p)), "does forward add the network"),
        (WholeUnit, "RMS of all offsets"),
        (changed(forward=lambda self, p: self.line(p) + self.network(p)), "gives mm as it is"),
        (changed(forward=lambda self, p: self.unit_mm * self.network(p)), "where is the line"),
        (changed(forward=lambda self, p: self.unit_mm * (self.line(p) + self.network(p))), "unscaled"),
        (changed(line=lambda self, p: (p @ self.weights[:-1]).unflatten(1, (-1, 3))), "constant is missing"),
        (changed(forward=lambda self, p: None), "returns None"),
        (changed(forward=lambda self, p: self.line(p).double()), "float32"),
        (changed(forward=lambda self, p: self.line(p).flatten(1)), "shape"),
        (changed(forward=lambda self, p: self.line(p) + self.unit_mm * self.network(p).detach()), "detach"),
    ],
)
def test_a_wrong_model_is_told_why(model, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_beside(model, steps=40)


def test_the_solved_gates_pass(capsys):
    check_gate(SOLVED["gated"], SOLVED["product_gates"])
    assert "multiply" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("gated", "sentence"),
    [
        (lambda x, U, d, V, c: None, "returns None"),
        (lambda x, U, d, V, c: torch.sigmoid(x @ U + d) * (x @ V + c), "sigmoid"),
        (lambda x, U, d, V, c: nn.functional.silu(x @ V + c) * (x @ U + d), "wrong way round"),
        (lambda x, U, d, V, c: nn.functional.silu(x @ U + d) + (x @ V + c), "adds"),
        (lambda x, U, d, V, c: nn.functional.silu(x @ U) * (x @ V), "constants"),
        (lambda x, U, d, V, c: (nn.functional.silu(x @ U + d) * (x @ V + c)).sum(1), "a row a pose"),
    ],
)
def test_a_wrong_gate_is_told_why(gated, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_gate(gated, SOLVED["product_gates"])


ONE, TWO = torch.eye(2), torch.ones(2)


@pytest.mark.parametrize(
    ("gates", "sentence"),
    [
        ((ONE, ONE, TWO), "miss"),
        ((torch.tensor([[1.0, 0.0], [0.0, 0.0]]), torch.tensor([[0.0, 0.0], [1.0, 0.0]]), TWO), "miss"),
        ((ONE[0], ONE, TWO), "shapes"),
        (ONE, "tuple of three"),
    ],
)
def test_wrong_weights_of_gates_are_told_why(gates, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_gate(SOLVED["gated"], lambda: gates)


def test_the_picture_has_all_approximations_that_the_text_speaks_of():
    name = re.search(
        r"figure10_\w+", (ROOT / "course" / "lessons" / "lesson6_what_networks_must_learn.py").read_text("utf-8")
    )[0]
    words = json.loads((REFERENCE / f"{name}.json").read_text("utf-8"))["alt"]
    for shown in ("Refined ", "Dense ", "LBS: 32 bones ", "Regional (ours) ", "Linear "):
        assert shown in words
