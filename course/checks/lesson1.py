"""What lesson 1 asks for: a soft limit, a jaw, and how far a face is from its tangent."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from course.checks import passed, require
from data_recipes.deformers import jaw, pose_curves
from data_recipes.deformers.face import jaw_motion
from data_recipes.face_rig import FaceRig

POSES = 20
NEAR_MM = 1e-4  # single precision, on a head of 200 mm
IN_PLACE = "Your function changes its first argument; return a new array, for other nodes need the old one."
NEAR_LIMIT = 2e-6  # the same, on controls about 1


def check_soft_limit(soft_limit: Callable, rig: FaceRig) -> None:
    """Require a limit that is silent at rest, knows its sides, and equals the rig's node "limit"."""
    below, above = np.array([0.2, 1.3, 2.0]), np.array([1.3, 1.3, 4.0])
    z = np.array([0.0, 1.5, -3.0])
    before = z.copy()
    u = _array(soft_limit(z, below, above), z.shape, "soft_limit")
    require((z == before).all(), IN_PLACE)
    require(np.isfinite(u).all(), "Your u has a value that is no finite number: which root do you take of a negative?")
    require(u[0] == 0, f"At rest z is 0 and u must be 0, but yours is {u[0]:.3g}: a node is silent at rest.")
    require(u[2] <= 0, f"At z = −3 your u is {u[2]:.3g}: a control must keep its sign.")
    require((u >= -below).all() and (u <= above).all(), _beyond(z, u, below, above))
    small = _array(soft_limit(0.1 * above, below, above), z.shape, "soft_limit")
    slope = float((small / (0.1 * above)).min())
    require(slope > 0.99, f"Near rest your u is only {slope:.2f} of z: there the limit should change next to nothing.")
    swapped = -soft_limit(np.array([1.0]), np.array([2.0]), np.array([0.5]))
    found = float(soft_limit(np.array([-1.0]), np.array([0.5]), np.array([2.0]))[0])
    require(
        abs(found - swapped[0]) < 1e-9,
        f"At z = −1 with the limits 0.5 below and 2 above your u is {found:.3f}: take c on the side where z is.",
    )
    limits = rig.face.constants["limits"]
    generator = np.random.default_rng([1, len(rig.controls)])
    poses = generator.uniform(-3, 3, (POSES, len(rig.controls))).astype(np.float32)
    theirs = np.asarray(pose_curves.saturate(limits, poses))
    ours = np.stack([soft_limit(pose - limits["default"], limits["below"], limits["above"]) for pose in poses])
    off = float((np.abs(ours - theirs) / np.maximum(1, np.abs(theirs))).max())
    require(off < NEAR_LIMIT, f"On random controls yours is {off:.2g} off the rig's node: compare with the formula.")
    passed(f"your limit is silent at rest and equals the rig's node within {off:.1g} on {POSES} wild poses")


def _beyond(z: np.ndarray, u: np.ndarray, below: np.ndarray, above: np.ndarray) -> str:
    k = int(np.argmax(np.maximum(u - above, -below - u)))
    limit = above[k] if z[k] >= 0 else below[k]
    return f"At z = {z[k]:g} your u is {u[k]:.3g}, beyond the limit of {limit:g} on that side."


def check_turn_jaw(turn_jaw: Callable, rig: FaceRig) -> None:
    """Require a jaw that is silent at rest, rigid where it must be, on arcs, and equal to the rig's node."""
    pivot, still = np.array([2.0, -30.0, 10.0]), np.zeros(3)
    generator = np.random.default_rng(1)
    x = pivot + generator.normal(0, 40, (8, 3))
    x[0] = pivot + np.array([0.0, 0.0, 60.0])  # before the pivot, as a chin
    ones, turn, glide = np.ones(8), np.array([0.5, 0.1, 0.0]), np.array([1.0, -4.0, 2.0])
    _rest(turn_jaw, x, pivot)
    _rotation(turn_jaw, x, ones, pivot, turn)
    # shares of the motion
    share = np.array([0.0, 0.5, 1.0, 0.25, 0.75, 0.5, 0.0, 1.0])
    shifted = turn_jaw(x, share, pivot, still, glide) - x
    require(
        np.allclose(shifted, share[:, None] * glide, atol=1e-9),
        f"Without a turn a vertex of weight 0.5 glides {np.linalg.norm(shifted[1]):.2f} mm of "
        f"{np.linalg.norm(glide):.2f} mm: it takes half of the translation, too.",
    )
    half, arc = (turn_jaw(x, w * ones, pivot, k * turn, still) for w, k in ((0.5, 1.0), (1.0, 0.5)))
    off = float(np.linalg.norm(half - arc, axis=1).max())
    require(
        off < 1e-6,
        f"A vertex of weight 0.5 ends {off:.1f} mm from where half of the angle takes it: turn by w·r along the arc, "
        "and do not mix positions before and after the turn, which cuts it short.",
    )
    _same_as_the_rig(turn_jaw, rig)


