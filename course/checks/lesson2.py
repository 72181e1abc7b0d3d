"""What lesson 2 asks for: principal shapes, ridge regression, and principal shapes in a metric."""

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_matrix, diags_array, identity

from course.checks import passed, require
from course.lesson2 import Poses
from replicate.baselines.ridge import principal_components
from replicate.methods.linear import ridge, with_constant
from replicate.regional.basis import apply_metric, principal_basis

POSES, SHAPES = 60, 20  # of the real face
NEAR = 1e-3  # the suite keeps its shapes in single precision


def check_pca(pca: Callable, poses: Poses) -> None:
    """Require a mean and orthonormal shapes, the strongest first, that span what the suite's do."""
    generator = np.random.default_rng(4)
    offsets = 3.0 + generator.normal(size=(12, 5, 3)) * np.linspace(4, 1, 5)[:, None]
    mean, shapes = _basis(lambda x: pca(x, 4), offsets, 4)
    _usual_slips(offsets - mean, shapes)
    flat = shapes.reshape(4, -1)
    _orthonormal(flat @ flat.T, "")
    _closest(offsets - mean, shapes, principal_components(offsets.astype(np.float32), 4).shapes.reshape(shapes.shape))
    _strongest(offsets - mean, shapes)
    # the real face
    real = poses.offsets[:POSES]
    count = min(SHAPES, POSES - 1)
    mean, shapes = pca(real, count)
    flat = np.asarray(shapes, float).reshape(count, -1)
    off = float(np.abs(flat @ flat.T - np.eye(count)).max())
    require(
        off < 1e-4,
        f"On the real face your {count} shapes are {off:.2g} off orthonormal: compute the small matrix in "
        "double precision.",
    )
    apart = _apart(flat, principal_components(real, count).shapes.astype(float))
    require(apart < NEAR, f"On the real face your shapes leave the span of the suite's by {apart:.2g} of their length.")
    passed(f"your {count} shapes are orthonormal within {off:.0e}, and span what the suite's do within {apart:.0e}")


