"""Tools for sculpting a head's pose fields: where a field acts, which way, and how it keeps to the skull.

A field is an offset of every vertex at the half and at the full pose (a `Path`), plus a bulge along the normals that
the skull slide leaves alone. Fields with sides are sculpted on the character's left and mirrored.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from data_recipes.deformers.handles import wendland
from data_recipes.deformers.surface_operators import (
    adjacency,
    geodesic,
    harmonic,
    smooth_values,
    stiffness,
    submesh,
    vertex_areas,
    vertex_normals,
)
from data_recipes.head.neutral_head import Head
from data_recipes.head.shape import FLIP, smoothstep

SKIN = ("face", "cranium", "neck", "ear_left", "ear_right", "lid_inner_left", "lid_inner_right", "mouth_bag")
LINING_MM = (26.0, 10.0)  # from the skin to the mouth's lining: where it begins to go with it, and does fully
BESIDE_LIPS = (0.25, 0.6)  # along the lips: where the cheek begins to cover the lining, and does fully
STEEPEST = 1.5  # the steepest relief that skin follows: rise, out from the face, over way along it
EXTENSION_MM2 = 400.0  # bending against stretching when a curve's motion is carried into the skin around it


@dataclass(frozen=True)
class Path:
    """A sculpted action: offsets (n, 3) in mm at u = ½ and u = 1, and bulges (n,) along the normal at both."""

    half: Float[np.ndarray, "n 3"]
    full: Float[np.ndarray, "n 3"]
    half_bulge: Float[np.ndarray, " n"]
    full_bulge: Float[np.ndarray, " n"]

    def __add__(self, other: Path) -> Path:
        return Path(*(getattr(self, f) + getattr(other, f) for f in ("half", "full", "half_bulge", "full_bulge")))

    def mirrored(self, mirror: Int[np.ndarray, " n"]) -> Path:
        """Return the same action on the other side."""
        return Path(
            (self.half * FLIP)[mirror], (self.full * FLIP)[mirror], self.half_bulge[mirror], self.full_bulge[mirror]
        )


@dataclass(frozen=True)
class Sculptor:
    """A head and what sculpting it needs, computed on first use."""

    head: Head

    @property
    def x(self) -> Float[np.ndarray, "n 3"]:
        """The neutral, mm."""
        return self.head.vertices

    @property
    def n(self) -> int:
        """The number of vertices."""
        return len(self.head.vertices)

    @cached_property
    def graph(self) -> sp.csr_matrix:
        """The quad edges between skin vertices, (n, n) 0/1."""
        full = adjacency(self.head.quads, self.n)
        keep = sp.diags(self.is_skin.astype(float))
        graph = (keep @ full @ keep).tocsr()
        graph.eliminate_zeros()
        graph.sort_indices()
        return graph

    @cached_property
    def is_skin(self) -> np.ndarray:
        """Which vertices belong to the connected skin, mouth bag and inner lids included."""
        return self.in_parts(*SKIN)

    @cached_property
    def is_outer(self) -> np.ndarray:
        """Which vertices belong to the outer skin: no mouth bag, no inner lids."""
        return self.in_parts(*SKIN[:5])

    @cached_property
    def normals(self) -> Float[np.ndarray, "n 3"]:
        """Unit vertex normals."""
        return vertex_normals(self.x, self.head.faces)

    @cached_property
    def up(self) -> Float[np.ndarray, "n 3"]:
        """The tangent direction that leads upwards, of length ≤ 1 (shorter where the skin lies flat)."""
        return self.tangent(np.array([0.0, 1.0, 0.0]))

    @cached_property
    def out(self) -> Float[np.ndarray, "n 3"]:
        """The tangent direction that leads to the character's left."""
        return self.tangent(np.array([1.0, 0.0, 0.0]))

    def in_parts(self, *names: str) -> np.ndarray:
        """Return which vertices (n,) belong to the named parts of the head."""
        indices = [i for i, name in enumerate(self.head.part_names) if name in names]
        return np.isin(self.head.part, indices)

    @cached_property
    def over_lining(self) -> tuple[Int[np.ndarray, "q k 4"], Float[np.ndarray, "q k"]]:
        """The 4 vertices of outer skin nearest to each vertex of the mouth bag, and how much they cover it (0 to 1).

        In front they don't cover it, since there the lining belongs to the lips.
        """
        skin = np.flatnonzero(self.is_outer)
        distance, near = cKDTree(self.x[skin]).query(self.x[self.head.grids["mouth_bag"]], 4)
        beside = smoothstep(np.abs(self.head.ring_parameter["mouth_u"]), *BESIDE_LIPS)
        return skin[near], beside * smoothstep(distance.mean(axis=-1), *LINING_MM)

    def point(self, name: str) -> Float[np.ndarray, " 3"]:
        """Return a landmark's position."""
        return self.x[self.head.landmarks[name]]

    def tangent(self, direction: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return directions without their part along the normals."""
        direction = np.broadcast_to(direction, self.x.shape)
        return direction - self.normals * (direction * self.normals).sum(axis=1, keepdims=True)

    def nearest(self, point: np.ndarray) -> int:
        """Return the outer skin vertex nearest to a point in mm."""
        outer = np.flatnonzero(self.is_outer)
        return int(outer[np.linalg.norm(self.x[outer] - point, axis=1).argmin()])

    def bump(self, where: str | int | np.ndarray, radius_mm: float) -> Float[np.ndarray, " n"]:
        """Return a smooth bump: 1 at a landmark, vertex or set of vertices, 0 beyond `radius_mm` along the skin."""
        source = self.head.landmarks[where] if isinstance(where, str) else where
        distance = geodesic(self.x, self.graph, np.atleast_1d(source), radius_mm)
        # Paths along edges are longer than straight ones; the mean of both is close to the surface's own distance.
        straight = np.linalg.norm(self.x[:, None] - self.x[np.atleast_1d(source)][None], axis=2).min(axis=1)
        value = wendland(np.where(np.isfinite(distance), 0.5 * (distance + straight), radius_mm), radius_mm)
        return smooth_values(value, self.graph, 2)

    def blend(self, *levels: tuple[np.ndarray, float | np.ndarray], passes: int = 3) -> Float[np.ndarray, " n"]:
        """Return the harmonic function on the skin with given values at some vertices, smoothed a little.

        levels: vertices and their value or values; of a vertex in several levels the first one holds.
        """
        ids = np.concatenate([v for v, _ in levels])
        values = np.concatenate([np.broadcast_to(np.asarray(level, float), len(v)) for v, level in levels])
        ids, first = np.unique(ids, return_index=True)
        return smooth_values(harmonic(self.graph, ids, values[first]), self.graph, passes)

    def on_skull(self, offset: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return the offset corrected so that each vertex keeps its distance from the skull (three Newton steps)."""
        active = np.flatnonzero(np.abs(offset).max(axis=1) > 1e-3)
        if len(active) == 0:
            return offset
        rest = self.x[active]
        rest_distance, _ = self._distance(rest)
        y = rest + offset[active]
        for _ in range(3):
            d, g = self._distance(y)
            step = (d - rest_distance) / np.maximum((g * g).sum(axis=1), 0.3)
            y = y - np.clip(step, -3, 3)[:, None] * g
        result = offset.copy()
        result[active] = y - rest
        return result

    def _distance(self, points: np.ndarray, step: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
        probes = [points] + [points + sign * step * np.eye(3)[i] for i in range(3) for sign in (1, -1)]
        values = self.head.sdf(np.concatenate(probes)).reshape(7, -1)
        return values[0], np.stack([(values[1 + 2 * i] - values[2 + 2 * i]) / (2 * step) for i in range(3)], axis=1)

    def slide(self, offset: Float[np.ndarray, "n 3"], bulge: Float[np.ndarray, " n"] | float = 0.0) -> Path:
        """Return the path whose half and full offsets both keep to the skull, with a bulge that grows linearly."""
        bulge = np.broadcast_to(np.asarray(bulge, float), (self.n,))
        half, full = self.on_skull(0.5 * offset), self.on_skull(offset)
        # Overlapping corrections of neighbours may be uneven near the nose; one pass evens them out.
        return Path(self._even(half), self._even(full), 0.5 * bulge, bulge.copy())

    def _even(self, offset: np.ndarray) -> np.ndarray:
        return np.where(self.is_outer[:, None], smooth_values(offset, self.graph, 1), offset)

    def straight(self, offset: Float[np.ndarray, "n 3"], bulge: Float[np.ndarray, " n"] | float = 0.0) -> Path:
        """Return the path along straight lines."""
        bulge = np.broadcast_to(np.asarray(bulge, float), (self.n,))
        return Path(0.5 * offset, offset, 0.5 * bulge, bulge.copy())

    # -- wrapped coordinates -------------------------------------------------------------------------------------

    @cached_property
    def wrapped(self) -> Float[np.ndarray, "n 3"]:
        """Each vertex's wrapped coordinates (a across, b up, r out) in mm, about the mouth's axis."""
        z, rho = self.head.mouth_axis
        angle = np.arctan2(self.x[:, 0], self.x[:, 2] - z)
        return np.stack([angle * rho, self.x[:, 1], np.hypot(self.x[:, 0], self.x[:, 2] - z)], axis=1)

    def unwrap(self, wrapped: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Return positions from wrapped coordinates."""
        z, rho = self.head.mouth_axis
        angle = wrapped[..., 0] / rho
        return np.stack(
            [wrapped[..., 2] * np.sin(angle), wrapped[..., 1], z + wrapped[..., 2] * np.cos(angle)], axis=-1
        )

    @cached_property
    def relief(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The skull's radius r over wrapped coordinates on a 2 mm grid, smoothed: (a values, b values, r)."""
        mouth = self.head.landmarks["mouth_corner_left"]
        reach = max(96.0, 2.0 * np.ceil(self.head.recipe.mouth.half_width))
        a = np.arange(-reach, reach + 1.0, 2.0)
        b = np.arange(self.x[mouth, 1] - 60.0, self.x[mouth, 1] + 70.0, 2.0)
        grid = np.stack([*np.meshgrid(a, b, indexing="ij"), np.zeros((len(a), len(b)))], axis=-1).reshape(-1, 3)
        near, far = np.full(len(grid), 10.0), np.full(len(grid), 150.0)
        for _ in range(24):
            middle = 0.5 * (near + far)
            grid[:, 2] = middle
            outside = self.head.sdf(self.unwrap(grid)) > 0
            near, far = np.where(outside, near, middle), np.where(outside, middle, far)
        return a, b, gaussian_filter(near.reshape(len(a), len(b)), 2.0, mode="nearest")

    def relief_at(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return the smoothed radius at wrapped coordinates."""
        grid_a, grid_b, r = self.relief
        # The nose's relief would throw the lips about: level with it, take the relief below it.
        b = np.minimum(b, self.point("mouth_corner_left")[1] + 10.0)
        where = [(a - grid_a[0]) / 2.0, (b - grid_b[0]) / 2.0]
        return map_coordinates(r, where, order=2, mode="nearest")

    def along_surface(self, change: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return the offsets of a change in wrapped coordinates (Δa, Δb, Δr), following the skull's relief."""
        active = np.flatnonzero(np.abs(change).max(axis=1) > 1e-3)
        at = self.wrapped[active]
        to = at + change[active]
        rise = self.relief_at(to[:, 0], to[:, 1]) - self.relief_at(at[:, 0], at[:, 1])
        # Under a chin the relief is a cliff, which would throw skin out to the end of the snout.
        steepest = STEEPEST * np.hypot(change[active, 0], change[active, 1])
        to[:, 2] += np.clip(rise, -steepest, steepest)
        result = np.zeros_like(self.x)
        result[active] = self.unwrap(to) - self.x[active]
        return result

    # -- carrying a curve's motion into the skin -----------------------------------------------------------------

    @cached_property
    def _extension(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, sp.csr_matrix, sp.csr_matrix]:
        """What `extend` needs: its vertices, which are lips, which are free, and matrices of stretching and bending."""
        head = self.head
        lips = head.grids["mouth"][: head.recipe.template.lip_rings + 1].ravel()
        far = geodesic(self.x, self.graph, lips, 74.0)
        patch = np.flatnonzero(self.is_outer & np.isfinite(far))
        patch = np.union1d(patch, lips)
        local, _ = submesh(head.faces, patch, self.n)
        x = self.x[patch]
        k = stiffness(x, local)
        mass = vertex_areas(x, local)
        pins = [head.landmarks["nose_tip"]]
        for side in ("left", "right"):
            pins += head.grids[f"eye_{side}"][:3].ravel().tolist() + head.grids[f"nostril_{side}"].ravel().tolist()
        is_lip = np.isin(patch, lips)
        free = ~is_lip & ~np.isin(patch, pins) & (far[patch] < 62.0)
        return patch, is_lip, free, k, (k @ sp.diags(1 / mass) @ k).tocsr()

    @cached_property
    def _extension_solvers(self) -> dict[float, object]:
        return {}

    def extend(self, on_lips: Float[np.ndarray, "n c"], bending_mm2: float = EXTENSION_MM2) -> Float[np.ndarray, "n c"]:
        """Carry values on the lips' rings into the skin around, falling to 0 at eyes, nose tip and far away.

        bending_mm2: the larger, the further the skin continues the lips' slope before it comes back to rest.
        """
        patch, is_lip, free, stretch, bend = self._extension
        operator = (stretch + bending_mm2 * bend).tocsr()
        if bending_mm2 not in self._extension_solvers:
            self._extension_solvers[bending_mm2] = sp.linalg.splu(operator[free][:, free].tocsc())
        solver = self._extension_solvers[bending_mm2]
        values = np.zeros((len(patch), on_lips.shape[1]))
        values[is_lip] = on_lips[patch[is_lip]]
        right = -(operator[free][:, is_lip] @ values[is_lip])
        values[free] = solver.solve(np.ascontiguousarray(right))
        result = on_lips.copy()
        result[patch] = values
        return result
