"""Plumbing between positions as planes (b, 3, n) and a deformer's support."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

# Arrays are numpy's when fresh or loaded, JAX's inside a compiled function. `Constants` are a deformer's prepared ones.
Values = Array | np.ndarray
Constants = Mapping[str, Values]


def place_of(support: Int[np.ndarray, " s"], n: int) -> Int[np.ndarray, " n"]:
    """Return, for each of n vertices, its position in `support`, or s (one past the end) outside it."""
    place = np.full(n, len(support), np.int32)
    place[support] = np.arange(len(support))
    return place


def selection(columns: Int[np.ndarray, " k"], m: int) -> Float[np.ndarray, "m k"]:
    """Return the matrix that picks columns of p in a product; a column ≥ m, for a control that the rig lacks, gives 0.

    A product is computed once. A gather would be fused into its users and be repeated for every vertex.
    """
    return (np.arange(m)[:, None] == np.asarray(columns)[None]).astype(np.float32)


def spread(values: Float[Values, "*b s"], place: Int[Values, " n"]) -> Float[Values, "*b n"]:
    """Return values on all n vertices: those of the support at their vertices, 0 elsewhere.

    place: from `place_of`. This is a gather; scattering on a CPU takes several times as long.
    """
    padded = jnp.concatenate([values, jnp.zeros_like(values[..., :1])], axis=-1)
    return padded[..., place]


def sine_cosine(angle: Float[Values, "*s"]) -> tuple[Array, Array]:
    """Return sin and cos of angles up to about 1 radian as power series (error below 3e-8), which vectorise."""
    q = angle * angle
    sine = angle * (1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110)))))
    cosine = 1 - q / 2 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90 * (1 - q / 132)))))
    return sine, cosine


def dot(a: Float[Values, "b 3 s"], b: Float[Values, "*b 3 s"]) -> Float[Values, "b s"]:
    """Return the scalar products of two fields of vectors."""
    return (a * b).sum(axis=-2)


def cross(a: Float[Values, "*b 3 s"], b: Float[Values, "*b 3 s"]) -> Float[Values, "*b 3 s"]:
    """Return the cross products of two fields of vectors."""
    ax, ay, az = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    bx, by, bz = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return jnp.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)


def unit(a: Float[Values, "*b 3 s"]) -> Float[Values, "*b 3 s"]:
    """Return the vectors at length 1; shorter than 1e-6 they shrink to 0 smoothly."""
    return a / jnp.sqrt((a * a).sum(axis=-2, keepdims=True) + 1e-12)
