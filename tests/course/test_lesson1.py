"""Lesson 1's checks: they accept the solutions, and say what is wrong with usual mistakes."""

import numpy as np
import pytest
import rigs
from lesson_source import answers

from course.checks import Wrong
from course.checks.lesson1 import check_bend, check_soft_limit, check_turn_jaw

SOLVED = answers("lesson1")
soft_limit, turn_jaw, bend = (SOLVED[name] for name in ("soft_limit", "turn_jaw", "bend"))


@pytest.fixture(scope="module")
def rig():
    return rigs.rig("tiny")


def test_solutions_pass_and_say_how_near_they_are(rig, capsys):
    check_soft_limit(soft_limit, rig)
    check_turn_jaw(turn_jaw, rig)
    check_bend(bend, rig)
    said = capsys.readouterr().out
    assert said.count("✓") == 3 and "0.25" in said


def test_the_other_way_of_the_text_passes_too(rig):
    from scipy.spatial.transform import Rotation

    def by_scipy(x, weight, pivot, rotation, translation):
        turned = Rotation.from_rotvec(weight[:, None] * rotation).apply(x - pivot)
        return turned + pivot + weight[:, None] * translation

    check_turn_jaw(by_scipy, rig)


def changed(x, below, above):
    x /= (1 + (x / np.where(x < 0, below, above)) ** 6) ** (1 / 6)
    return x


def odd_power(x, below, above):
    with np.errstate(all="ignore"):
        return x / (1 + (x / np.where(x < 0, below, above)) ** 5) ** (1 / 5)


LIMITS = {
    "returns nothing": lambda x, below, above: None,
    "must return an array of the shape": lambda x, below, above: float(soft_limit(x, below, above).sum()),
    "changes its first argument": changed,
    "no finite number": odd_power,
    "keep its sign": lambda x, below, above: np.abs(soft_limit(x, below, above)),
    "u is -3, beyond the limit of 2": lambda x, below, above: x,
    "only 0.91 of z": lambda x, below, above: x / (1 + np.abs(x) / np.where(x < 0, below, above)),
    "u is -2.99, beyond the limit": lambda x, below, above: x / (1 + (x / (below + above)) ** 6) ** (1 / 6),
    "off the rig's node": lambda x, below, above: x / (1 + (x / np.where(x < 0, below, above)) ** 8) ** (1 / 8),
}


