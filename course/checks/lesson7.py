"""Checks of lesson 7: a Jacobian by differences, the damped step, and a step that keeps limits."""

from collections.abc import Callable
from functools import partial

import numpy as np

from course.checks import given_by, passed, require
from course.lesson7 import Networks, mean_distance, networks

STEP = 1e-3  # of differences, in units of a control
WIDE = 0.07  # another, which nobody writes into a function
DAMPING = 1.0  # mm²
SLACK = 1e-7  # by how much rounding may carry a control past its limit


_kept = partial(given_by, example="`p += step` writes into an array, `p + step` makes a new one")


def _pull(net: Networks) -> np.ndarray:
    return net.targets(mouth_corner_left=(20, 10), chin=(0, -15), brow_right_03=(0, 12))


def check_jacobian(answer: Callable) -> None:
    """Check `jacobian`. Raises Wrong with what is wrong."""
    rng = np.random.default_rng(7)
    slopes, bends, pose = rng.standard_normal((4, 3)), rng.standard_normal((4, 3)), np.array([0.5, -1.0, 2.0])

    asked = [0.0]

    def places(controls: np.ndarray) -> np.ndarray:
        require(
            np.ndim(controls) == 2 and np.shape(controls)[1] == 3,
            f"You call places with controls of the shape {np.shape(controls)}: it takes (b, m), also for one pose.",
        )
        asked.append(float(np.abs(controls - pose).max()))
        return controls @ slopes.T + controls**2 @ bends.T

    exact = slopes + 2 * pose * bends
    given = np.asarray(_kept(answer, places, pose, WIDE))
    require(
        given.shape != (3, 4),
        "Your Jacobian has a row for each control, (m, k): transpose it, a column says what one control moves.",
    )
    require(given.shape == (4, 3), f"Expected the shape (k, m) = (4, 3), got {given.shape}.")
    require(
        not np.allclose(given, exact * 2 * WIDE, atol=1e-8),
        "Your Jacobian shrinks with the step: divide the differences by 2h.",
    )
    require(
        not np.allclose(given, exact * 2, atol=1e-8),
        "Your Jacobian is twice as large as it should be: from −h to +h are 2h.",
    )
    require(not np.allclose(given, -exact, atol=1e-8), "Your Jacobian has the wrong sign: ahead minus behind.")
    require(
        not np.allclose(given, slopes, atol=1e-8),
        "Your Jacobian is the one at rest: move the controls about the pose that is given, controls ± h.",
    )
    forward, backward = exact + WIDE * bends, exact - WIDE * bends
    require(
        not (np.allclose(given, forward, atol=1e-8) or np.allclose(given, backward, atol=1e-8)),
        "Your differences are taken on one side only, so a curve's bend comes in: take p + h and p − h.",
    )
    off = np.abs(given - exact).max()
    require(off < 1e-8, f"On a parabola, where central differences are exact, yours is off by {off:.2g}.")
    reach = max(asked)
    require(
        np.isclose(reach, WIDE, rtol=1e-3),
        f"You move controls by {reach:.2g} where step = {WIDE}: h is the argument `step`, not a number of your own.",
    )
    net = networks()
    pose = 0.25 * (net.lower + net.upper) + 0.1
    exact = net.slopes(pose)
    off = np.linalg.norm(np.asarray(_kept(answer, net.places, pose, STEP)) - exact) / np.linalg.norm(exact)
    require(off < 0.02, f"On the teen your Jacobian is off by {off:.1%} of reverse differentiation's.")
    passed(f"your {exact.shape[0]} × {exact.shape[1]} numbers agree with reverse differentiation to {off:.2%}")


