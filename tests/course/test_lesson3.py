"""Lesson 3's checks: they accept the solutions, and say what is wrong with usual mistakes."""

import numpy as np
import pytest
from lesson_source import answers
from skinned_sheets import noisy_problem

from course.checks import Wrong
from course.checks.lesson3 import check_align, check_alternate, check_weights
from course.lesson3 import Examples, alone, bone_step, rmse, spread, start, still, tear, wrinkled_pose

SOLVED = answers("lesson3")
align, weights, alternate = (SOLVED[name] for name in ("align", "weights", "alternate"))


@pytest.fixture(scope="module")
def face():
    rest, poses = noisy_problem()
    return Examples(rest, (rest[:, 0] > 0).astype(int), ("left", "right"), poses)


def test_solutions_pass_and_say_how_near_they_are(face, capsys):
    check_align(align, face)
    check_weights(weights, face)
    check_alternate(alternate, face)
    assert capsys.readouterr().out.count("✓") == 3


@pytest.mark.parametrize("check", [check_align, check_weights, check_alternate])
def test_an_exercise_that_is_not_begun_says_so_itself(check, face):
    def stub(*arguments):
        raise NotImplementedError

    with pytest.raises(NotImplementedError):
        check(stub, face)


def best_orthogonal(source, target):
    a, b = source.mean(0), target.mean(0)
    U, _, Vt = np.linalg.svd((source - a).T @ (target - b))
    return U @ Vt, b - a @ U @ Vt


def flips_the_first(source, target):
    a, b = source.mean(0), target.mean(0)
    U, _, Vt = np.linalg.svd((source - a).T @ (target - b))
    R = U @ np.diag([np.linalg.det(U) * np.linalg.det(Vt), 1, 1]) @ Vt
    return R, b - a @ R