def _rest(turn_jaw: Callable, x: np.ndarray, pivot: np.ndarray) -> None:
    before, still = x.copy(), np.zeros(3)
    rested = _array(turn_jaw(x, np.ones(len(x)), pivot, still, still), x.shape, "turn_jaw")
    require(
        np.isfinite(rested).all(),
        "At rest your jaw gives NaN: the angle is 0 there, and sin φ / φ is 0 / 0; its limit is 1.",
    )
    require((x == before).all(), IN_PLACE)
    require(
        not np.allclose(np.abs(rested - x), np.abs(pivot), atol=1e-9),
        "At rest your jaw moves every vertex by the pivot: subtract it before the turn, and add it again after.",
    )
    off = float(np.abs(rested - x).max())
    require(off < 1e-9, f"At rest your jaw moves a vertex by {off:.2g} mm; a node is silent at rest.")
    motions = {
        "translation": (still, np.ones(3), "multiply t by w, too"),
        "rotation": (np.array([0.4, 0.0, 0.0]), still, "turn by q = w·r, not by r"),
    }
    for name, (rotation, translation, cure) in motions.items():
        turned = turn_jaw(x, np.zeros(len(x)), pivot, rotation, translation)
        require(
            np.isfinite(turned).all(),
            "Vertices of weight 0 become NaN: their angle is 0, and sin φ / φ is 0 / 0; its limit is 1.",
        )
        require(
            np.allclose(turned, x, atol=1e-9),
            f"Vertices of weight 0 belong to the skull, but the {name} moves them in yours: {cure}.",
        )
    require((x == before).all(), IN_PLACE)


def _rotation(turn_jaw: Callable, x: np.ndarray, ones: np.ndarray, pivot: np.ndarray, turn: np.ndarray) -> None:
    still = np.zeros(3)
    moved = turn_jaw(np.vstack([x, pivot]), np.append(ones, 1.0), pivot, turn, still)
    off = float(np.linalg.norm(moved[-1] - pivot))
    require(off < 1e-6, f"The pivot itself moves by {off:.1f} mm: subtract it before the turn and add it again after.")
    before, after = (np.linalg.norm(points - points[:1], axis=1) for points in (x, moved[:-1]))
    longer = float(np.abs(after / np.maximum(before, 1e-9) - 1)[1:].max())
    require(
        longer < 1e-6,
        f"Your turn changes distances on the jaw by up to {100 * longer:.1f} %: a turn keeps them all, so compare both "
        "quotients of Rodrigues with the formula.",
    )
    angle = 0.4
    chin = (turn_jaw(x[:1], ones[:1], pivot, np.array([angle, 0.0, 0.0]), still) - pivot)[0]
    found = float(np.arctan2(-chin[1], chin[2]))
    require(abs(found + angle) > 1e-6, "Your jaw opens upwards: the cross product is q × a, in this order.")
    require(
        abs(found - angle) < 1e-6,
        f"Of a turn by {angle} radians about x yours makes {found:.3g}: rotations are in radians already, and the "
        "length of q is the angle.",
    )
    require(
        np.allclose(turn_jaw(moved[:-1], ones, pivot, -turn, still), x, atol=1e-6),
        "Turned by r and then by −r, your jaw does not come back: a turn is undone by the opposite one.",
    )


def _same_as_the_rig(turn_jaw: Callable, rig: FaceRig) -> None:
    own, neutral = rig.face.constants["jaw"], rig.mesh.neutral
    weight = np.zeros(len(neutral), np.float32)
    weight[own["support"]] = own["weight"]
    generator, off = np.random.default_rng(2), 0.0
    for controls in generator.uniform(-1, 1.3, (POSES, len(rig.controls))).astype(np.float32):
        motion = jaw_motion(rig.face.constants, controls[None])
        theirs = np.asarray(jaw.open_jaw(own, neutral.T[None], motion))[0].T
        turn, shift = np.asarray(motion.rotation)[0], np.asarray(motion.translation)[0]
        ours = turn_jaw(neutral, weight, own["pivot"], turn, shift)
        off = max(off, float(np.abs(ours - theirs).max()))
    require(off < NEAR_MM, f"On {POSES} poses of {rig.name} your jaw is up to {off:.2g} mm off the rig's node.")
    passed(f"your jaw is silent at rest and equals the rig's node within {off:.1g} mm on {POSES} poses of {rig.name}")


