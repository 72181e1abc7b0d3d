"""Checks of lesson 4: face normals, Eq. 11, and two surfaces that are equally far off."""

from collections.abc import Callable
from functools import cache, partial

import numpy as np

from course.checks import given_by, passed, require
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.base.paths import REFERENCE
from replicate.geometry.mesh import face_normals, vertex_normals
from replicate.report.pose_record import TRUTH, PoseRecord, load_pose, pose_file

METHODS = ("dense", "lbs32")  # whose predictions an answer is tried on
SLACK_DEG = 0.05  # arccos loses half of its digits near 0°


@cache
def _teen() -> PoseRecord:
    return load_pose(pose_file(REFERENCE, "teen"))


_kept = partial(given_by, example="`b -= a` writes into an array, `b - a` makes a new one")


# A right angle's corner in the plane z = 0, seen from +z counter-clockwise, and a face that has shrunk to a line.
CORNERS = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 1], [4, 0, 0]], np.float64)
FACES = np.array([[0, 1, 2], [0, 2, 3], [0, 1, 4]], np.int32)
TETRAHEDRON = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]], np.int32)  # of the first four corners


def check_normals(answer: Callable) -> None:
    """Check `face_normals`. Raises Wrong with what is wrong."""
    normals = np.asarray(_kept(answer, CORNERS, FACES))
    require(
        normals.shape == (3, 3),
        f"Expected one normal (x, y, z) for each of the 3 faces, the shape (3, 3), got {normals.shape}.",
    )
    corners = np.asarray(_kept(answer, CORNERS, TETRAHEDRON))
    vectors = np.cross(*(CORNERS[TETRAHEDRON[:, k]] - CORNERS[TETRAHEDRON[:, 0]] for k in (1, 2)))
    require(
        not np.allclose(corners, vectors / np.linalg.norm(vectors, axis=0)),
        "Yours divides each column (all x, all y, all z) by its length: a normal is a row, so take the norm "
        "by axis=1 and keepdims=True.",
    )
    require(
        not np.isnan(normals).any(),
        "Your face without area gives NaN: give it the zero vector, and divide only where the length isn't zero.",
    )
    require(not normals[2].any(), f"Your face without area has the normal {normals[2]}: expected the zero vector.")
    length = np.linalg.norm(normals[0])
    require(
        abs(length - 6) > 1e-6,
        "Your normals are as long as twice their faces' areas: divide each cross product by its own length.",
    )
    require(
        abs(length - 1) < 1e-6 and abs(np.linalg.norm(normals[1]) - 1) < 1e-6,
        f"Your normals have the length {length:.3g}, not 1: divide each row by its own length (axis=1, keepdims=True).",
    )
    require(
        not np.allclose(normals[0], (0, 0, -1)),
        "Your normals point inwards: take (b − a) × (c − a), in this order; corners go counter-clockwise.",
    )
    require(
        np.allclose(normals[:2], [(0, 0, 1), (1, 0, 0)], atol=1e-6),
        f"Your first face lies in the plane z = 0 and has the normal {np.round(normals[0], 3)}: expected (0, 0, 1).",
    )
    record = _teen()
    vertices, faces = record.vertices[TRUTH], record.faces
    apart = np.abs(np.asarray(_kept(answer, vertices, faces)) - face_normals(vertices, faces)).max()
    require(
        apart < 1e-4,
        f"On the teen's face one of your normals is off by {apart:.2g}: do you add something to the lengths?",
    )
    passed(f"your {len(faces):,} normals of the teen equal the suite's to {max(apart, 1e-7):.0e}, and none is NaN")


def _hinge(degrees: float) -> np.ndarray:
    """Return a small and a large triangle on two sides of the x axis, each folded up or down by an angle."""
    up = np.radians(degrees)
    small, large = np.array([0.5, np.cos(up), np.sin(up)]), np.array([0.5, -10 * np.cos(up), 10 * np.sin(up)])
    return np.stack([np.zeros(3), np.array([1.0, 0, 0]), small, large])


HINGE = np.array([[0, 1, 2], [1, 0, 3]], np.int32)


