"""What lesson 3 asks for: an alignment that never mirrors, sparse convex weights, and their alternation."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from course.checks import passed, require, require_kept
from course.lesson3 import Examples, alone, rmse, start
from replicate.approximation.metrics import vertex_error
from replicate.baselines.skinning import ssdr
from replicate.baselines.skinning.weights import solve_reference
from replicate.geometry.alignment import align as suites_align
from replicate.geometry.alignment import nearest_rotation

MOST = 4  # bones a vertex
ROUNDING = 1e-9
CLOSE = 1.10  # of the suite's squared error, at most, over many vertices
NEAR_FIT = 1.35  # of the RMSE of the suite's fit


def check_align(align: Callable, face: Examples) -> None:
    """Require the best proper rotation and its translation: on points that moved, mirrored ones, and the face."""
    generator = np.random.default_rng(3)
    source = generator.normal([100, 0, 0], 20, (30, 3))
    truth, shift = nearest_rotation(generator.normal(size=(3, 3))), np.array([5.0, -2.0, 30.0])
    target = source @ truth + shift
    before = [source.copy(), target.copy()]
    rotation, translation = _motion(align(source, target))
    require_kept((source, target), before)
    require(
        np.abs(rotation - truth.T).max() > 1e-6,
        "You return the inverse of the rotation: is your H built as source-transposed times target, and R = U D Vᵀ?",
    )
    off = np.linalg.norm(rotation.T @ rotation - np.eye(3))
    require(off < 1e-6, "Your R is no rotation, R Rᵀ isn't the identity: leave the singular values out of U D Vᵀ.")
    require(
        np.linalg.det(rotation) > 0,
        "Your R mirrors even points that only moved: look at the sign in D, det U · det V.",
    )
    a, b = source.mean(0), target.mean(0)
    u, _, vt = np.linalg.svd((source - a).T @ (target - b))
    twice = (u @ np.diag([1, 1, sign]) @ vt.T for sign in (1, -1))
    require(
        not any(np.allclose(rotation, each) for each in twice),
        "Your R has V where it needs Vᵀ: np.linalg.svd returns V already transposed, so take it as it is.",
    )
    found = "Your R is not the one that the points were turned by: subtract each set's mean before you build H."
    require(np.abs(rotation - truth).max() < 1e-6, found)
    require(
        np.abs(translation - (target.mean(0) - source.mean(0))).max() > 1e-6,
        "Your t is the difference of the two means, but R turns the source's mean, too: subtract mean source · R.",
    )
    off = float(np.abs(source @ rotation + translation - target).max())
    require(off < 1e-6, f"Your R is right and your t is {off:.2g} mm off: where must the source's mean go?")
    flat = source * [1, 1, 0]
    rotation, translation = _motion(align(flat, flat @ truth + shift))
    off = np.abs(flat @ rotation + translation - flat @ truth - shift).max()
    require(
        abs(np.linalg.det(rotation) - 1) < 1e-6 and off < 1e-6,
        "On a flat patch your R is no rotation: there det H is 0 up to rounding, so take det U · det V for D.",
    )
    mirrored = source * [1, 1, -1]
    rotation, translation = _motion(align(source, mirrored))
    require(
        np.linalg.det(rotation) > 0,
        "On a mirrored target your R has the determinant −1, a reflection: put D between U and Vᵀ.",
    )
    left, best = (
        _left(source, mirrored, motion) for motion in ((rotation, translation), suites_align(source, mirrored))
    )
    require(
        left < best * 1.001,
        f"On a mirrored target your R is proper, but leaves {left:.1f} mm where {best:.1f} mm is possible: D has "
        "its sign in the last place, that of the smallest singular value, NumPy's last.",
    )
    worst = 0.0
    for part in range(len(face.names)):
        inside = face.segment == part
        rest, posed = face.rest[inside].astype(float), face.training[:8, inside].astype(float)
        theirs = suites_align(rest, posed)
        for pose, turn, shift in zip(posed, *theirs, strict=True):
            worst = max(worst, _left(rest, pose, _motion(align(rest, pose))) - _left(rest, pose, (turn, shift)))
    require(worst < 1e-5, f"On parts of the face yours leaves up to {worst:.2g} mm more than the suite's align.")
    passed(f"your motions are proper, and leave what the suite's do within {max(worst, 1e-12):.0e} mm on all parts")


def _left(source: np.ndarray, target: np.ndarray, motion: tuple[np.ndarray, np.ndarray]) -> float:
    return float(np.sqrt(((source @ motion[0] + motion[1] - target) ** 2).sum(1).mean()))


def _motion(found: object) -> tuple[np.ndarray, np.ndarray]:
    require(found is not None, "align returns nothing: is there a return at its end?")
    require(isinstance(found, tuple) and len(found) == 2, "align must return two things, R and t: `return R, t`.")
    rotation, translation = found
    return _array(rotation, (3, 3), "align's R"), _array(translation, (3,), "align's t")


def check_weights(weights: Callable, face: Examples) -> None:
    """Require weights that are convex, sparse, as good as they can be, and never worse than those before."""
    generator = np.random.default_rng(3)
    left, old = generator.normal(0, 3, (30, 8)) + 2, np.full(8, 1 / 8)
    before = [left.copy(), old.copy()]
    _is_convex(weights(left, old), left, old)
    require_kept((left, old), before)
    # Two bones that carry a vertex to its place: their blend is exact.
    left = generator.normal(0, 3, (30, 6))
    left[:, 4] = -left[:, 1] * 3
    first = np.eye(6)[0]
    found = _is_convex(weights(left, first), left, first)
    require(
        np.abs(found - [0, 0.75, 0, 0, 0.25, 0]).max() < 1e-4,
        f"Bones 1 and 4 can carry this vertex exactly, by ¾ and ¼; yours are {np.round(found, 2)}: did you divide by "
        "the sum after nnls, and does the last row of the matrix have the 1 on its right side?",
    )
    # A vertex for which the best weights of any sign are not all positive.
    left, old = generator.normal([0.2, 0.5, 1.0, 1.5], 1, (12, MOST)), np.eye(MOST)[3]
    found = _is_convex(weights(left, old), left, old)
    require(
        np.abs(found - _clipped(left)).max() > 1e-4,
        "You solve for weights of any sign and clip them at zero: the bones that are left then have the weights that "
        "suited them beside the negative ones; nnls solves again without those.",
    )
    _check_choice(weights)
    # A vertex whose four bones are better than the four that are largest among all.
    left, old = _trap()
    found = _is_convex(weights(left, old), left, old)
    require(
        _energy(left, found) <= _energy(left, old) * (1 + ROUNDING),
        "Your new weights are worse than the old ones here: cutting to four is a guess, so compare ‖S w‖ and keep the "
        "better.",
    )
    # The face.
    places = np.sort(generator.choice(len(face.rest), min(150, len(face.rest)), replace=False))
    rest, poses = face.rest[places].astype(float), face.training[:20, places].astype(float)
    motions, clusters = start(rest, poses, 8, suites_align)
    matrices = alone(rest, poses, motions)
    ours = sum(_energy(s, _is_convex(weights(s, w), s, w)) for s, w in zip(matrices, clusters, strict=True))
    theirs = sum(
        _energy(s, solve_reference(s.T @ s + 1e-9 * np.eye(8), w, MOST, 24))
        for s, w in zip(matrices, clusters, strict=True)
    )
    require(
        ours < CLOSE * theirs,
        f"On {len(places)} vertices of the face your squared error is {ours / theirs:.2f} times the suite's: once four "
        "bones are chosen, solve for their weights again.",
    )
    passed(
        "your weights are convex, at most four a vertex, never worse than before; their squared error is "
        f"{ours / theirs:.3f} of the suite's on {len(places)} vertices"
    )


def _clipped(left: np.ndarray) -> np.ndarray:
    """Return what clipping at zero makes of the least squares whose weights may be negative."""
    ones = np.linalg.lstsq(np.vstack([left, np.ones(left.shape[1])]), np.append(np.zeros(len(left)), 1.0))[0]
    return np.maximum(ones, 0) / np.maximum(ones, 0).sum()


def _check_choice(weights: Callable) -> None:
    """Try a vertex that more than four bones suit, and whose old weights are bad."""
    generator = np.random.default_rng(1)
    while True:
        left = generator.normal(0, 1, (12, 9)) + 0.4
        full = _cut(left, 9)
        used, lengths = np.flatnonzero(full > 1e-6), (left**2).sum(0)
        kept, least = np.sort(np.argsort(full)[-MOST:]), np.sort(used[np.argsort(full[used])[:MOST]])
        near = np.sort(np.argsort(lengths)[:MOST])
        right, smallest, nearest = (_of(left, each) for each in (kept, least, near))
        only = np.where(np.isin(np.arange(9), kept), full, 0) / full[kept].sum()
        best, *others = (_energy(left, each) for each in (right, smallest, nearest, only))
        if len(used) > MOST and min(others) > 1.05 * best:
            break
    old = np.eye(9)[np.argmax(lengths)]
    found = _is_convex(weights(left, old), left, old)
    for wrong, sentence in (
        (smallest, "You keep the four smallest weights: keep the largest weights, not the first that argsort gives."),
        (
            nearest,
            "You choose four bones before nnls, by what each leaves alone: solve for all, then keep the largest.",
        ),
        (only, "You cut to four and divide by the sum: once four bones are chosen, solve for them again."),
    ):
        require(np.abs(found - wrong).max() > 1e-3, sentence)
    require(
        _energy(left, found) < 1.02 * best,
        f"For a vertex that {len(used)} bones suit you leave {_energy(left, found) / best:.2f} times the squared error "
        "that is possible by the four largest: keep those, and solve for them again.",
    )
    count = int((np.asarray(weights(left, old, 2)) > 0).sum())
    require(count <= 2, f"With `most` = 2 your vertex has {count} bones: use the argument, not a 4.")


def _of(left: np.ndarray, bones: np.ndarray) -> np.ndarray:
    """Return the best weights of some bones alone."""
    weights = np.zeros(left.shape[1])
    weights[bones] = _cut(left[:, bones], MOST)
    return weights


def _trap() -> tuple[np.ndarray, np.ndarray]:
    """Return S and old weights such that cutting the best weights to four loses against the old ones."""
    generator = np.random.default_rng(0)
    while True:
        left = generator.normal(0, 1, (12, 9)) + 0.4
        full = _cut(left, 9)
        kept = np.argsort(full)[-MOST:]
        guess = np.zeros(9)
        guess[kept] = _cut(left[:, kept], MOST)
        best = solve_reference(left.T @ left, sparse_start(left), MOST, 24)
        if _energy(left, best) < 0.9 * _energy(left, guess):
            return left, best


def sparse_start(left: Float[np.ndarray, "k bones"]) -> Float[np.ndarray, " bones"]:
    """Return all weight on the one bone that leaves least."""
    return np.eye(left.shape[1])[np.argmin((left**2).sum(0))]


def _cut(left: np.ndarray, most: int) -> np.ndarray:
    return solve_reference(left.T @ left, sparse_start(left), most, 50)


def _energy(left: np.ndarray, weights: np.ndarray) -> float:
    return float(((left @ weights) ** 2).sum())


def _is_convex(found: object, left: np.ndarray, old: np.ndarray) -> np.ndarray:
    """Return an answer as an array once it is non-negative, sums to one and has at most four weights."""
    require(
        not isinstance(found, np.ndarray) or (np.isfinite(found).all() and found.any()),
        "Your weights are 0, or NaN once they are divided by their sum: nothing but x = 0 is asked for without the row "
        "of ones below S and the 1 at the end of the right side.",
    )
    found = _array(found, old.shape, "weights")
    require(
        (found >= -ROUNDING).all(), f"One of your weights is {found.min():.2g}: none may be negative (nnls sees to it)."
    )
    total = float(found.sum())
    require(
        abs(total - 1) < 1e-6,
        f"Your weights sum to {total:.4g}, not to 1: a bone that stays must leave the face still.",
    )
    count = int((found > 0).sum())
    allowed = max(MOST, int((old > 0).sum()))
    require(
        count <= allowed, f"Your vertex has {count} bones, at most {MOST} may be used: keep the four largest weights."
    )
    return found


def check_alternate(alternate: Callable, face: Examples) -> None:
    """Require an alternation whose error never rises and ends near the suite's, with sparse convex weights."""
    generator = np.random.default_rng(3)
    places = np.sort(generator.choice(len(face.rest), min(500, len(face.rest)), replace=False))
    rest, poses, bones, iterations = face.rest[places].astype(float), face.training[:24, places].astype(float), 8, 6
    before = [rest.copy(), poses.copy()]
    found = alternate(rest, poses, bones, iterations)
    require_kept((rest, poses), before)
    require(found is not None, "alternate returns nothing: is there a return at its end?")
    require(
        isinstance(found, tuple) and len(found) == 3,
        "alternate must return three things: the weights, the motions, and the list of errors.",
    )
    loads, motions, errors = found
    require(
        not isinstance(loads, tuple) and isinstance(motions, tuple) and len(motions) == 2,
        "alternate returns the weights, the motions and the errors, in this order; `start` gives motions first.",
    )
    loads, errors = _array(loads, (len(rest), bones), "the weights"), np.asarray(errors, float)
    require(
        errors.shape == (iterations + 1,),
        f"Your list has {errors.size} errors, expected {iterations + 1}: after the start and each iteration.",
    )
    require(np.abs(loads.sum(1) - 1).max() < 1e-6, "Some of your vertices' weights don't sum to 1.")
    most = int((loads > 0).sum(1).max())
    require(most <= MOST, f"One of your vertices has {most} bones: pass every vertex's S through your weights.")
    require(
        (np.diff(errors) <= ROUNDING).all(),
        f"Your error rises, from {errors[:-1][np.diff(errors) > ROUNDING][:1].sum():.3f} mm: pass the last weights and "
        "motions on, and measure with the S of the new motions.",
    )
    last = rmse(alone(rest, poses, motions), loads, len(poses))
    begun, _ = start(rest, poses, bones, suites_align)
    require(
        not all(np.allclose(one, other) for one, other in zip(motions, begun, strict=True)),
        "Your motions are those of the start: a bone step belongs to each iteration.",
    )
    require(
        not np.isclose(errors[-1], last * np.sqrt(len(poses) / bones)),
        "Your errors are divided by the number of bones: rmse wants the number of poses, len(poses).",
    )
    require(
        abs(last - errors[-1]) < 1e-6,
        f"Your weights and motions leave {last:.3f} mm, your list ends with {errors[-1]:.3f} mm: motions have changed "
        "after you measured, so call alone again.",
    )
    require(
        np.ptp(errors[1:]) > 1e-9,
        "Your error is the same after each iteration: taking turns means to go on from the last weights and motions.",
    )
    require(errors[-1] < 0.9 * errors[0], "Your error hardly falls: do both steps run in every iteration?")
    single = poses.astype(np.float32)
    suites = ssdr.fit(
        rest.astype(np.float32), single, bones, generator, influences=MOST, iterations=30, coherence=0.0, relaxed=0
    )
    square = vertex_error(suites.deform(*ssdr.refit(suites, single)), single).astype(float) ** 2
    theirs = float(np.sqrt(square.mean()))
    require(
        errors[-1] < NEAR_FIT * theirs,
        f"You end at {errors[-1]:.3f} mm, the suite's fit at {theirs:.3f} mm: too far; look at each step alone.",
    )
    passed(
        f"your error falls in every iteration, {errors[0]:.2f} to {errors[-1]:.2f} mm with {bones} bones; the suite's "
        f"fit ends at {theirs:.2f} mm"
    )


def _array(found: object, shape: tuple[int, ...], name: str) -> np.ndarray:
    require(found is not None, f"{name} is nothing: is there a return at the function's end?")
    require(
        not isinstance(found, tuple),
        f"{name}: expected an array, got several things in a tuple; nnls returns two, of which x is the first.",
    )
    array = np.asarray(found)
    require(
        array.shape == shape and array.dtype.kind == "f",
        f"{name}: expected an array of the shape {shape}, got {array.shape} of {array.dtype}.",
    )
    require(np.isfinite(array).all(), f"{name} has a value that is no finite number: is a sum that you divide by zero?")
    return array
