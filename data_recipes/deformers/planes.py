"""Plumbing between positions as planes (b, 3, n) and a deformer's support."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int


def place_of(support: Int[np.ndarray, "s"], n: int) -> Int[np.ndarray, "n"]:
    """Return, for each of n vertices, its position in `support`, or s (one past the end) outside it."""
    place = np.full(n, len(support), np.int32)
    place[support] = np.arange(len(support))
    return place


def spread(values: Float[Array, "*b s"], place: Int[Array, "n"]) -> Float[Array, "*b n"]:
    """Return values on all n vertices: those of the support at their vertices, 0 elsewhere.

    place: from `place_of`. This is a gather; scattering on a CPU takes several times as long.
    """
    padded = jnp.concatenate([values, jnp.zeros_like(values[..., :1])], axis=-1)
    return padded[..., place]


def dot(a: Float[Array, "b 3 s"], b: Float[Array, "*b 3 s"]) -> Float[Array, "b s"]:
    """Return the scalar products of two fields of vectors."""
    return (a * b).sum(axis=-2)


def cross(a: Float[Array, "*b 3 s"], b: Float[Array, "*b 3 s"]) -> Float[Array, "*b 3 s"]:
    """Return the cross products of two fields of vectors."""
    ax, ay, az = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    bx, by, bz = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return jnp.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)


def unit(a: Float[Array, "*b 3 s"]) -> Float[Array, "*b 3 s"]:
    """Return the vectors at length 1; shorter than 1e-6 they shrink to 0 smoothly."""
    return a / jnp.sqrt((a * a).sum(axis=-2, keepdims=True) + 1e-12)
