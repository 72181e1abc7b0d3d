"""Wrinkles driven by strain: where skin is compressed across its folds, it buckles (layer 8).

Per region: stretch |G X| along the resting fibre direction d₀; compression c = 1 − area average of stretch; implicit
diffusion (M + 30 K) c̃ = M c; c₊ = max(0, ½[(c̃ − ε) + √((c̃ − ε)² + 2e-4)] − 0.004); buckling amplitude
A = (λ/π)·gain·√c₊; bending solve (M + 0.10 K + 0.06 K M⁻¹K) h = M A p with the region's pattern p; X += h n.
Diffusion and averaging, and the bending solve, are dense matrices on the region, inverted once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from data_recipes.deformers.planes import Constants, Values, cross, spread, unit
from data_recipes.deformers.surface_operators import face_gradients, stiffness, submesh, vertex_areas

DIFFUSION_MM2 = 30.0
MEMBRANE_MM2 = 0.10
BENDING_MM4 = 0.06
SMALLEST_THRESHOLD = 0.012  # ε below this would leave wrinkles at rest


@dataclass(frozen=True)
class Region:
    """A patch of skin that folds one way.

    vertices: (s,) mesh indices; fibre: (s, 3) direction across the folds, which compression along raises them;
    wavelength_mm λ and threshold ε: (s,); pattern p: (s,) dimensionless height, window included; gain: the weight of
    each gain control (g, s) and its column of p (g,) — a vertex's gain is the weighted sum of its controls' gains.
    """

    name: str
    vertices: np.ndarray
    fibre: np.ndarray
    wavelength_mm: np.ndarray
    pattern: np.ndarray
    threshold: np.ndarray
    gain_columns: np.ndarray
    gain_weights: np.ndarray


def prepare_region(
    region: Region, neutral: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]
) -> dict[str, np.ndarray]:
    """Return a region's constants: its faces with G (3 coefficients each), the two operators, λ/π·p, ε and gains."""
    local, _ = submesh(faces, region.vertices, len(neutral))
    x = neutral[region.vertices].astype(np.float64)
    gradients, area = face_gradients(x, local)
    normal = np.cross(x[local[:, 1]] - x[local[:, 0]], x[local[:, 2]] - x[local[:, 0]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    fibre = region.fibre[local].mean(axis=1)
    fibre -= normal * (fibre * normal).sum(axis=1, keepdims=True)
    fibre /= np.maximum(np.linalg.norm(fibre, axis=1, keepdims=True), 1e-9)
    directional = (gradients * fibre[:, None]).sum(axis=2)  # (f, 3): stretch vector = Σ coefficient · corner

    s = len(x)
    mass = vertex_areas(x, local)
    k = stiffness(x, local).toarray()
    average = np.zeros((s, len(local)))
    np.add.at(average, (local.ravel(), np.repeat(np.arange(len(local)), 3)), np.repeat(area / 3, 3))
    average /= mass[:, None]
    diffuse = np.linalg.solve(np.diag(mass) + DIFFUSION_MM2 * k, mass[:, None] * average)
    bending = np.diag(mass) + MEMBRANE_MM2 * k + BENDING_MM4 * k @ (k / mass[:, None])
    raise_ = np.linalg.solve(bending, np.diag(mass))
    return {
        "corners": region.vertices[local].T.astype(np.int32),
        "directional": directional.T.astype(np.float32),
        "diffuse": diffuse.T.astype(np.float32),
        # The pattern and λ/π ride inside the bending operator: h = √c₊ · gain @ raise.
        "raise": (raise_ * (region.wavelength_mm / np.pi * region.pattern)).T.astype(np.float32),
        "threshold": np.maximum(region.threshold, SMALLEST_THRESHOLD).astype(np.float32),
        "gain_columns": region.gain_columns.astype(np.int32),
        "gain_weights": region.gain_weights.astype(np.float32),
    }


def compression(constants: Constants, x: Float[Values, "b 3 n"]) -> Float[Values, "b s"]:
    """Return the diffused compression c̃ of a region's vertices; 0.1 means a tenth shorter."""
    i, j, k = constants["corners"]
    gi, gj, gk = constants["directional"]
    along = x[:, :, i] * gi + x[:, :, j] * gj + x[:, :, k] * gk  # (b, 3, f)
    stretch = jnp.sqrt((along * along).sum(axis=1) + 1e-12)
    return (1 - stretch) @ constants["diffuse"]


def excess(shortening: Float[Values, "b s"], threshold: Float[Values, " s"]) -> Float[Values, "b s"]:
    """Return c₊, the compression beyond the threshold: exactly 0 at rest."""
    y = shortening - threshold
    return jnp.maximum(0.0, 0.5 * (y + jnp.sqrt(y * y + 2e-4)) - 0.004)


def gains(u: Float[Values, "b m"], columns: Int[Values, " g"]) -> Float[Values, "b g"]:
    """Return the gain of each control: 0 at −1, 1 at 0, 2 at 1, and never below 0; a missing control gives 1."""
    padded = jnp.concatenate([u, jnp.zeros_like(u[:, :1])], axis=1)
    return jnp.maximum(0.0, 1.0 + padded[:, columns])


def heights(constants: Constants, x: Float[Values, "b 3 n"], u: Float[Values, "b m"]) -> Float[Values, "b s"]:
    """Return the height h (mm) of a region's wrinkles at positions x and controls u."""
    c = excess(compression(constants, x), constants["threshold"])
    folds = c > 0
    root = jnp.where(folds, jnp.sqrt(jnp.where(folds, c, 1.0)), 0.0)
    gain = gains(u, constants["gain_columns"]) @ constants["gain_weights"]
    return (root * gain) @ constants["raise"]


def normals(constants: Constants, x: Float[Values, "b 3 n"]) -> Float[Values, "b 3 s"]:
    """Return unit vertex normals on the union of the regions, area-weighted over the (padded) incident faces."""
    i, j, k = constants["corners"]
    a = x[:, :, i]
    face = cross(x[:, :, j] - a, x[:, :, k] - a)
    padded = jnp.concatenate([face, jnp.zeros_like(face[:, :, :1])], axis=-1)
    return unit(sum(padded[:, :, slot] for slot in constants["incident"]))


def prepare_normals(support: Int[np.ndarray, " s"], faces: Int[np.ndarray, "f 3"], n: int) -> dict[str, np.ndarray]:
    """Return the faces around the support's vertices and, per vertex, the slots of its incident faces."""
    mask = np.zeros(n, bool)
    mask[support] = True
    around = faces[mask[faces].any(axis=1)]
    place = np.full(n, -1)
    place[support] = np.arange(len(support))
    incident: list[list[int]] = [[] for _ in support]
    for number, face in enumerate(around):
        for vertex in face:
            if place[vertex] >= 0:
                incident[place[vertex]].append(number)
    slots = np.full((max(map(len, incident)), len(support)), len(around), np.int32)
    for vertex, numbers in enumerate(incident):
        slots[: len(numbers), vertex] = numbers
    return {"corners": around.T.astype(np.int32), "incident": slots}


def prepare(
    regions: list[Region], neutral: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]
) -> dict[str, dict[str, np.ndarray]]:
    """Return the layer's constants: one entry a region, and "surface" with the normals and places of their union."""
    n = len(neutral)
    regions = sorted(regions, key=lambda region: region.name)  # the order in which compiled functions see dictionaries
    constants = {region.name: prepare_region(region, neutral, faces) for region in regions}
    support = np.unique(np.concatenate([region.vertices for region in regions])) if regions else np.zeros(0, int)
    surface = prepare_normals(support, faces, n) if regions else {}
    place = np.full(n, len(support), np.int32)
    place[support] = np.arange(len(support))
    # Each support vertex reads its height from each region that holds it, at most `overlap` of them.
    starts = np.cumsum([0] + [len(region.vertices) for region in regions])
    sources: list[list[int]] = [[] for _ in support]
    for start, region in zip(starts, regions, strict=False):
        for k, vertex in enumerate(region.vertices):
            sources[place[vertex]].append(start + k)
    overlap = max(map(len, sources), default=0)
    slots = np.full((overlap, len(support)), starts[-1], np.int32)
    for vertex, numbers in enumerate(sources):
        slots[: len(numbers), vertex] = numbers
    return constants | {"surface": surface | {"place": place, "sources": slots}}


def region_vertices(constants: Mapping[str, Constants]) -> dict[str, Int[np.ndarray, " s"]]:
    """Return each region's vertices as mesh indices, in the order of its heights."""
    names = sorted(name for name in constants if name != "surface")
    sizes = [np.asarray(constants[name]["raise"]).shape[0] for name in names]
    if not names:
        return {}
    place, sources = (np.asarray(constants["surface"][part]) for part in ("place", "sources"))
    vertices = np.zeros(sum(sizes) + 1, np.int32)  # the last slot is the padding's
    vertices[sources] = np.flatnonzero(place < sources.shape[1])  # places rise with the vertices
    return dict(zip(names, np.split(vertices[:-1], np.cumsum(sizes)[:-1]), strict=True))


@dataclass(frozen=True)
class RegionState:
    """What a region does in a pose, (s,) each: compression c̃, its excess c₊ (1 is the whole length), height h in mm.

    vertices: mesh indices; threshold: ε of each.
    """

    vertices: np.ndarray
    threshold: np.ndarray
    compression: np.ndarray
    excess: np.ndarray
    height_mm: np.ndarray


def region_states(
    constants: Mapping[str, Constants], x: Float[Values, "1 3 n"], u: Float[Values, "1 m"]
) -> dict[str, RegionState]:
    """Return what each region does, by name, at the positions before the layer and the limited controls of one pose."""
    states = {}
    for name, vertices in region_vertices(constants).items():
        own = constants[name]
        c = compression(own, x)
        parts = (c, excess(c, own["threshold"]), heights(own, x, u))
        states[name] = RegionState(vertices, np.asarray(own["threshold"]), *(np.asarray(part)[0] for part in parts))
    return states


def wrinkle(
    constants: Mapping[str, Constants], x: Float[Values, "b 3 n"], u: Float[Values, "b m"]
) -> Float[Values, "b 3 n"]:
    """Return positions with every region's wrinkles: X += Σ h n."""
    names = sorted(name for name in constants if name != "surface")
    if not names:
        return x
    surface = constants["surface"]
    every = jnp.concatenate([heights(constants[name], x, u) for name in names], axis=1)
    every = jnp.concatenate([every, jnp.zeros_like(every[:, :1])], axis=1)
    height = sum(every[:, slot] for slot in surface["sources"])
    return x + spread(height[:, None] * normals(surface, x), surface["place"])
