"""Squash and stretch, bend, twist and head shape: smooth maps of space, applied to everything (layer 9).

A map of space moves skin, gums, tongue, eyeballs and brows alike, so nothing is left behind; the teeth take the
rigid part of it (rigid_teeth.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from data_recipes.deformers.node_chain import Constants, Values, sine_cosine

SQUASH = 0.24  # at control value 1, the height loses this share
PART_SQUASH = 0.16
BEND_RAD = np.deg2rad(14.0)
TWIST_RAD = np.deg2rad(18.0)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ShapeValues:
    """The twelve head controls of a batch, (b, 1) each: values about −1.3 … 1.3."""

    squash: Array
    bend_sideways: Array
    bend_forward: Array
    twist: Array
    squash_upper: Array
    squash_lower: Array
    shape_cranium: Array
    shape_jaw_width: Array
    shape_cheeks: Array
    shape_chin: Array
    shape_depth: Array
    shape_neck: Array


def prepare(
    base_y: float, eye_y: float, mouth_y: float, chin: np.ndarray, cheek: np.ndarray, axis_z: float
) -> dict[str, np.ndarray]:
    """Return the maps' landmarks, in mm.

    base_y: the height on the neck up to which nothing moves
    eye_y, mouth_y: heights of the eyes and the mouth
    chin, cheek: points (3,), the cheek on the left
    axis_z: z of the upright axis through the head
    """
    return {
        "base_y": np.asarray(base_y, np.float32),
        "eye_y": np.asarray(eye_y, np.float32),
        "mouth_y": np.asarray(mouth_y, np.float32),
        "chin": np.asarray(chin, np.float32),
        "cheek": np.asarray(cheek, np.float32),
        "axis_z": np.asarray(axis_z, np.float32),
    }


def ramp(x: Array, low: Array, high: Array) -> Array:
    """Return smoothstep from 0 below `low` to 1 above `high`."""
    t = jnp.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def ramp_integral(x: Array, low: Array, high: Array) -> Array:
    """Return the integral of `ramp` up to x, in mm: 0 below `low`, x − (low + high)/2 above `high`."""
    t = jnp.clip((x - low) / (high - low), 0.0, 1.0)
    return (high - low) * (t * t * t - 0.5 * t**4) + jnp.maximum(x - high, 0.0)


def _bump(distance_squared: Array, radius: float) -> Array:
    """Return a bump that is 1 at distance 0 and 0 beyond twice `radius`; powers are cheaper than exponentials."""
    return jnp.maximum(1 - distance_squared / (4 * radius**2), 0.0) ** 4


def _exponential(x: Array) -> Array:
    """Return exp(x) for |x| below ½ as a power series (error below 1e-7).

    The compiler repeats it for every vertex even if x is one per pose, so it must be cheap and vectorise.
    """
    return 1 + x * (1 + x / 2 * (1 + x / 3 * (1 + x / 4 * (1 + x / 5 * (1 + x / 6 * (1 + x / 7))))))


def warp(constants: Constants, values: ShapeValues, points: Float[Values, "b 3 s"]) -> Float[Values, "b 3 s"]:
    """Return points after shape, squash, bend and twist, in this order; the identity when all values are 0."""
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    base, eye, mouth, middle = (jnp.asarray(constants[k]) for k in ("base_y", "eye_y", "mouth_y", "axis_z"))
    chin, cheek = constants["chin"], constants["cheek"]
    v = values

    # Shape: scalings about the head's axis, windowed in height or about a landmark.
    above = ramp(y, eye, eye + 70)
    below = ramp(-y, -(eye - 25), -mouth + 10) * ramp(y, base, base + 50)
    neck = 1 - ramp(y, base - 10, mouth - 10)
    cheek_near = _bump((jnp.abs(x) - cheek[0]) ** 2 + (y - cheek[1]) ** 2 + (z - cheek[2]) ** 2, 45.0)
    chin_near = _bump((x - chin[0]) ** 2 * 0.6 + (y - chin[1]) ** 2 + (z - chin[2]) ** 2, 42.0)
    wide = 1 + 0.10 * v.shape_cranium * above + 0.13 * v.shape_jaw_width * below
    wide = wide + 0.14 * v.shape_neck * neck + 0.09 * v.shape_cheeks * cheek_near
    deep = 1 + 0.08 * v.shape_cranium * above + 0.10 * v.shape_depth * (1 - neck) + 0.14 * v.shape_neck * neck
    x = x * wide
    z = middle + (z - middle) * deep + 5.0 * v.shape_chin * chin_near
    y = y + 0.10 * v.shape_cranium * ramp_integral(y, eye, eye + 70) - 7.0 * v.shape_chin * chin_near

    # Squash: heights shrink by the integral of the local factor, widths grow to keep the volume.
    whole = ramp(y, base, base + 60)
    upper = ramp(y, eye - 20, eye + 40)
    lower = ramp(y, base, base + 60) - upper
    rise_whole = ramp_integral(y, base, base + 60)
    rise_upper = ramp_integral(y, eye - 20, eye + 40)
    shrink, shrink_upper, shrink_lower = (
        _exponential(-amount * value) - 1
        for amount, value in ((SQUASH, v.squash), (PART_SQUASH, v.squash_upper), (PART_SQUASH, v.squash_lower))
    )
    y = y + shrink * rise_whole + shrink_upper * rise_upper + shrink_lower * (rise_whole - rise_upper)
    thinning = SQUASH * v.squash * whole + PART_SQUASH * (v.squash_upper * upper + v.squash_lower * lower)
    girth = _exponential(0.5 * thinning)
    x = x * girth
    z = middle + (z - middle) * girth

    # Bend and twist: three turns about the neck that grow with height, in (x, height), (height, z) and (z, x). The loop
    # keeps the compiler from fusing the turns, which would repeat the first one's work for every use of the second.
    share = ramp(y, base, base + 190)
    angles = jnp.stack([-BEND_RAD * v.bend_sideways, BEND_RAD * v.bend_forward, TWIST_RAD * v.twist])

    def turn(k, point):
        p, q, r = point
        s, c = sine_cosine(angles[k] * share)
        return s * p + c * q, r, c * p - s * q

    x, height, z = jax.lax.fori_loop(0, 3, turn, (x, y - base, z - middle))
    return jnp.stack([x, height + base, z + middle], axis=1)
