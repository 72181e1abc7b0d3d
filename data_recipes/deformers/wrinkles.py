"""Wrinkles driven by strain: where skin is compressed across its folds, it buckles (layer 8).

Per region: stretch |G X| along the resting fibre direction d₀; compression c = 1 − area average of stretch; implicit
diffusion (M + 30 K) c̃ = M c; c₊ = max(0, ½[(c̃ − ε) + √((c̃ − ε)² + 2e-4)] − 0.004); buckling amplitude
A = (λ/π)·gain·√c₊; bending solve (M + 0.10 K + 0.06 K M⁻¹K) h = M A p with the region's pattern p; X += h n.
Both solves are linear and inverted once: the diffusion as a dense matrix for each region, the bending as a sparse one,
since its inverse falls to 0 within a few edges. Inside, positions are rows of one vertex each (see
`node_chain.rows_at`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from data_recipes.deformers.node_chain import Values, add_rows, pick, place_of, rows_at
from data_recipes.deformers.surface_operators import face_gradients, padded_rows, stiffness, submesh, vertex_areas

DIFFUSION_MM2 = 30.0
MEMBRANE_MM2 = 0.10
BENDING_MM4 = 0.06
SMALLEST_THRESHOLD = 0.012  # ε below this would leave wrinkles at rest
GROUPS = 6  # of the bending's sums, by length
NEGLIGIBLE = 1e-6  # entries of the bending's inverse below this share of its largest are left out

WrinkleConstants = Mapping[str, Any]  # of the whole layer, as `prepare` makes them


@dataclass(frozen=True)
class Region:
    """A patch of skin that folds one way.

    vertices: (s,), mesh indices
    fibre: (s, 3), direction across the folds; compression along it raises them
    wavelength_mm: (s,), λ
    pattern: (s,), p, height without unit, window included
    threshold: (s,), ε
    gain_columns: (g,), of p, for each gain control
    gain_weights: (g, s); a vertex's gain is the weighted sum of the gains of its controls
    """

    name: str
    vertices: np.ndarray
    fibre: np.ndarray
    wavelength_mm: np.ndarray
    pattern: np.ndarray
    threshold: np.ndarray
    gain_columns: np.ndarray
    gain_weights: np.ndarray


@dataclass(frozen=True)
class RegionOperators:
    """The operators of a region with f faces.

    corners: (f, 3), mesh indices
    directional: (f, 3), coefficients of the corners whose sum is the stretch vector
    average: (s, f), from faces to vertices by area
    diffuse: (s, s)
    raise_: (s, s), from √c₊·gain to heights in mm
    """

    corners: np.ndarray
    directional: np.ndarray
    average: sp.csr_matrix
    diffuse: np.ndarray
    raise_: np.ndarray


def region_operators(
    region: Region, neutral: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]
) -> RegionOperators:
    """Return a region's operators; the factor λ/π·p of the amplitude is part of `raise_`."""
    local, _ = submesh(faces, region.vertices, len(neutral))
    x = neutral[region.vertices].astype(np.float64)
    gradients, area = face_gradients(x, local)
    normal = np.cross(x[local[:, 1]] - x[local[:, 0]], x[local[:, 2]] - x[local[:, 0]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    fibre = region.fibre[local].mean(axis=1)
    fibre -= normal * (fibre * normal).sum(axis=1, keepdims=True)
    fibre /= np.maximum(np.linalg.norm(fibre, axis=1, keepdims=True), 1e-9)
    mass = vertex_areas(x, local)
    k = stiffness(x, local).toarray()
    entries = (np.repeat(area / 3, 3), (local.ravel(), np.repeat(np.arange(len(local)), 3)))
    average = sp.diags(1 / mass) @ sp.csr_matrix(entries, shape=(len(x), len(local)))
    bending = np.diag(mass) + MEMBRANE_MM2 * k + BENDING_MM4 * k @ (k / mass[:, None])
    return RegionOperators(
        corners=region.vertices[local],
        directional=(gradients * fibre[:, None]).sum(axis=2),
        average=average.tocsr(),
        diffuse=np.linalg.solve(np.diag(mass) + DIFFUSION_MM2 * k, np.diag(mass)),
        raise_=np.linalg.solve(bending, np.diag(mass)) * (region.wavelength_mm / np.pi * region.pattern),
    )


def prepare(regions: list[Region], neutral: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> dict[str, Any]:
    """Return the layer's constants, for s vertices in all, region after region, of which v are different: the union.

    used: (q,), the vertices that the layer reads; `corners` are places in it
    vertices: (s,), mesh indices
    strain: the faces of all regions, and sums that take them to vertices
    diffuse: a matrix for each region
    threshold: (s,)
    gain_columns, gain_weights: (g,) and (s, g)
    raise: sums from √c₊·gain to heights on the union, in GROUPS parts
    normals: the faces around the union, and sums that take them to vertices
    place: (n,), from `node_chain.place_of`
    """
    if not regions:
        return {"threshold": np.zeros(0, np.float32)}
    # operators region by region
    n = len(neutral)
    regions = sorted(regions, key=lambda region: region.name)  # the order in which compiled functions see dictionaries
    operators = [region_operators(region, neutral, faces) for region in regions]
    vertices = np.concatenate([region.vertices for region in regions])
    raise_ = sp.block_diag([_without_negligible(each.raise_) for each in operators])
    # heights on the union, sorted by how many terms their sums have, so that little of a group is padding
    union = np.unique(vertices)
    gather = sp.csr_matrix((np.ones(len(vertices)), (place_of(union, n)[vertices], np.arange(len(vertices)))))
    to_heights = (gather @ raise_).tocsr()
    order = np.argsort(np.diff(to_heights.indptr), kind="stable")
    union, to_heights = union[order], to_heights[order]
    # the faces around it, for its normals
    around = faces[np.isin(faces, union).any(axis=1)]
    used = np.unique(around)
    place_in_used = place_of(used, n)
    incident = sp.csr_matrix(
        (np.ones(around.size), (place_of(union, n)[around].ravel(), np.repeat(np.arange(len(around)), 3))),
        shape=(len(union) + 1, len(around)),
    )[: len(union)]
    return {
        "used": used.astype(np.int32),
        "vertices": vertices.astype(np.int32),
        "strain": {
            "corners": place_in_used[np.concatenate([each.corners for each in operators])].T.astype(np.int32),
            "directional": np.concatenate([each.directional for each in operators]).T.astype(np.float32),
        }
        | padded_rows(sp.block_diag([each.average for each in operators]).tocsr()),
        "diffuse": {
            region.name: each.diffuse.astype(np.float32) for region, each in zip(regions, operators, strict=True)
        },
        "threshold": np.maximum(np.concatenate([region.threshold for region in regions]), SMALLEST_THRESHOLD).astype(
            np.float32
        ),
        "gain_columns": np.concatenate([region.gain_columns for region in regions]).astype(np.int32),
        "gain_weights": sp.block_diag([region.gain_weights.T for region in regions]).toarray().astype(np.float32),
        "raise": {
            str(k): padded_rows(to_heights[rows])
            for k, rows in enumerate(np.array_split(np.arange(len(union)), GROUPS))
        },
        "normals": {"corners": place_in_used[around].T.astype(np.int32)} | padded_rows(incident),
        "place": place_of(union, n),
    }


def _without_negligible(operator: Float[np.ndarray, "s s"]) -> sp.csr_matrix:
    size = np.abs(operator)
    return sp.csr_matrix(np.where(size > NEGLIGIBLE * size.max(), operator, 0.0))


def sum_rows(constants: Mapping[str, Values], values: Float[Array, "*s"]) -> Float[Array, "*n"]:
    """Return weighted sums of rows, one slot after the other; constants: from `surface_operators.padded_rows`."""
    slots, weights = jnp.asarray(constants["slots"]), jnp.asarray(constants["weights"])
    shape = (slots.shape[1], *values.shape[1:])
    weights = weights.reshape(*weights.shape, *(1 for _ in shape[1:]))
    return jax.lax.fori_loop(
        0, len(slots), lambda k, total: total + pick(values, slots[k]) * weights[k], jnp.zeros(shape, values.dtype)
    )


def compression(constants: WrinkleConstants, rows: Float[Array, "q 3 b"]) -> Float[Array, "s b"]:
    """Return the diffused compression c̃ of the regions' vertices; 0.1 means a tenth shorter."""
    strain = constants["strain"]
    corners, directional = strain["corners"], jnp.asarray(strain["directional"])[:, :, None, None]
    along = sum(pick(rows, corners[k]) * directional[k] for k in range(3))  # (f, 3, b)
    short = sum_rows(strain, 1 - jnp.sqrt((along * along).sum(axis=1) + 1e-12))
    matrices = [constants["diffuse"][name] for name in sorted(constants["diffuse"])]
    parts = jnp.split(short, np.cumsum([len(matrix) for matrix in matrices])[:-1])
    return jnp.concatenate([matrix @ part for matrix, part in zip(matrices, parts, strict=True)])


def excess(shortening: Float[Array, "s b"], threshold: Float[Values, " s"]) -> Float[Array, "s b"]:
    """Return c₊, the compression beyond the threshold: exactly 0 at rest."""
    y = shortening - jnp.asarray(threshold)[:, None]
    return jnp.maximum(0.0, 0.5 * (y + jnp.sqrt(y * y + 2e-4)) - 0.004)


def gains(u: Float[Values, "b m"], columns: Int[Values, " g"]) -> Float[Array, "b g"]:
    """Return the gain of each control: 0 at −1, 1 at 0, 2 at 1, and never below 0; a missing control gives 1."""
    padded = jnp.concatenate([u, jnp.zeros_like(u[:, :1])], axis=1)
    return jnp.maximum(0.0, 1.0 + padded[:, columns])


def amplitudes(
    constants: WrinkleConstants, beyond: Float[Array, "s b"], u: Float[Values, "b m"]
) -> Float[Array, "s b"]:
    """Return √c₊·gain of the regions' vertices; beyond: c₊."""
    folds = beyond > 0
    root = jnp.where(folds, jnp.sqrt(jnp.where(folds, beyond, 1.0)), 0.0)
    return root * (jnp.asarray(constants["gain_weights"]) @ gains(u, constants["gain_columns"]).T)


def heights(constants: WrinkleConstants, amplitude: Float[Array, "s b"]) -> Float[Array, "v b"]:
    """Return the heights h (mm) on the union of the regions, the solution of the bending; amplitude: √c₊·gain."""
    parts = constants["raise"]
    return jnp.concatenate([sum_rows(parts[k], amplitude) for k in sorted(parts)])


def normals(constants: WrinkleConstants, rows: Float[Array, "q 3 b"]) -> Float[Array, "v 3 b"]:
    """Return unit vertex normals on the union of the regions, area-weighted over the incident faces."""
    a, b, c = (pick(rows, corners) for corners in constants["normals"]["corners"])
    (px, py, pz), (qx, qy, qz) = (jnp.moveaxis(edge, 1, 0) for edge in (b - a, c - a))
    face = jnp.stack([py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx], axis=1)
    normal = sum_rows(constants["normals"], face)
    return normal / jnp.sqrt((normal * normal).sum(axis=1, keepdims=True) + 1e-12)


def wrinkle(constants: WrinkleConstants, x: Float[Values, "b 3 n"], u: Float[Values, "b m"]) -> Float[Values, "b 3 n"]:
    """Return positions with every region's wrinkles: X += Σ h n."""
    if len(constants["threshold"]) == 0:
        return x
    rows = rows_at(x, constants["used"])
    beyond = excess(compression(constants, rows), constants["threshold"])
    height = heights(constants, amplitudes(constants, beyond, u))
    return add_rows(x, height[:, None] * normals(constants, rows), constants["place"])


@dataclass(frozen=True)
class RegionState:
    """What the s vertices of a region do in a pose, (s,) each.

    vertices: mesh indices
    threshold: ε
    compression, excess: c̃ and c₊, as shares of the length
    height_mm: h
    """

    vertices: np.ndarray
    threshold: np.ndarray
    compression: np.ndarray
    excess: np.ndarray
    height_mm: np.ndarray


def region_states(
    constants: WrinkleConstants, x: Float[Values, "1 3 n"], u: Float[Values, "1 m"]
) -> dict[str, RegionState]:
    """Return what each region does in one pose, by name; x, u: the positions and controls that the layer gets."""
    if len(constants["threshold"]) == 0:
        return {}
    vertices, threshold, place = (np.asarray(constants[name]) for name in ("vertices", "threshold", "place"))
    shorter = _compression(constants, rows_at(x, constants["used"]))
    beyond = excess(shorter, threshold)
    amplitude = amplitudes(constants, beyond, u)
    states, first = {}, 0
    for name in sorted(constants["diffuse"]):
        rows = slice(first, first := first + len(constants["diffuse"][name]))
        alone = jnp.zeros_like(amplitude).at[rows].set(amplitude[rows])
        height = np.asarray(_heights(constants, alone))[place[vertices[rows]], 0]
        parts = (np.asarray(values)[rows, 0] for values in (shorter, beyond))
        states[name] = RegionState(vertices[rows], threshold[rows], *parts, height)
    return states


_compression, _heights = jax.jit(compression), jax.jit(heights)  # compiled once, and not for every pose
