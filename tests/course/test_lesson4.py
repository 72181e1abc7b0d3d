"""Lesson 4: its checks accept the solutions and name the usual mistakes; its pictures draw what they say."""

import numpy as np
import pytest
from lesson_source import answers, assert_told_as_not_begun

from course import lesson4
from course.checks import Wrong
from course.checks.lesson4 import check_angle, check_normals, check_pair
from replicate.base.paths import REFERENCE
from replicate.report.pose_record import TRUTH, WHOLE, load_pose, normal_means_deg, pose_file, vertex_mean_mm

AHEAD = np.array([0.0, 0.0, 1.0])
normals, angle, pair = (answers("lesson4")[name] for name in ("face_normals", "mean_angle", "pair"))


@pytest.fixture(scope="module")
def record():
    return load_pose(pose_file(REFERENCE, "teen"))


@pytest.mark.parametrize(("check", "answer"), [(check_normals, normals), (check_angle, angle), (check_pair, pair)])
def test_a_solution_passes_its_check(check, answer, capsys):
    check(answer)
    assert capsys.readouterr().out.startswith("✓ ")


@pytest.mark.parametrize("check", [check_normals, check_angle, check_pair])
def test_an_exercise_that_nobody_has_begun_is_told_as_such(check):
    assert_told_as_not_begun(check)


def raw(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def divided_by_all(vertices, faces):
    vectors = raw(vertices, faces)
    return vectors / np.linalg.norm(vectors)


def divided_by_columns(vertices, faces):
    vectors = raw(vertices, faces)
    lengths = np.linalg.norm(vectors, axis=0) + np.zeros_like(vectors)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)


def with_nan(vertices, faces):
    vectors = raw(vertices, faces)
    with np.errstate(invalid="ignore"):
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def in_place(vertices, faces):
    vertices -= vertices.mean(0)
    return normals(vertices, faces)


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (raw, "divide each cross product by its own length"),
        (divided_by_all, "divide each row by its own length"),
        (with_nan, "face without area gives NaN"),
        (divided_by_columns, "divides each column"),
        (in_place, "changes its argument"),
        (lambda vertices, faces: -normals(vertices, faces), "point inwards"),
        (lambda vertices, faces: normals(vertices, faces).T[:2], r"got \(2, 3\)"),
        (lambda vertices, faces: normals(vertices, faces)[:, [2, 1, 0]], r"expected \(0, 0, 1\)"),
        (lambda vertices, faces: normals(vertices, faces) + AHEAD, "expected the zero vector"),
    ],
)
def test_wrong_normals_are_named(answer, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_normals(answer)


def angles(ours, theirs):
    return np.degrees(np.arccos(np.clip((ours * theirs).sum(1), -1, 1)))


def of_mean_normals(predicted, target, faces):
    ours, theirs = (normals(mesh, faces).mean(0) for mesh in (predicted, target))
    return float(angles(*(each[None] / np.linalg.norm(each) for each in (ours, theirs)))[0])


def by_area(predicted, target, faces):
    areas = np.linalg.norm(raw(target, faces), axis=1)
    return float(np.average(angles(normals(predicted, faces), normals(target, faces)), weights=areas))


def unclipped(predicted, target, faces):
    with np.errstate(invalid="ignore"):
        return float(np.degrees(np.arccos((normals(predicted, faces) * normals(target, faces)).sum(1))).mean())


def keeps_faces_without_area(predicted, target, faces):
    return float(angles(normals(predicted, faces), normals(target, faces)).mean())


def looks_at_one_mesh_only(predicted, target, faces):
    theirs = normals(target, faces)
    kept = theirs.any(1)
    return float(angles(normals(predicted, faces)[kept], theirs[kept]).mean())


def pairs_of(predicted, target, faces):
    """Each face with every other one; on a large mesh a matrix that nobody has room for."""
    assert len(faces) < 100
    return float(np.degrees(np.arccos(np.clip(normals(predicted, faces) @ normals(target, faces).T, -1, 1))).mean())


def of_mean_cosine(predicted, target, faces):
    ours, theirs = normals(predicted, faces), normals(target, faces)
    kept = ours.any(1) & theirs.any(1)
    return float(np.degrees(np.arccos(np.clip((ours * theirs).sum(1)[kept].mean(), -1, 1))))


def drops_cosines_of_zero(predicted, target, faces):
    cosine = (normals(predicted, faces) * normals(target, faces)).sum(1)
    return float(np.degrees(np.arccos(np.clip(cosine[cosine != 0], -1, 1))).mean())


def counts_as_zero(predicted, target, faces):
    ours, theirs = normals(predicted, faces), normals(target, faces)
    kept = ours.any(1) & theirs.any(1)
    return float(np.where(kept, angles(ours, theirs), 0).mean())


def blind_to_sides(predicted, target, faces):
    return min(angle(predicted, target, faces), 180 - angle(predicted, target, faces))


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (of_mean_normals, "in a mean of normals they cancel"),
        (by_area, "large face counts more"),
        (unclipped, "clip it"),
        (keeps_faces_without_area, "area in the predicted mesh counts as 90°"),
        (looks_at_one_mesh_only, "area in the predicted mesh counts as 90°"),
        (blind_to_sides, "absolute value"),
        (pairs_of, "row by row"),
        (of_mean_cosine, "of each face's cosine first"),
        (drops_cosines_of_zero, "tilted by 90° is left out"),
        (counts_as_zero, "mesh counts as 0°"),
        (lambda predicted, target, faces: np.radians(angle(predicted, target, faces)), "that is radians"),
        (lambda predicted, target, faces: np.cos(np.radians(angle(predicted, target, faces))), "expected 0°"),
        (lambda predicted, target, faces: angles(normals(predicted, faces), normals(target, faces)), "one number"),
    ],
)
def test_a_wrong_mean_angle_is_named(answer, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_angle(answer)


def rippled_by(wave_of):
    def answer(vertices, along, distance):
        wave = wave_of(vertices)
        return vertices + distance * along, vertices + distance * wave[:, None] * along

    return answer


def sine(vertices, length=8.0):
    return np.sin(2 * np.pi * vertices[:, 1] / length)


def faint(vertices, along, distance):
    wave = sine(vertices, 200.0) / np.abs(sine(vertices, 200.0)).mean()
    return vertices + distance * AHEAD, vertices + distance * wave[:, None] * along


def one_spike(vertices):
    wave = np.zeros(len(vertices))
    wave[::100] = 100
    return wave * len(wave) / wave.sum()


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (rippled_by(sine), "divide the wave by the mean of its sizes"),
        (rippled_by(lambda vertices: sine(vertices) / np.sqrt((sine(vertices) ** 2).mean())), "root mean square"),
        (
            rippled_by(lambda vertices: sine(vertices, 80) / np.abs(sine(vertices, 80)).mean()),
            "expected 10 times as much",
        ),
        (rippled_by(one_spike), "spread the change"),
        (lambda vertices, along, distance: pair(vertices, along, distance / 1000), "mm off in the mean"),
        (lambda vertices, along, distance: pair(vertices, along, distance)[1], "Expected two surfaces"),
        (lambda vertices, along, distance: (vertices, along[:5]), "smooth surface is 0 mm off"),
        (faint, "a wave of 36 mm"),
        (lambda vertices, along, distance: pair(vertices, along, distance)[::-1], "the other way round"),
        (lambda vertices, along, distance: (distance * along, distance * along), "the offsets alone"),
        (lambda vertices, along, distance: (vertices + distance * AHEAD, along[:, 0]), r"needs \[:, None\]"),
    ],
)
def test_a_wrong_pair_is_named(answer, sentence):
    with pytest.raises(Wrong, match=sentence):
        check_pair(answer)