@pytest.mark.parametrize("sentence", LIMITS)
def test_a_wrong_limit_is_told_what_is_wrong(rig, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_soft_limit(LIMITS[sentence], rig)


def rodrigues(x, weight, pivot, rotation, translation):
    """The formula as it stands, 0 / 0 and all."""
    turn = weight[:, None] * rotation
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    once = np.cross(turn, x - pivot)
    with np.errstate(all="ignore"):
        moved = x + np.sin(angle) / angle * once + (1 - np.cos(angle)) / angle**2 * np.cross(turn, once)
    return moved + weight[:, None] * translation


def in_place(x, weight, pivot, rotation, translation):
    x -= pivot
    return turn_jaw(x, weight, 0 * pivot, rotation, translation) + pivot


def blended(x, weight, pivot, rotation, translation):
    whole = turn_jaw(x, np.ones(len(x)), pivot, rotation, translation)
    return x + weight[:, None] * (whole - x)


def small_angle(x, weight, pivot, rotation, translation):
    return x + weight[:, None] * (np.cross(rotation, x - pivot) + translation)


JAWS = {
    "0 / 0": rodrigues,
    "changes its first argument": in_place,
    "must return an array of the shape": lambda x, w, o, r, t: turn_jaw(x, w, o, r, t).T,
    "every vertex by the pivot": lambda x, w, o, r, t: turn_jaw(x, w, o, r, t) - o,
    "the rotation moves them": lambda x, w, o, r, t: turn_jaw(x, 1 + 0 * w, o, r, 0 * t) + w[:, None] * t,
    "the translation moves them": lambda x, w, o, r, t: turn_jaw(x, w, o, r, 0 * t) + t,
    "weight 0 become NaN": lambda x, w, o, r, t: turn_jaw(x, np.where(w > 0, w, np.nan), o, r, t),
    "The pivot itself moves": lambda x, w, o, r, t: turn_jaw(x, w, 0 * o, r, t),
    "changes distances": small_angle,
    "opens upwards": lambda x, w, o, r, t: turn_jaw(x, w, o, -r, t),
    "in radians already": lambda x, w, o, r, t: turn_jaw(x, w, o, np.deg2rad(r), t),
    "half of the translation": lambda x, w, o, r, t: turn_jaw(x, w, o, r, 0 * t) + t * (w[:, None] > 0),
    "along the arc": blended,
}


@pytest.mark.parametrize("sentence", JAWS)
def test_a_wrong_jaw_is_told_what_is_wrong(rig, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_turn_jaw(JAWS[sentence], rig)


def tangent(low, high):
    def answer(face, rest, direction, t):
        velocity = (face(rest + high * direction) - face(rest - low * direction)) / (low + high)
        return face(rest + t * direction) - (face(rest) + t * velocity)

    return answer


def scaled(factor):
    """Return an answer whose velocity is wrong by a factor."""

    def answer(face, rest, direction, t):
        start = face(rest)
        velocity = (face(rest + 0.01 * direction) - face(rest - 0.01 * direction)) / 0.02
        return face(rest + t * direction) - (start + t * factor * velocity)

    return answer


def a_bracket_short(face, rest, direction, t):
    h = 0.01
    velocity = face(rest + h * direction) - face(rest - h * direction) / (2 * h)
    return face(rest + t * direction) - (face(rest) + t * velocity)


def along_unit(face, rest, direction, t):
    unit = direction / np.linalg.norm(direction)
    velocity = (face(rest + 0.01 * unit) - face(rest - 0.01 * unit)) / 0.02
    return face(rest + t * direction) - (face(rest) + t * velocity)


def chord(face, rest, direction, t):
    return face(rest + t * direction) - (face(rest) + t * (face(rest + direction) - face(rest)))


BENDS = {
    "write `/ \\(2 \\* h\\)`": scaled(0.01**2),
    "twice too long": scaled(2),
    "half too short": scaled(0.5),
    "Yours adds the tangent": scaled(-1),
    "lacks the factor t": lambda face, rest, direction, t: scaled(1 / t)(face, rest, direction, t),
    "brackets around the difference": a_bracket_short,
    "divided by its length": along_unit,
    "for t counts in its lengths": lambda face, rest, direction, t: bend(
        face, rest, direction / np.linalg.norm(direction), t
    ),
    "wrong sign": lambda face, rest, direction, t: -bend(face, rest, direction, t),
    "a chord from `rest`": chord,
    "however large t is": lambda face, rest, direction, t: 0 * face(rest),
    "how far the face moves": lambda face, rest, direction, t: face(rest + t * direction) - face(rest),
    "is multiplied by t": lambda face, rest, direction, t: bend(face, rest, direction, t) + (1 - t) * face(rest),
    "shape": lambda face, rest, direction, t: np.linalg.norm(bend(face, rest, direction, t), axis=1),
    "on both sides": tangent(0.0, 0.01),
    "single precision spoils": tangent(1e-6, 1e-6),
}


@pytest.mark.parametrize("sentence", BENDS)
def test_a_wrong_bend_is_told_what_is_wrong(rig, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_bend(BENDS[sentence], rig)


def test_an_exercise_that_is_not_begun_says_so(rig):
    def empty(*_):
        raise NotImplementedError

    for check in (check_soft_limit, check_turn_jaw, check_bend):
        with pytest.raises(NotImplementedError):
            check(empty, rig)
