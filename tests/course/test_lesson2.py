"""Lesson 2's checks: they accept the solutions, and say what is wrong with usual mistakes."""

import numpy as np
import pytest
from lesson_source import answers

from course.checks import Wrong
from course.checks.lesson2 import check_basis, check_pca, check_ridge
from course.lesson2 import Poses
from replicate.geometry.mesh import Mesh
from replicate.regional.basis import apply_metric, loss_metric

SOLVED = answers("lesson2")
pca, ridge_line, basis_in = (SOLVED[name] for name in ("pca", "ridge_line", "basis_in"))
SIDE = 8  # of a square patch of vertices


@pytest.fixture(scope="module")
def poses():
    """A patch of skin that moves in smooth waves, by a line and a product of its controls."""
    generator = np.random.default_rng(7)
    x, y = (part.ravel() for part in np.meshgrid(np.arange(SIDE), np.arange(SIDE)))
    corner = (x + SIDE * y).reshape(SIDE, SIDE)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    flat = np.stack([10 * x, 10 * y, 0 * x], 1).astype(np.float32)
    mesh = Mesh(flat, faces.astype(np.int32), flat[:, :2] / 70, np.zeros(len(flat), np.int32), ("patch",))
    inputs = generator.uniform(-1, 1, (120, 6))
    waves = np.sin(np.outer(generator.uniform(0.2, 2, 21), x) + np.outer(generator.uniform(0.2, 2, 21), y))
    shapes = waves[:, :, None] * generator.normal(size=(21, 1, 3)) * np.geomspace(30, 0.03, 21)[:, None, None]
    first, second = np.triu_indices(6, 1)
    features = np.concatenate([inputs, inputs[:, first] * inputs[:, second]], axis=1)
    offsets = np.tensordot(features, shapes, 1).astype(np.float32)
    return Poses(mesh, inputs[:90], offsets[:90], inputs[90:], offsets[90:], inputs[90:])


@pytest.fixture(scope="module")
def metric(poses):
    return loss_metric(poses.mesh.neutral, poses.mesh.faces, len(poses.mesh.neutral), len(poses.mesh.faces), 5.0)


def test_solutions_pass_and_say_how_near_they_are(poses, metric, capsys):
    check_pca(pca, poses)
    check_ridge(ridge_line, poses)
    check_basis(basis_in, poses, metric)
    said = capsys.readouterr().out
    assert said.count("✓") == 3 and "the neutral face" in said


def test_the_large_decomposition_passes_too(poses):
    def by_svd(offsets, count):
        mean = offsets.mean(axis=0)
        _, _, rows = np.linalg.svd((offsets - mean).reshape(len(offsets), -1), full_matrices=False)
        return mean, rows[:count].reshape(count, *mean.shape)

    check_pca(by_svd, poses)


def gram(offsets, count, centre=True, first=True, root=True, single=False):
    mean = offsets.mean(axis=0)
    x = (offsets - mean * centre).reshape(len(offsets), -1).astype(np.float32 if single else np.float64)
    values, vectors = np.linalg.eigh(x @ x.T)
    if first:
        values, vectors = values[::-1], vectors[:, ::-1]
    else:
        values, vectors = values[-count:], vectors[:, -count:]
    values, vectors = values[:count], vectors[:, :count]
    return mean, ((vectors / (np.sqrt(values) if root else values)).T @ x).reshape(count, *mean.shape)


def in_place(offsets, count):
    mean = offsets.mean(axis=0)
    offsets -= mean
    return mean, gram(offsets, count)[1]


def twice_the_first(offsets, count):
    mean, shapes = pca(offsets, count)
    shapes[1] = shapes[0]
    return mean, shapes


def kept(vectors_of, metric=None, twice=False):
    """Return a basis of eigenvectors chosen by hand. vectors_of: (values, vectors, count) → values, columns."""

    def answer(offsets, count):
        mean = offsets.mean(axis=0)
        centred = (offsets - mean).astype(np.float64)
        x = centred.reshape(len(offsets), -1)
        weighed = x if metric is None else apply_metric(metric, centred).reshape(x.shape)
        small = {"once": x @ weighed.T, "twice": weighed @ weighed.T, "outside": x @ weighed.T}[twice or "once"]
        values, vectors = vectors_of(*np.linalg.eigh(small), count)
        rows = weighed if twice == "outside" else x
        with np.errstate(invalid="ignore"):
            return mean, ((vectors / np.sqrt(values)).T @ rows).reshape(count, *mean.shape)

    return answer


def smallest(values, vectors, count):
    return values[:count], vectors[:, :count]


def largest(values, vectors, count):
    return values[::-1][:count], vectors[:, ::-1][:, :count]


def largest_of_rows(values, vectors, count):
    return values[::-1][:count], vectors[::-1][:count].T


def largest_values_alone(values, vectors, count):
    return values[::-1][:count], vectors[:, :count]