def check_angle(answer: Callable) -> None:
    """Check `mean_angle`. Raises Wrong with what is wrong."""
    _check_plain_angles(answer)
    _check_faces_without_area(answer)
    record = _teen()
    truth, found = record.vertices[TRUTH], []
    for name in METHODS:
        guess = record.vertices[name]
        ours, exact = _number(answer, guess, truth, record.faces), np.nanmean(normal_error(guess, truth, record.faces))
        require(
            abs(ours - exact) < SLACK_DEG,
            f"For {name} on the teen yours is {ours:.2f}° and the suite's {exact:.2f}°: is it a mean over faces?",
        )
        found.append(f"{ours:.2f}° for {name}")
    passed(f"your Eq. 11 equals the suite's on the teen, {' and '.join(found)}, and leaves out faces without area")


def _number(answer: Callable, predicted: np.ndarray, target: np.ndarray, faces: np.ndarray) -> float:
    given = _kept(answer, predicted, target, faces)
    require(np.ndim(given) == 0, f"Expected one number, the mean, got an array of shape {np.shape(given)}.")
    return float(given)


def _check_plain_angles(answer: Callable) -> None:
    square = _number(answer, CORNERS, CORNERS, FACES[:2])
    require(
        abs(square - 45) > 1,
        "Two faces at right angles, compared with themselves, give 45°: compare row by row, (a * b).sum(axis=1); "
        "a @ b.T compares each face with every other one.",
    )
    record = _teen()
    truth = record.vertices[TRUTH]
    same = _number(answer, truth, truth, record.faces)
    require(
        not np.isnan(same),
        "A mesh compared with itself gives NaN: rounding takes n·n past 1; clip it to [−1, 1] before arccos.",
    )
    require(same < SLACK_DEG, f"A mesh compared with itself gives {same:.3g}°: expected 0°.")
    flat, folded = _hinge(0), _hinge(30)
    lone = HINGE[:1]
    tilt = _number(answer, folded, flat, lone)
    require(abs(tilt - np.radians(30)) > 1e-3, "A face tilted by 30° gives 0.52: that is radians; Table 2 has degrees.")
    require(
        abs(tilt - np.cos(np.radians(30))) > 1e-3, "A face tilted by 30° gives 0.87: that is the cosine, not the angle."
    )
    require(abs(tilt - 30) < SLACK_DEG, f"A face tilted by 30° gives {tilt:.2f}°.")
    fold = _number(answer, folded, flat, HINGE)
    require(
        fold > 1,
        "Two faces tilted by 30° in opposite directions give 0°: take each face's angle first and the mean of angles "
        "last; in a mean of normals they cancel.",
    )
    require(abs(fold - 30) < SLACK_DEG, f"Two faces tilted by 30° give {fold:.2f}° in the mean: expected 30°.")
    mixed = flat.copy()
    mixed[2] = folded[2]  # the small face alone
    half = _number(answer, mixed, flat, HINGE)
    require(
        abs(half - 30 / 11) > 0.5,
        "A large face counts more than a small one in yours: in Eq. 11 each counts once; make normals unit "
        "vectors before you compare them.",
    )
    require(
        abs(half - np.degrees(np.arccos((1 + np.cos(np.radians(30))) / 2))) > 0.1,
        f"One face of two tilted by 30° gives {half:.1f}°, expected 15°: take arccos of each face's cosine first "
        "and the mean last.",
    )
    require(abs(half - 15) < SLACK_DEG, f"One face of two tilted by 30° gives {half:.2f}°: expected 15°.")
    upright = flat.copy()
    upright[2] = (0.5, 0, 1)  # the small face: its cosine is exactly 0
    right = _number(answer, upright, flat, HINGE)
    require(
        right > 1,
        "A face tilted by 90° is left out in yours: its cosine is 0, too; faces without area are those with a zero "
        "normal, so ask `.any(axis=1)` of each mesh's normals.",
    )
    require(abs(right - 45) < SLACK_DEG, f"One face of two tilted by 90° gives {right:.2f}°: expected 45°.")
    over = flat[:, [1, 0, 2]]  # mirrored: the face is seen from behind
    behind = _number(answer, over, flat, lone)
    require(
        abs(behind - 180) < SLACK_DEG,
        f"A face turned inside out gives {behind:.1f}°: expected 180°; is there an absolute value around the cosine?",
    )


