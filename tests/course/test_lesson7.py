"""Lesson 7: its checks accept the solutions and name the usual mistakes; its networks and charts are what they say."""

from dataclasses import replace

import numpy as np
import pytest
from lesson_source import answers, assert_told_as_not_begun

from course import lesson7
from course.checks import Wrong
from course.checks.lesson7 import check_jacobian, check_limits, check_step
from data_recipes.controls import Control
from data_recipes.function_rig import FunctionRig
from replicate.geometry.mesh import Mesh

NAMES = ("jacobian", "damped_step", "step_within")


@pytest.fixture(scope="module")
def solved():
    return {name: answers("lesson7")[name] for name in NAMES}


@pytest.fixture(scope="module")
def net():
    return lesson7.networks()


@pytest.mark.parametrize(("name", "check"), zip(NAMES, (check_jacobian, check_step, check_limits), strict=True))
def test_a_solution_passes_its_check(name, check, solved, capsys):
    check(solved[name])
    assert capsys.readouterr().out.startswith("✓ ")


@pytest.mark.parametrize("check", [check_jacobian, check_step, check_limits])
def test_an_exercise_that_nobody_has_begun_is_told_as_such(check):
    assert_told_as_not_begun(check)


def central(places, controls, step):
    moves = step * np.eye(len(controls))
    return (places(controls + moves) - places(controls - moves)).T / (2 * step)


def one_sided(places, controls, step):
    return (places(controls + step * np.eye(len(controls))) - places(controls[None])).T / step


def one_pose_at_a_time(places, controls, step):
    return np.stack([places(controls + step * each) for each in np.eye(len(controls))], 1)