def test_a_shift_and_any_ripple_are_a_right_pair_too(capsys):
    def answer(vertices, along, distance):
        noise = np.random.default_rng(0).standard_normal(len(vertices))
        return vertices + distance * AHEAD, vertices + distance * (noise / np.abs(noise).mean())[:, None] * along

    check_pair(answer)
    assert "over a thousand times" in capsys.readouterr().out


def test_a_long_wave_costs_what_the_formula_says():
    x = np.linspace(0, 200, 2001)
    strip = np.stack([np.repeat(x, 2), np.tile([0.0, 1.0], len(x)), np.zeros(2 * len(x))], 1)
    start = 2 * np.arange(len(x) - 1)
    faces = np.concatenate([np.stack([start, start + 2, start + 1], 1), np.stack([start + 1, start + 2, start + 3], 1)])
    for length in (100, 50, 20):
        waved = strip + 0.1 * AHEAD * np.sin(2 * np.pi * strip[:, :1] / length)
        distance = np.abs(waved[:, 2]).mean()
        assert angle(waved, strip, faces) == pytest.approx(360 * distance / length, rel=0.01)


def test_the_first_picture_shows_two_methods_that_the_two_errors_rank_differently(record):
    a, b = lesson4.pair_that_disagrees(record)
    assert vertex_mean_mm(record, a) < vertex_mean_mm(record, b)
    assert normal_means_deg(record, a)[WHOLE] > normal_means_deg(record, b)[WHOLE]


def test_a_profile_says_how_far_off_a_wave_is():
    top, strip = lesson4.profile(40, 0.5).axes
    assert "0.32 mm off, 2.9°" in top.get_title()
    assert np.ptp(strip.images[0].get_array()) > 0


def test_the_chart_has_each_method_once_in_each_pose_and_lines_of_equal_waves(record):
    def millimetres(predicted, target):
        return float(np.linalg.norm(predicted - target, axis=-1).mean())

    figure = lesson4.chart({"folded": record, "again": record}, millimetres, angle, (12, 400))
    (axes,) = figure.axes
    lines = [line for line in axes.lines if len(line.get_xdata()) == 2]
    marks = [line for line in axes.lines if len(line.get_xdata()) == 1]
    assert len(marks) == 2 * len(lesson4.METHODS) and len(lines) == 2
    for line, wave in zip(lines, (12, 400), strict=True):
        assert all(y == pytest.approx(360 * x / wave) for x, y in zip(*line.get_data(), strict=True))


def test_faces_stand_beside_each_other_with_their_errors_below(record):
    meshes = {"the rig": record.vertices[TRUTH], "wrong": record.vertices["lbs32"]}
    figure = lesson4.faces(record, meshes, heat=True)
    pictures = [axes.images[0].get_array() for axes in figure.axes if axes.images]
    assert len(pictures) == 4
    assert len(np.unique(pictures[2].reshape(-1, 3), axis=0)) < len(np.unique(pictures[3].reshape(-1, 3), axis=0))