def check_bend(bend: Callable, rig: FaceRig) -> None:
    """Require the remainder of a tangent: 0 on a line, exact on a parabola, and that of the rig's own jaw."""
    generator = np.random.default_rng(3)
    line, curve, start = (generator.normal(size=shape) for shape in ((4, 6, 3), (6, 3), (6, 3)))
    rest, direction = np.array([0.0, 1.0, -0.5, 0.2]), np.array([0.5, 0.0, 2.0, -1.0])

    def straight(p: np.ndarray) -> np.ndarray:
        return start + np.tensordot(p, line, 1)

    def parabola(p: np.ndarray) -> np.ndarray:
        return straight(p) + curve * float(p @ direction) ** 2

    _line(bend, straight, rest, direction)
    t = 0.25
    square = float(direction @ direction)
    exact = (t * square) ** 2 * curve
    ratio = float((bend(parabola, rest, direction, t) * exact).sum() / (exact * exact).sum())
    require(abs(ratio + 1) > 1e-3, "Yours has the wrong sign: b(t) is the face minus its tangent.")
    require(abs(ratio - 1 / square) > 1e-3, UNIT)
    require(
        abs(ratio - 1) < 0.5,
        f"On a parabola yours is {ratio:.2f} times what it should be: the tangent comes from the step h = 0.01, "
        "however large t is; a chord from `rest` to a face far away is none.",
    )
    require(
        abs(ratio - 1) < 1e-3,
        f"On a parabola yours is {ratio:.2f} times what it should be: take the difference on both sides of `rest`; on "
        "one side it sees the bend itself, and the smaller its step, the more it sees of single precision.",
    )
    _same_as_the_jaw(bend, rig)


UNIT = "Your direction is divided by its length: take it as it is given, for t counts in its lengths."


def _line(bend: Callable, straight: Callable, rest: np.ndarray, direction: np.ndarray) -> None:
    """Require that nothing is left of a face that is linear in its controls."""
    t = 0.4
    start = straight(rest)
    first, whole = (
        _array(bend(straight, rest, direction, t), start.shape, "bend"),
        straight(rest + t * direction) - start,
    )
    left = float((first * whole).sum() / (whole * whole).sum())  # in units of the whole motion
    if np.allclose(first, left * whole, atol=1e-6):
        require(abs(left - 1) > 1e-6, "Yours is how far the face moves: take off t times the tangent, too.")
        require(abs(left - 1) > 1e-3, "`/ 2 * h` divides by 2 and then multiplies by h: write `/ (2 * h)`.")
        require(
            abs(left + 1) > 1e-3, "Your tangent is twice too long: both sides are 2h apart, so divide by `(2 * h)`."
        )
        require(abs(left - 0.5) > 1e-3, "Your tangent is half too short: divide by 2h only what lies on both sides.")
        require(
            abs(left - 2) > 1e-3,
            "Yours adds the tangent: put brackets around (r(p₀) + t V̇) before you take it off, and take the face at "
            "−h off the one at +h.",
        )
        require(abs(left - 1 + 1 / t) > 1e-3, "Your tangent lacks the factor t.")
        require(abs(left - 1 + 1 / np.linalg.norm(direction)) > 1e-3, UNIT)
    require(
        np.abs(first).max() < 5 * np.abs(np.stack([start, whole])).max(),
        f"On a face that is linear in its controls yours leaves {np.abs(first).max():.2g} mm: put brackets around the "
        "difference before you divide it by (2 * h).",
    )
    require(
        np.abs(first).max() < 1e-6,
        f"On a face that is linear in its controls nothing is left, but yours leaves {np.abs(first).max():.2g} mm: "
        "the tangent belongs to `rest` and `direction`, as they are given, and is multiplied by t.",
    )


def _same_as_the_jaw(bend: Callable, rig: FaceRig) -> None:
    own, neutral = rig.face.constants["jaw"], np.ascontiguousarray(rig.mesh.neutral.T)[None]

    def face(p: np.ndarray) -> jax.Array:
        motion = jaw_motion(rig.face.constants, jnp.asarray(p, jnp.float32)[None])
        return jaw.open_jaw(own, neutral, motion)[0].T

    rest = rig.default
    direction = np.array([control.name == "jaw_open" for control in rig.controls], np.float32)
    at_rest, velocity = jax.jvp(face, (jnp.asarray(rest),), (jnp.asarray(direction),))
    sizes, lengths, off = (1.0, 0.5, 0.25), [], 0.0
    for t in sizes:
        exact = np.asarray(face(rest + t * direction)) - np.asarray(at_rest) - t * np.asarray(velocity)
        ours = np.asarray(bend(lambda p: np.asarray(face(p)), rest, direction, t))
        off = max(off, float(np.abs(ours - exact).max()))
        lengths.append(float(np.linalg.norm(ours, axis=1).mean()))
    require(
        off < 0.01,
        f"On the jaw of {rig.name} yours is up to {off:.2g} mm off the exact derivative: with a step much smaller than "
        "0.01 single precision spoils the difference, with a much larger one the bend does.",
    )
    passed(
        f"yours is nothing on a line, and on the jaw of {rig.name} within {off:.1g} mm of the exact derivative; each "
        f"halving of t leaves {lengths[1] / lengths[0]:.3f} and {lengths[2] / lengths[1]:.3f} of it"
    )


def _array(answer: object, shape: tuple[int, ...], name: str) -> np.ndarray:
    """Return an answer as an array, if it is one of that shape."""
    require(answer is not None, f"`{name}` returns nothing: is there a `return`?")
    found = np.shape(answer)
    require(found == shape, f"`{name}` must return an array of the shape {shape}, but yours has {found}.")
    return np.asarray(answer)