def _check_faces_without_area(answer: Callable) -> None:
    flat, folded = _hinge(0), _hinge(30)
    for which in ("predicted", "true"):
        meshes = {"predicted": folded.copy(), "true": flat.copy()}
        meshes[which][3] = meshes[which][0]  # the large face has shrunk to a line there
        given = _number(answer, meshes["predicted"], meshes["true"], HINGE)
        require(
            not np.isnan(given),
            f"A face without area in the {which} mesh gives NaN: leave it out of the mean, as Eq. 11 does.",
        )
        require(
            abs(given - 15) > 1 and abs(given - 60) > 1,
            f"A face without area in the {which} mesh counts as {round(2 * given - 30)}°: leave it out of the sum and "
            "of f, as Eq. 11 does.",
        )
        require(abs(given - 30) < SLACK_DEG, f"With a face without area left out expected 30°, got {given:.2f}°.")


RATIO, LARGEST = 10, 5  # rippled over smooth, in degrees; the farthest vertex over the mean one


def check_pair(answer: Callable) -> None:
    """Check `pair`. Raises Wrong with what is wrong."""
    record = _teen()
    degrees = []
    for vertices, distance in ((record.vertices[TRUTH], 0.3), (record.neutral, 0.1)):
        degrees = _degrees_of_pair(answer, vertices, record.faces, distance)
        smooth, rippled = degrees
        require(smooth < RATIO * rippled, "Yours come the other way round: `return smooth, rippled`, in this order.")
        require(
            rippled >= RATIO * smooth,
            f"At {distance} mm your rippled surface has {rippled:.2f}° and your smooth one {smooth:.2f}°, expected "
            f"{RATIO} times as much: make the wave shorter, or the smooth one's change slower across the face.",
        )
        require(
            rippled >= RATIO * distance,
            f"At {distance} mm your rippled surface has only {rippled:.2f}°: a wave of 36 mm has that much; make "
            "yours shorter.",
        )
    ratio = "over a thousand" if rippled > 1000 * smooth else f"{rippled / smooth:.0f}"
    passed(f"0.1 mm each: {smooth:.2f}° and {rippled:.2f}°, {ratio} times as much, and the mean distance can't tell")


def _degrees_of_pair(answer: Callable, vertices: np.ndarray, faces: np.ndarray, distance: float) -> tuple[float, float]:
    """Return the normal errors of an answer's two surfaces, which have to be as far off as they should."""
    given = _kept(answer, vertices, vertex_normals(vertices, faces), distance)
    require(isinstance(given, tuple | list) and len(given) == 2, "Expected two surfaces: `return smooth, rippled`.")
    found = []
    for name, surface in zip(("smooth", "rippled"), map(np.asarray, given), strict=True):
        require(
            surface.shape == vertices.shape,
            f"Your {name} surface has the shape {surface.shape}: expected {vertices.shape}; a wave (n,) "
            "needs [:, None] to multiply normals (n, 3).",
        )
        require(np.isfinite(surface).all(), f"Your {name} surface has numbers that are not finite.")
        sizes = np.linalg.norm(surface.astype(float), axis=1)
        require(
            sizes.max() > 2 * LARGEST * distance,
            f"Your {name} surface is the offsets alone, at most {sizes.max():.2g} mm from the origin: add `vertices`.",
        )
        moved = vertex_error(surface, vertices)
        mean, root = float(moved.mean(dtype=float)), float(np.sqrt((moved.astype(float) ** 2).mean()))
        require(
            abs(mean - distance) < 0.01 * distance or abs(root - distance) > 0.002 * distance,
            f"Your {name} surface is {root:.3f} mm off by its root mean square, {mean:.3f} in the mean: divide by "
            "the mean of the wave's sizes.",
        )
        require(
            abs(mean - distance) < 0.01 * distance,
            f"Your {name} surface is {mean:.3g} mm off in the mean, expected {distance}: divide the wave by the "
            "mean of its sizes, np.abs(wave).mean(), before you multiply.",
        )
        require(
            moved.max() <= LARGEST * distance,
            f"One vertex of your {name} surface moves by {moved.max():.2g} mm, {moved.max() / distance:.0f} times the "
            "mean: spread the change over the face.",
        )
        found.append(float(np.nanmean(normal_error(np.asarray(surface, float), vertices.astype(float), faces))))
    return found[0], found[1]