def in_place(places, controls, step):
    controls += step
    return central(places, controls, step)


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (one_sided, "one side only"),
        (one_pose_at_a_time, r"shape \(3,\): it takes \(b, m\)"),
        (in_place, "changes its argument"),
        (lambda places, controls, step: central(places, controls, step).T, "transpose it"),
        (lambda places, controls, step: central(places, controls, step) * 2 * step, "divide the differences by 2h"),
        (lambda places, controls, step: central(places, controls, step) * 2, "twice as large"),
        (lambda places, controls, step: -central(places, controls, step), "wrong sign"),
        (lambda places, controls, step: central(places, 0 * controls, step), "the one at rest"),
        (lambda places, controls, step: central(places, controls, step)[:2], r"got \(2, 3\)"),
        (lambda places, controls, step: central(places, controls, step) + 0.1, "On a parabola"),
        (lambda places, controls, step: central(places, controls, 1e-3), r"by 0\.001 where step = 0\.07"),
    ],
)
def test_a_wrong_jacobian_is_named(answer, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_jacobian(answer)


def damped(J, residual, damping):
    return J.T @ np.linalg.solve(J @ J.T + damping * np.eye(len(J)), residual)


def entries(J, residual, damping):
    return np.linalg.pinv(J.T @ J + damping) @ J.T @ residual


def marquardt(J, residual, damping):
    return np.linalg.pinv(J.T @ J + damping * np.diag(np.diag(J.T @ J))) @ J.T @ residual


def wrong_place(J, residual, damping):
    return np.linalg.pinv(J) @ residual / (1 + damping)


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (lambda J, residual, damping: -damped(J, residual, damping), "the wrong way"),
        (lambda J, residual, damping: np.linalg.pinv(J) @ residual, "no damping in it"),
        (lambda J, residual, damping: damped(J, residual, damping**2), "damped by μ²"),
        (entries, "every entry"),
        (lambda J, residual, damping: J.T @ residual, "that is descent"),
        (lambda J, residual, damping: np.linalg.solve(J.T @ J + damping, J.T @ residual), "every entry"),
        (marquardt, "by the diagonal of JᵀJ"),
        (lambda J, residual, damping: J.T @ residual / damping, "divides by μ alone"),
        (wrong_place, "expected 0"),
        (lambda J, residual, damping: J @ damped(J, residual, damping), r"got \(8,\)"),
    ],
)
def test_a_wrong_step_is_named(answer, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_step(answer)


def test_another_form_of_the_damped_step_is_right_too(capsys):
    check_step(damped)
    assert capsys.readouterr().out.startswith("✓ ")


def held(rounds, left=True, whole=False, at="room", resting=False):
    """Return a step that holds controls at their limits for some rounds, and takes off what they have moved or not.

    at: what a held control's step is: its "room" up to the limit, the "limit" itself, or "nothing".
    resting: True holds from the start what rests on a limit.
    """

    def answer(J, residual, damping, controls, lower, upper):
        step, free = np.zeros(len(controls)), np.ones(len(controls), bool)
        if resting:
            free = (controls > lower) & (controls < upper)
        for _ in range(rounds):
            rest = residual - J[:, ~free] @ step[~free] if left else residual
            step[free] = damped(J[:, free], rest, damping)
            beyond = free & ((controls + step < lower) | (controls + step > upper))
            limit = np.clip(controls + step, lower, upper)
            step[beyond] = {"room": limit - controls, "limit": limit, "nothing": 0 * limit}[at][beyond]
            free = free & ~beyond
        return controls + step if whole else step

    return answer


def compares_steps(J, residual, damping, controls, lower, upper):
    return held(30)(J, residual, damping, 0 * controls, lower, upper)


def unlimited(J, residual, damping, controls, lower, upper):
    return damped(J, residual, damping)


def one_limit_only(J, residual, damping, controls, lower, upper):
    return held(30)(J, residual, damping, controls, lower, np.full(len(controls), np.inf))


def cut(J, residual, damping, controls, lower, upper):
    return np.clip(controls + damped(J, residual, damping), lower, upper) - controls


def by_one_factor(J, residual, damping, controls, lower, upper):
    step = damped(J, residual, damping)
    room = np.where(step < 0, lower - controls, upper - controls)
    return step * min(1.0, float((room / np.where(step == 0, 1.0, step)).min()))


def clips_its_argument(J, residual, damping, controls, lower, upper):
    controls += damped(J, residual, damping)
    return controls


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (unlimited, "keeps no limit"),
        (one_limit_only, "mind both limits"),
        (cut, "nobody does the work"),
        (by_one_factor, "times one factor"),
        (held(30, left=False), "take off what the held ones have moved"),
        (held(2), "could still do better"),
        (held(30, resting=True), "rests on a limit"),
        (held(30, at="nothing"), "stays where it was"),
        (held(30, at="limit"), "limit − p"),
        (compares_steps, r"compare p \+ δ"),
        (held(30, whole=True), "return the new controls"),
        (clips_its_argument, "changes its argument"),
        (lambda *arguments: held(30)(*arguments) * 0.99, "off by"),
    ],
)
def test_a_wrong_step_within_limits_is_named(answer, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_limits(answer)


def test_the_networks_are_those_of_the_teen_and_stand_at_rest_where_its_points_are(net):
    assert len(net.controls) == len(net.default) and len(net.points) == len(net.vertices) == len(set(net.vertices))
    assert (net.lower <= net.default).all() and (net.default <= net.upper).all()
    at_rest = net.places(net.default[None])[0].reshape(-1, 2)
    assert np.linalg.norm(at_rest - net.rest[:, :2], axis=1).max() < 0.1
    left, right = (net.rest[net.points.index(f"mouth_corner_{side}")] for side in ("left", "right"))
    assert left[0] == pytest.approx(-right[0], abs=0.5) and left[0] > 20


def test_a_target_moves_the_points_that_it_names_and_no_others(net):
    moved = (net.targets(chin=(1, -4)) - net.targets()).reshape(-1, 2)
    assert moved[net.points.index("chin")].tolist() == pytest.approx([1, -4])
    assert np.abs(np.delete(moved, net.points.index("chin"), 0)).max() == 0


def test_a_few_rounds_reach_a_smile_within_limits(net, solved):
    target = net.targets(mouth_corner_left=(7, 7), mouth_corner_right=(-7, 7))
    p = net.default
    for _ in range(4):
        p = p + solved["step_within"](net.slopes(p), target - net.places(p[None])[0], 1.0, p, net.lower, net.upper)
    assert lesson7.mean_distance(target, net.places(p[None])[0]) < 0.05
    assert (p >= net.lower - 1e-9).all() and (p <= net.upper + 1e-9).all()


def test_the_suites_answer_and_the_networks_answer_come_near(net):
    target = net.targets(mouth_corner_left=(7, 7), mouth_corner_right=(-7, 7))
    before = lesson7.mean_distance(target, net.targets())
    for way in (lesson7.by_descent, lesson7.by_networks):
        assert lesson7.mean_distance(target, net.places(way(net, target)[None])[0]) < before / 2


def test_the_drags_are_those_of_table_4(net):
    drags = lesson7.drags(net)
    assert len(drags) == 25 and all(np.abs(drag - net.targets()).max() > 2 for drag in drags)


def test_charts_have_a_curve_for_each_network_and_damping():
    (axes,) = lesson7.slope_chart([0.1, 1], {"one": [1, 2], "other": [2, 3]}).axes
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["one", "other"]
    left, right = lesson7.damping_chart(np.diag([4.0, 1.0]), {1: [(3, 3), (2, 2.2)], 9: [(3, 3), (2.5, 2)]}).axes
    assert len(left.lines) == 3 and right.lines[1].get_ydata().tolist() == [3, 2.2]
    assert [text.get_text() for text in right.get_legend().get_texts()] == ["by the network", "on the rig"]
    assert left.lines[0].get_ydata().tolist() == pytest.approx([4 / 17, 0.5])


@pytest.fixture
def board():
    """Return a square board as a rig, whose only control lifts it."""
    neutral = np.float32([[-90, -90, 0], [90, -90, 0], [90, 90, 0], [-90, 90, 0]])
    faces = np.int32([[0, 1, 2], [0, 2, 3]])
    mesh = Mesh(neutral, faces, np.float32([[0, 0], [1, 0], [1, 1], [0, 1]]), np.zeros(4, np.int32), ("board",))
    lift = (Control("lift", 0.0, 0.0, 10.0, "all"),)

    def lifted(params):
        return neutral + params[:, :, None] * np.float32([0, 1, 0])

    return FunctionRig("board", mesh, lift, np.array([0]), np.array([0, 2]), ("all", "all"), None, lifted)


def test_pictures_show_balls_where_points_are_wanted_and_the_rig_is_judged_at_its_points(board, net):
    vertices = board.control_points
    points = replace(net, vertices=vertices, rest=board.mesh.neutral[vertices])
    assert lesson7.on_rig(board, points, np.array([5.0])).tolist() == [-90, -85, 90, 95]
    figure = lesson7.faces(board, points, {"posed": np.zeros(1)}, np.array([0.0, 0.0, 40.0, 40.0]))
    picture = np.asarray(figure.axes[0].images[0].get_array(), int)
    assert ((picture[..., 0] > 180) & (picture[..., 1] < 80)).any()