def without_means(source, target):
    U, _, Vt = np.linalg.svd(source.T @ target)
    R = U @ np.diag([1, 1, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt
    return R, target.mean(0) - source.mean(0) @ R


def by_the_sign_of_h(source, target):
    a, b = source.mean(0), target.mean(0)
    H = (source - a).T @ (target - b)
    U, _, Vt = np.linalg.svd(H)
    R = U @ np.diag([1, 1, np.sign(np.linalg.det(H))]) @ Vt
    return R, b - a @ R


def with_v_once_too_often_transposed(source, target):
    a, b = source.mean(0), target.mean(0)
    U, _, Vt = np.linalg.svd((source - a).T @ (target - b))
    R = U @ np.diag([1, 1, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt.T
    return R, b - a @ R


ALIGNMENTS = {
    "flat": by_the_sign_of_h,
    "already transposed": with_v_once_too_often_transposed,
    "align returns nothing": lambda s, q: None,
    "must return two things": lambda s, q: align(s, q)[0],
    "inverse of the rotation": lambda s, q: (align(s, q)[0].T, align(s, q)[1]),
    "is no rotation": lambda s, q: ((s - s.mean(0)).T @ (q - q.mean(0)), align(s, q)[1]),
    "subtract each set's mean": without_means,
    "difference of the two means": lambda s, q: (align(s, q)[0], q.mean(0) - s.mean(0)),
    "determinant −1, a reflection": best_orthogonal,
    "smallest singular value": flips_the_first,
}


@pytest.mark.parametrize("sentence", ALIGNMENTS)
def test_a_wrong_alignment_is_told_what_is_wrong(sentence, face):
    with pytest.raises(Wrong, match=sentence):
        check_align(ALIGNMENTS[sentence], face)


def not_normalised(S, old, most=4):
    from scipy.optimize import nnls

    return nnls(np.vstack([S, np.ones(S.shape[1])]), np.append(np.zeros(len(S)), 1.0))[0]


def signed(S, old, most=4):
    y = np.linalg.solve(S.T @ S + 1e-9 * np.eye(len(old)), np.ones(len(old)))
    return y / y.sum()


def clipped(S, old, most=4):
    def solve(columns):
        rows = np.vstack([columns, np.ones(columns.shape[1])])
        x = np.clip(np.linalg.lstsq(rows, np.append(np.zeros(len(columns)), 1.0))[0], 0, None)
        return x / x.sum()

    w = solve(S)
    if np.count_nonzero(w) > most:
        keep = np.argsort(w)[-most:]
        w = np.zeros(len(old))
        w[keep] = solve(S[:, keep])
    return w if np.linalg.norm(S @ w) < np.linalg.norm(S @ old) else old


def without_ones(S, old, most=4):
    from scipy.optimize import nnls

    x, _ = nnls(S, np.zeros(len(S)))
    with np.errstate(invalid="ignore"):
        return x / x.sum()


def never_looks_back(S, old, most=4):
    return weights(S, np.eye(len(old))[np.argmax((S**2).sum(0))], most)


def cut_and_not_solved_again(S, old, most=4):
    w = weights(S, old, most=len(old)).copy()
    w[np.argsort(w)[:-most]] = 0
    w /= w.sum()
    return w if np.linalg.norm(S @ w) < np.linalg.norm(S @ old) else old


def by_distance(S, old, most=4):
    w = 1 / (S**2).sum(0)
    w[np.argsort(w)[:-most]] = 0
    w /= w.sum()
    return w if np.linalg.norm(S @ w) < np.linalg.norm(S @ old) else old


def convex(S):
    from scipy.optimize import nnls

    x = nnls(np.vstack([S, np.ones(S.shape[1])]), np.append(np.zeros(len(S)), 1.0))[0]
    return x / x.sum()


def better(S, w, old):
    return w if np.linalg.norm(S @ w) < np.linalg.norm(S @ old) else old


def keeps(S, old, most, order, again=True):
    w = convex(S)
    if np.count_nonzero(w) > most:
        keep = order(S, w)[-most:]
        cut = np.zeros(len(old))
        cut[keep] = convex(S[:, keep]) if again else w[keep] / w[keep].sum()
        w = cut
    return better(S, w, old)


def keeps_the_smallest(S, old, most=4):
    return keeps(S, old, most, lambda S, w: np.argsort(np.where(w > 0, -w, -np.inf)))


def only_renormalises(S, old, most=4):
    return keeps(S, old, most, lambda S, w: np.argsort(w), again=False)


def chosen_by_length(S, old, most=4):
    return keeps(S, old, most, lambda S, w: np.argsort(-(S**2).sum(0)))


def always_four(S, old, most=4):
    return weights(S, old)


def whole_answer_of_nnls(S, old, most=4):
    from scipy.optimize import nnls

    return nnls(np.vstack([S, np.ones(S.shape[1])]), np.append(np.zeros(len(S)), 1.0))


WEIGHTS = {
    "largest weights, not": keeps_the_smallest,
    "solve for them again": only_renormalises,
    "before nnls|largest weights": chosen_by_length,
    "`most`": always_four,
    "several things": whole_answer_of_nnls,
    "weights is nothing": lambda S, old, most=4: None,
    "sum to .*, not to 1": not_normalised,
    "none may be negative": signed,
    "keep the four largest": lambda S, old, most=4: weights(S, old, most=len(old)),
    "worse than the old ones": never_looks_back,
    "by ¾ and ¼": by_distance,
    "any sign and clip": clipped,
    "row of ones": without_ones,
}


@pytest.mark.parametrize("sentence", WEIGHTS)
def test_wrong_weights_are_told_what_is_wrong(sentence, face):
    with pytest.raises(Wrong, match=sentence):
        check_weights(WEIGHTS[sentence], face)


def test_weights_that_are_all_zero_are_told_of_the_row_of_ones(face):
    with pytest.raises(Wrong, match="row of ones"):
        check_weights(lambda S, old, most=4: 0 * old, face)


def test_weights_that_stay_as_they_were_are_told_so(face):
    with pytest.raises(Wrong, match="by ¾ and ¼"):
        check_weights(lambda S, old, most=4: old, face)


def planted(how):
    """Return an alternation with one mistake."""

    def run(rest, poses, bones, iterations):
        motions, w = start(rest, poses, bones, align)
        S = alone(rest, poses, motions)
        errors = [rmse(S, w, len(poses))]
        for _ in range(iterations):
            if how != "weights never change":
                step = (lambda S, old: weights(S, old, bones)) if how == "all bones" else weights
                w = np.stack([step(s, one) for s, one in zip(S, w, strict=True)])
            if how == "from the start each time":
                last_start, first_w = start(rest, poses, bones, align)
                S = alone(rest, poses, last_start)
                w = np.stack([weights(s, one) for s, one in zip(S, first_w, strict=True)])
                motions = bone_step(rest, poses, w, last_start)
                S = alone(rest, poses, motions)
                errors.append(rmse(S, w, len(poses)))
                continue
            last = still(len(poses), bones) if how == "from rest each time" else motions
            if how == "no bones":
                errors.append(rmse(S, w, len(poses)))
                continue
            motions = bone_step(rest, poses, w, last, sweeps=1 if how == "from rest each time" else 3)
            if how != "old S":
                S = alone(rest, poses, motions)
            errors.append(rmse(S, w, len(poses)))
        if how == "divided by bones":
            errors = [error * np.sqrt(len(poses) / bones) for error in errors]
        if how == "motions first":
            return motions, w, errors
        return w, motions, errors[1:] if how == "without the start" else errors

    return run


ALTERNATIONS = {
    "all bones": "at most|has [0-9]+ bones",
    "old S": "call alone again",
    "from rest each time": "Your error rises",
    "from the start each time": "taking turns",
    "no bones": "motions are those of the start",
    "divided by bones": "number of poses",
    "motions first": "in this order",
    "without the start": "after the start and each iteration",
}


@pytest.mark.parametrize("how", ALTERNATIONS)
def test_a_wrong_alternation_is_told_what_is_wrong(how, face):
    with pytest.raises(Wrong, match=ALTERNATIONS[how]):
        check_alternate(planted(how), face)


def test_an_alternation_that_returns_too_little_is_told_so(face):
    with pytest.raises(Wrong, match="must return three things"):
        check_alternate(lambda *arguments: alternate(*arguments)[0], face)


def test_what_remains_alone_has_the_length_of_the_whole_column(face):
    rest, poses = face.rest[:40].astype(float), face.training[:9, :40].astype(float)
    motions, w = start(rest, poses, 3, align)
    left = np.linalg.norm(np.einsum("nkb,nb->nk", alone(rest, poses, motions), w), axis=1)
    posed = np.einsum("nb,fnbj->fnj", w, np.einsum("ni,fbij->fnbj", rest, motions[0]) + motions[1][:, None])
    assert left == pytest.approx(np.sqrt(((posed - poses) ** 2).sum((0, 2))))


def test_a_bone_step_never_raises_the_error(face):
    rest, poses = face.rest.astype(float), face.training.astype(float)
    motions, w = start(rest, poses, 5, align)
    w = np.random.default_rng(0).dirichlet(np.ones(5), len(rest))
    errors = []
    for _ in range(4):
        errors.append(rmse(alone(rest, poses, motions), w, len(poses)))
        motions = bone_step(rest, poses, w, motions)
    assert (np.diff(errors) < 0).all()


def test_weights_spread_to_vertices_that_move_alike(face):
    w = np.eye(2)[face.segment]
    few = np.arange(0, len(face.rest), 2)
    of_all = spread(w[few], few, face)
    assert of_all.sum(1) == pytest.approx(np.ones(len(of_all)))
    assert (of_all[face.segment == 1, 1].mean(), of_all[face.segment == 0, 0].mean()) > (0.9, 0.9)


def test_a_tear_is_found_where_the_error_jumps():
    record = wrinkled_pose()
    guess = record.vertices["truth"].copy()
    one, other = tear(record, guess + np.random.default_rng(0).normal(0, 0.01, guess.shape))
    guess[one] += 3.0
    assert one in tear(record, guess)
    assert np.linalg.norm(record.neutral[one] - record.neutral[other]) < 10