BASES = {
    "smallest eigenvalues": kept(smallest),
    "order of the eigenvectors": kept(largest_values_alone),
    "columns of u": kept(largest_of_rows),
    "returns nothing": lambda offsets, count: None,
    "Return two arrays": lambda offsets, count: pca(offsets, count)[1],
    r"The mean of 5 vertices has the shape \(5, 3\)": lambda x, k: (x.mean(), pca(x, k)[1]),
    "4 shapes of 5 vertices are": lambda x, k: (x.mean(axis=0), pca(x, k)[1].reshape(k, -1)),
    "changes its argument": in_place,
    "not that over the poses": lambda x, k: (0 * x[0], pca(x, k)[1]),
    "divide by the root": lambda x, k: gram(x, k, root=False),
    "have the inner product": twice_the_first,
    "weakest first": lambda x, k: gram(x, k, first=False),
    "is X centred": lambda x, k: gram(x, k, centre=False),
    "double precision": lambda x, k: gram(x, k, single=True) if x.shape[1] > 5 else pca(x, k),
}


@pytest.mark.parametrize("sentence", BASES)
def test_a_wrong_basis_is_told_what_is_wrong(poses, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_pca(BASES[sentence], poses)


def ridge_of(inputs, targets, strength, constant_pays=False, averaged=True, last=True):
    columns = [inputs, np.ones(len(inputs))] if last else [np.ones(len(inputs)), inputs]
    a = np.column_stack(columns)
    penalty = np.ones(a.shape[1])
    if not constant_pays:
        penalty[-1 if last else 0] = 0.0
    return np.linalg.solve(a.T @ a + (len(a) if averaged else 1) * strength * np.diag(penalty), a.T @ targets)


LINES = {
    "λ has no effect": lambda a, t, s: ridge_of(a, t, 0.0),
    "λ² in place of λ": lambda a, t, s: ridge_of(a, t, s**2),
    "m in place of N": lambda a, t, s: ridge_of(a, t, s * a.shape[1] / len(a)),
    "m \\+ 1 in place of N": lambda a, t, s: ridge_of(a, t, s * (a.shape[1] + 1) / len(a)),
    "returns nothing": lambda inputs, targets, strength: None,
    "a row for the constant": lambda a, t, s: np.linalg.lstsq(a, t)[0],
    "stands in the first row": lambda a, t, s: ridge_of(a, t, s, last=False),
    "the constant pays no penalty": lambda a, t, s: ridge_of(a, t, s, constant_pays=True),
    "N times too weak": lambda a, t, s: ridge_of(a, t, s, averaged=False),
    "not the least-squares fit": lambda a, t, s: ridge_of(a, t, s + 0.01),
    "off the suite's": lambda a, t, s: ridge_of(a, t, 2 * s),
}


@pytest.mark.parametrize("sentence", LINES)
def test_a_wrong_line_is_told_what_is_wrong(poses, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_ridge(LINES[sentence], poses)


def half_a_metric(offsets, metric, count):
    """The metric in the small matrix alone: shapes scaled to length 1 vertex by vertex."""
    mean, shapes = basis_in(offsets, metric, count)
    rows = shapes.reshape(count, -1)
    orthonormal = np.linalg.qr(rows.T)[0].T
    return mean, orthonormal.reshape(shapes.shape)


def uncentred(offsets, metric, count):
    x = offsets.astype(np.float64)
    values, vectors = np.linalg.eigh(x.reshape(len(x), -1) @ apply_metric(metric, x).reshape(len(x), -1).T)
    values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
    return x.mean(axis=0), np.tensordot((vectors / np.sqrt(values)).T, x, 1)


METRICS = {
    "smallest eigenvalues": lambda x, q, k: kept(smallest, q)(x, k),
    "columns of u": lambda x, q, k: kept(largest_of_rows, q)(x, k),
    "B from Q X": lambda x, q, k: kept(largest, q, "outside")(x, k),
    r"\(Q X\)\(Q X\)ᵀ": lambda x, q, k: kept(largest, q, "twice")(x, k),
    "vertex by vertex still": half_a_metric,
    "orthonormal vertex by vertex": lambda x, q, k: pca(x, k),
    "in the metric, expected 1": lambda x, q, k: basis_in(x, q + q, k),
    "is X centred": uncentred,
    "weakest first": lambda x, q, k: (x.mean(axis=0), basis_in(x, q, k)[1][::-1]),
}


@pytest.mark.parametrize("sentence", METRICS)
def test_a_wrong_metric_is_told_what_is_wrong(poses, metric, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_basis(METRICS[sentence], poses, metric)


def test_an_exercise_that_is_not_begun_says_so(poses, metric):
    def empty(*_):
        raise NotImplementedError

    for check, more in ((check_pca, ()), (check_ridge, ()), (check_basis, (metric,))):
        with pytest.raises(NotImplementedError):
            check(empty, poses, *more)