def check_ridge(ridge_line: Callable, poses: Poses) -> None:
    """Require the suite's weights, with a constant that pays no penalty, and a line that beats the neutral face."""
    generator = np.random.default_rng(5)
    inputs, noise = generator.normal(size=(30, 4)), generator.normal(size=(30, 3))
    targets = inputs @ generator.normal(size=(4, 3)) + np.array([5.0, -2.0, 8.0]) + 0.1 * noise
    before = inputs.copy(), targets.copy()
    weights = ridge_line(inputs, targets, 0.0)
    require(weights is not None, "`ridge_line` returns nothing: is there a `return`?")
    require(
        np.shape(weights) == (5, 3),
        f"For 4 inputs and 3 targets the weights are (5, 3), with a row for the constant; yours are "
        f"{np.shape(weights)}.",
    )
    require((inputs == before[0]).all() and (targets == before[1]).all(), "Your function changes its arguments.")
    columns = with_constant(inputs)
    exact = np.linalg.lstsq(columns, targets)[0]
    require(
        not np.allclose(weights, np.roll(exact, 1, axis=0), atol=1e-6),
        "Your constant stands in the first row; the column of ones, and with it the constant, comes last.",
    )
    require(np.allclose(weights, exact, atol=1e-6), "Without a penalty yours is not the least-squares fit.")
    far = ridge_line(inputs, targets, 1e6)
    require(not np.allclose(far, exact, atol=1e-6), "Your weights are the same for each λ: λ has no effect.")
    far = columns @ far
    require(
        np.allclose(far, targets.mean(axis=0), atol=0.1),
        f"With a huge λ the line must become the targets' mean, here {targets.mean(axis=0)[0]:.1f}, but yours gives "
        f"{far[:, 0].mean():.1f}: the constant pays no penalty, so D ends with 0.",
    )
    found, (theirs,) = ridge_line(inputs, targets, 0.1), ridge(columns, [targets], (0.1,))
    (mean_of_one,) = ridge(columns, [targets], (0.1 / len(inputs),))
    require(
        not np.allclose(found, mean_of_one, atol=1e-6),
        "Your penalty is N times too weak: the errors are averaged over N poses, so λ is multiplied by N.",
    )
    slips = {"λ²": (0.1**2, "λ"), "m": (0.1 * 4 / 30, "N"), "m + 1": (0.1 * 5 / 30, "N")}
    for slip, (strength, right) in slips.items():
        (wrong,) = ridge(columns, [targets], (strength,))
        require(
            not np.allclose(found, wrong, atol=1e-6),
            f"Your penalty has {slip} in place of {right}: the diagonal gets N λ, N being the number of poses.",
        )
    off = float(np.abs(found - theirs).max())
    require(off < 1e-6, f"With λ = 0.1 your weights are {off:.2g} off the suite's: compare with the normal equations.")
    # the real face: a few vertices
    some = slice(None, None, max(1, poses.offsets.shape[1] // 50))
    flat, truth = (part[:, some].reshape(len(part), -1) for part in (poses.offsets, poses.test_offsets))
    line = with_constant(poses.test_inputs) @ ridge_line(poses.inputs, flat, 1e-4)
    error, still = (float(np.sqrt(np.square(guess - truth).mean())) for guess in (line, np.zeros_like(truth)))
    require(error < still, f"On held-out poses your line is {error:.2f} mm off, the neutral face {still:.2f} mm.")
    passed(
        f"your weights equal the suite's within {off:.0e}; on some vertices of the held-out poses the line is "
        f"{error:.2f} mm off (root mean square), the neutral face {still:.2f} mm"
    )


def check_basis(basis_in: Callable, poses: Poses, metric: csr_matrix) -> None:
    """Require shapes that are orthonormal in a metric, the strongest first, and equal to the suite's."""
    generator = np.random.default_rng(6)
    offsets = 1.0 + generator.normal(size=(12, 6, 3)) * np.linspace(3, 1, 6)[:, None]
    step = diags_array([np.ones(6), -np.ones(5)], offsets=[0, 1]).tocsr()
    small = csr_matrix(0.1 * identity(6) + step.T @ step)
    mean, shapes = _basis(lambda x: basis_in(x, small, 4), offsets, 4)
    _usual_slips(offsets - mean, shapes, small)
    flat = shapes.reshape(4, -1)
    weighed = apply_metric(small, shapes).reshape(4, -1)
    gram = flat @ weighed.T
    require(
        np.allclose(gram, np.eye(4), atol=1e-6) or not np.allclose(flat @ flat.T, np.eye(4), atol=1e-6),
        "Your shapes are orthonormal vertex by vertex still, and not in the metric: form X Q Xᵀ, and scale by its "
        "eigenvalues alone.",
    )
    _orthonormal(gram, " in the metric")
    theirs = principal_basis(np.arange(6), offsets, small, 4)
    _closest(offsets - mean, shapes, theirs.components, small)
    _strongest(offsets - mean, weighed.reshape(shapes.shape))
    plain = basis_in(offsets, csr_matrix(identity(6)), 4)[1].reshape(4, -1)
    apart = _apart(plain, principal_components(offsets.astype(np.float32), 4).shapes.astype(float))
    require(apart < NEAR, "In the metric of the identity your shapes must be those of plain PCA, and they are not.")
    # the real face
    real = poses.offsets[:POSES]
    count = min(SHAPES, POSES - 1)
    mean, shapes = basis_in(real, metric, count)
    suite = principal_basis(np.arange(real.shape[1]), real, metric, count).components.astype(float)
    inner = np.asarray(shapes, float).reshape(count, -1) @ apply_metric(metric, suite).reshape(count, -1).T
    off = float(np.abs(np.abs(np.diag(inner)) - 1).max())
    require(off < NEAR, f"On the real face your shapes and the suite's differ by {off:.2g} of their length.")
    passed(
        f"your shapes are orthonormal in the metric; up to signs, {count} of them equal the suite's within {off:.0e}"
    )


def _basis(answer: Callable, offsets: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and shapes of some offsets, if that is what the answer gives."""
    before = offsets.copy()
    found = answer(offsets)
    require(found is not None, "Your function returns nothing: is there a `return`?")
    require(isinstance(found, tuple) and len(found) == 2, "Return two arrays, the mean and the shapes: `mean, shapes`.")
    mean, shapes = (np.asarray(part, float) for part in found)
    n = offsets.shape[1]
    require(mean.shape == (n, 3), f"The mean of {n} vertices has the shape ({n}, 3); yours has {mean.shape}.")
    expected = (count, n, 3)
    require(shapes.shape == expected, f"{count} shapes of {n} vertices are {expected}; yours are {shapes.shape}.")
    require((offsets == before).all(), "Your function changes its argument; subtract the mean into a new array.")
    require(
        np.isfinite(shapes).all(),
        "Your shapes have NaN: are these the smallest eigenvalues? `eigh` sorts upwards, and the first are 0 within "
        "rounding, some a little below.",
    )
    require(np.allclose(mean, offsets.mean(axis=0)), "Your mean is not that over the poses (axis 0).")
    return mean, shapes


def _usual_slips(centred: np.ndarray, shapes: np.ndarray, metric: csr_matrix | None = None) -> None:
    """Require that shapes are not those of some usual slips with the small matrix and its eigenvectors."""
    x = centred.reshape(len(centred), -1)
    weighed = x if metric is None else apply_metric(metric, centred).reshape(x.shape)
    values, u = (part[..., ::-1] for part in np.linalg.eigh(x @ weighed.T))
    count, flat = len(shapes), shapes.reshape(len(shapes), -1)
    lengths = np.sqrt(
        np.abs((flat * (flat if metric is None else apply_metric(metric, shapes).reshape(flat.shape))).sum(1))
    )
    require(
        lengths[0] > 1e-3,
        f"Your first shape has the length {lengths[0]:.2g}, nearly 0: are these the smallest eigenvalues, or is the "
        "order of the eigenvectors not that of their values? `eigh` sorts upwards.",
    )
    roots, rows = np.sqrt(np.maximum(values[:count], 1e-12))[:, None], np.linalg.eigh(x @ weighed.T)[1]
    taken = (rows[:count], rows[::-1][:count], u[:count])
    require(
        not any(_same(flat, each / roots @ x) for each in taken),
        "You take rows of the matrix of eigenvectors: they are the columns of u, `u[:, k]`.",
    )
    if metric is None:
        return
    require(
        not _same(flat, u[:, :count].T / roots @ weighed),
        "You make B from Q X in place of X: Q stands in the small matrix only, once.",
    )
    values, u = (part[..., ::-1][..., :count] for part in np.linalg.eigh(weighed @ weighed.T))
    require(
        not any(_same(flat, u.T / np.sqrt(values)[:, None] @ each) for each in (x, weighed)),
        "Your small matrix is (Q X)(Q X)ᵀ, with Q in it twice: Q stands in the small matrix only, once.",
    )


def _same(rows: np.ndarray, others: np.ndarray) -> bool:
    """Return whether rows are equal up to their signs."""
    return bool(np.allclose(rows, others * np.sign((rows * others).sum(axis=1))[:, None], rtol=1e-5, atol=1e-8))


def _orthonormal(gram: np.ndarray, where: str) -> None:
    lengths = np.sqrt(np.abs(np.diag(gram)))
    require(
        np.allclose(lengths, 1, atol=1e-6),
        f"Your first shape has the length {lengths[0]:.3g}{where}, expected 1: divide by the root of its eigenvalue.",
    )
    off = float(np.abs(gram - np.diag(np.diag(gram))).max())
    require(off < 1e-6, f"Two of your shapes have the inner product {off:.2g}{where}, expected 0.")


def _strongest(centred: np.ndarray, weighed: np.ndarray) -> None:
    """Require that coefficients vary most along the first shape."""
    spread = np.square(np.tensordot(centred, weighed, ((1, 2), (1, 2)))).sum(axis=0)
    require(
        (np.diff(spread) <= 1e-9 * spread.max()).all(),
        "Your shapes come weakest first: `eigh` sorts its eigenvalues upwards, so turn them round before you cut.",
    )


def _closest(centred: np.ndarray, shapes: np.ndarray, best: np.ndarray, metric: csr_matrix | None = None) -> None:
    """Require that shapes leave as little of the poses as the best ones do."""
    metric = csr_matrix(identity(centred.shape[1])) if metric is None else metric
    left = []
    for basis in (shapes, np.asarray(best, float)):
        weighed = apply_metric(metric, basis)
        rest = centred - np.tensordot(np.tensordot(centred, weighed, ((1, 2), (1, 2))), basis, 1)
        left.append(float((rest * apply_metric(metric, rest)).sum()))
    require(
        left[0] < left[1] * (1 + 1e-4),
        f"Your shapes leave {left[0] / left[1]:.2f} times as much of the poses as the best do: is X centred, and are "
        "the largest eigenvalues taken?",
    )


def _apart(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return how far orthonormal rows are out of the span of others, as a share of their length."""
    return float(np.linalg.norm(ours - ours @ theirs.T @ theirs, axis=1).max())