def _system(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(rows)
    return rng.standard_normal((rows, columns)), rng.standard_normal(rows)


def _least_squares(J: np.ndarray, residual: np.ndarray, damping: float) -> np.ndarray:
    """Return the damped step by its definition, as one least-squares problem."""
    m = J.shape[1]
    stacked = np.concatenate([J, np.sqrt(damping) * np.eye(m)])
    return np.linalg.lstsq(stacked, np.concatenate([residual, np.zeros(m)]), rcond=None)[0]


def _solved(J: np.ndarray, residual: np.ndarray, added: np.ndarray) -> np.ndarray:
    """Return the step for what is added to JᵀJ."""
    return np.linalg.pinv(J.T @ J + added) @ J.T @ residual


def check_step(answer: Callable) -> None:
    """Check `damped_step`. Raises Wrong with what is wrong."""
    for rows, columns in ((8, 5), (5, 8)):  # JᵀJ of the second is singular
        J, residual = _system(rows, columns)
        for damping in (0.3, 4.0):
            step = np.asarray(_kept(answer, J, residual, damping))
            require(
                step.shape == (columns,),
                f"For J (k, m) = ({rows}, {columns}) expected a step (m,) = ({columns},), got {step.shape}.",
            )
            exact = _least_squares(J, residual, damping)
            usual = {
                "Your step goes the wrong way: the residual is where points are wanted minus where they are; keep its "
                "sign.": -exact,
                "Your step has no damping in it: add μ to the diagonal of JᵀJ.": np.linalg.pinv(J) @ residual,
                "Your step is damped by μ²: the diagonal gets μ itself.": _least_squares(J, residual, damping**2),
                "Your step adds μ to every entry of JᵀJ: the I of μI is missing, write μ times np.eye(m).": (
                    _solved(J, residual, np.full((columns, columns), damping))
                ),
                "Your step scales μ by the diagonal of JᵀJ (Marquardt's way): here each control gets the same μ, as in "
                "JᵀJ + μI.": _solved(J, residual, damping * np.diag((J**2).sum(axis=0))),
                "Your step divides by μ alone, Jᵀr / μ, so JᵀJ has no part in it: solve with JᵀJ + μI.": (
                    J.T @ residual / damping
                ),
                "Your step only turns the residual around, Jᵀr: that is descent; solve with JᵀJ + μI.": J.T @ residual,
            }
            for sentence, wrong in usual.items():
                require(np.allclose(exact, wrong) or not np.allclose(step, wrong, rtol=1e-4), sentence)
            left = np.linalg.norm((J.T @ J + damping * np.eye(columns)) @ step - J.T @ residual)
            require(left < 1e-6, f"(JᵀJ + μI)δ − Jᵀr has the length {left:.2g} for your δ: expected 0.")
    net = networks()
    J, residual = net.slopes(net.default), _pull(net) - net.places(net.default[None])[0]
    step = np.asarray(_kept(answer, J, residual, DAMPING))
    before, after = (mean_distance(residual, moved) for moved in (0 * residual, J @ step))
    passed(f"your step solves its system; by the straight line it leaves {after:.2f} of {before:.2f} mm of a hard pull")


def check_limits(answer: Callable) -> None:
    """Check `step_within`. Raises Wrong with what is wrong."""
    _check_without_limits(answer)
    net, rng = networks(), np.random.default_rng(3)
    J, residual = rng.standard_normal((6, 12)), 3 * rng.standard_normal(6)
    _judge(answer, J, residual, 0.1, rng.uniform(0.4, 0.8, 12), np.full(12, 0.3), np.full(12, 1.3))  # none at a limit
    controls = rng.choice([0.0, 0.1, 0.5], 12)
    _judge(answer, J, residual, 0.1, controls, np.zeros(12), np.ones(12))
    _judge(answer, J, residual, 0.1, -controls, -np.ones(12), np.zeros(12))
    J, residual = net.slopes(net.default), _pull(net) - net.places(net.default[None])[0]
    limits = net.default.astype(float), net.lower.astype(float), net.upper.astype(float)
    step = _judge(answer, J, residual, DAMPING, *limits)
    cut = np.clip(limits[0] + _least_squares(J, residual, DAMPING), *limits[1:]) - limits[0]
    yours, plain = (mean_distance(residual, J @ each) for each in (step, cut))
    passed(f"all controls stay within limits, and a straight line leaves {yours:.2f} mm; cutting leaves {plain:.2f} mm")


def _check_without_limits(answer: Callable) -> None:
    J, residual = _system(5, 8)
    far = np.full(8, 1e3)
    step = np.asarray(_kept(answer, J, residual, 0.3, np.zeros(8), -far, far))
    require(step.shape == (8,), f"Expected a step (m,) = (8,), got the shape {step.shape}.")
    pose = np.full(8, 5.0)
    moved = np.asarray(_kept(answer, J, residual, 0.3, pose, -far, far))
    require(
        not np.allclose(moved, pose + step, atol=1e-6),
        "You return the new controls: expected the step alone, δ, which is added to them later.",
    )
    apart = np.abs(step - _least_squares(J, residual, 0.3)).max()
    require(
        apart < 1e-6, f"Where no limit is near, expected the damped step itself, got one that is off by {apart:.2g}."
    )
    # controls that rest on a limit, and want to leave it
    J = _system(8, 5)[0]
    pose, residual = np.array([0.0, 1.0, 0.5, 0.0, 1.0]), J @ np.array([0.2, -0.2, 0.1, 0.1, -0.1])
    whole = _least_squares(J, residual, 0.01)
    step = np.asarray(_kept(answer, J, residual, 0.01, pose, np.zeros(5), np.ones(5)))
    require(
        np.abs(step[pose != 0.5]).max() > 1e-9,
        "Your step never moves a control that rests on a limit, though it wants inwards: at first all are free.",
    )
    require(
        np.allclose(step, whole, atol=1e-6),
        "Some controls rest on a limit and none would pass it, so expected the damped step; yours is off by "
        f"{np.abs(step - whole).max():.2g}: compare p + δ with the limits, and hold only what would pass one.",
    )


def _judge(
    answer: Callable,
    J: np.ndarray,
    residual: np.ndarray,
    damping: float,
    controls: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> np.ndarray:
    """Return an answer's step, which has to keep limits, and be best for all controls that are not at one."""
    step = np.asarray(_kept(answer, J, residual, damping, controls, lower, upper))
    reached, whole = controls + step, _least_squares(J, residual, damping)
    past = (reached < lower - SLACK) | (reached > upper + SLACK)
    require(
        not past.any() or not np.allclose(step, whole, atol=1e-6),
        "Your step keeps no limit yet: it is the damped step.",
    )
    require(
        not past.any() or not ((step >= lower - SLACK) & (step <= upper + SLACK)).all(),
        "You compare δ with the limits, which are those of the controls: compare p + δ.",
    )
    require(
        not (past & (np.isclose(step, lower) | np.isclose(step, upper))).any(),
        "The δ of a held control is the limit itself, so p + δ is past it: δ is limit − p.",
    )
    require(
        not past.any(),
        f"After your step {past.sum()} controls are past a limit: mind both limits, and repeat until none passes.",
    )
    passing = (controls + whole < lower - SLACK) | (controls + whole > upper + SLACK)
    room = np.where(whole < 0, lower, upper) - controls
    stays = passing & (np.abs(step) < SLACK) & (np.abs(room) > SLACK) & step.any()
    require(
        not stays.any(),
        "A control that would pass a limit stays where it was in your step, δ = 0: let it go to the limit itself, "
        "δ = limit − p.",
    )
    factor = float(step @ whole) / float(whole @ whole)
    require(
        not np.allclose(step, factor * whole, atol=1e-9),
        "Your step is the damped step times one factor: one control at its limit then stops all; treat each alone.",
    )
    require(
        not np.allclose(step, np.clip(controls + whole, lower, upper) - controls, atol=1e-9),
        "You cut the step, but nobody does the work of the controls you cut: solve again for those still free.",
    )
    inside = (reached > lower + SLACK) & (reached < upper - SLACK)
    slope = J.T @ (residual - J @ step) - damping * step
    alone = J[:, inside].T @ (residual - J[:, inside] @ step[inside]) - damping * step[inside]
    scale = 1e-6 * np.abs(J.T @ residual).max()
    require(
        np.abs(slope[inside]).max(initial=0) < scale or np.abs(alone).max(initial=0) > scale,
        "Your free controls solve for the whole residual: take off what the held ones have moved, J_held δ_held.",
    )
    require(
        np.abs(slope[inside]).max(initial=0) < scale,
        "The free controls could still do better: after each time that you hold some, solve again for the others.",
    )
    return step
