"""Topology: a grid around the head whose holes are filled with rings, and the inner parts.

Right-hand parts mirror left-hand ones index by index, so that the same code poses both. `block_ring` has the order of a
ring.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Int

from data_recipes.head.frills import frill_parts, frill_settings
from data_recipes.recipe.reading import Recipe
from data_recipes.recipe.sections import PARTS
from replicate.base.exceptions import InputError

FACE, CRANIUM, NECK, EAR_LEFT, EAR_RIGHT, LID_LEFT, LID_RIGHT, BAG, GUM_UPPER, GUM_LOWER, TONGUE = range(len(PARTS))


@dataclass(frozen=True)
class Layout:
    """Connectivity without positions.

    part: (n,), indices into `part_names`, whose last ones are the teeth
    mirror: (n,), each vertex's mirror image
    grids: vertices by name
    """

    part: Int[np.ndarray, " n"]
    part_names: tuple[str, ...]
    quads: Int[np.ndarray, "q 4"]
    mirror: Int[np.ndarray, " n"]
    grids: dict[str, np.ndarray]


@dataclass
class _Builder:
    part: list[int] = field(default_factory=list)
    mirror: list[int] = field(default_factory=list)
    quads: list[np.ndarray] = field(default_factory=list)

    def new(self, shape: tuple[int, ...], part: int) -> np.ndarray:
        """Add vertices, their own mirror images until paired, and return their indices in the given shape."""
        first, count = len(self.part), int(np.prod(shape))
        self.part += [part] * count
        self.mirror += range(first, first + count)
        return np.arange(first, first + count).reshape(shape)

    def pair(self, left: np.ndarray, right: np.ndarray) -> None:
        for a, b in zip(np.ravel(left), np.ravel(right), strict=True):
            self.mirror[a], self.mirror[b] = int(b), int(a)

    def new_pair(self, shape: tuple[int, ...], left_part: int, right_part: int) -> tuple[np.ndarray, np.ndarray]:
        left, right = self.new(shape, left_part), self.new(shape, right_part)
        self.pair(left, right)
        return left, right

    def add(self, quads: np.ndarray, both: bool = False) -> None:
        """Add quads, and with `both` their mirror images, turned over so that they still face outwards."""
        self.quads.append(quads)
        if both:
            self.quads.append(np.asarray(self.mirror)[quads][:, ::-1])


def build_layout(recipe: Recipe) -> Layout:
    """Lay out every part of the head; the vertices of each part are contiguous."""
    b, grids = _Builder(), {}
    _body(b, recipe, grids)
    _midline_rings(b, recipe, grids)
    _paired_rings(b, recipe, grids)
    _gums_and_tongue(b, recipe, grids)
    names = PARTS + frill_parts(recipe)
    _frills(b, recipe, grids)
    names += _teeth(b, recipe, grids, len(names))
    part = np.asarray(b.part)
    order = np.argsort(np.where(part < 0, len(names), part), kind="stable")[: int((part >= 0).sum())]  # -1: removed
    new = np.full(len(part), -1)
    new[order] = np.arange(len(order))
    return Layout(
        part=part[order].astype(np.int32),
        part_names=names,
        quads=new[np.concatenate(b.quads)].astype(np.int32),
        mirror=new[np.asarray(b.mirror)[order]].astype(np.int32),
        grids={name: np.where(grid < 0, -1, new[grid]).astype(np.int32) for name, grid in grids.items()},
    )


def _body(b: _Builder, recipe: Recipe, grids: dict) -> None:
    """Add the cylinder grid with its holes, the coarser rows at the back, and the cap of the crown."""
    # the grid and its parts
    t = recipe.template
    rows, half = int(t.anchors[-1][0]) + 1, t.half_columns
    grid = b.new((rows, 2 * half), CRANIUM)
    column = np.arange(2 * half)
    column = np.minimum(column, 2 * half - column)
    b.pair(grid, grid[:, -np.arange(2 * half) % (2 * half)])
    part = np.asarray(b.part).reshape(grid.shape)
    part[: t.hair_row + 1, column <= t.face_columns] = FACE
    part[: t.neck_rows] = NECK

    # holes for eyes, nostrils, ears and mouth
    cells = np.ones((rows - 1, 2 * half), bool)
    for (r0, r1), (c0, c1) in (
        (t.eye_rows, t.eye_columns),
        (t.nostril_rows, t.nostril_columns),
        (t.ear_rows, t.ear_columns),
        (t.mouth_rows, (0, t.mouth_columns)),
    ):
        for columns in (np.arange(c0, c1), -1 - np.arange(c0, c1)):
            cells[r0:r1, columns % (2 * half)] = False
    for (r0, r1), columns in (
        (t.eye_rows, np.arange(t.eye_columns[0] + 1, t.eye_columns[1])),
        (t.nostril_rows, np.arange(t.nostril_columns[0] + 1, t.nostril_columns[1])),
        (t.ear_rows, np.arange(t.ear_columns[0] + 1, t.ear_columns[1])),
        (t.mouth_rows, np.arange(-t.mouth_columns + 1, t.mouth_columns)),
    ):
        for side in (columns, -columns):
            part[r0 + 1 : r1, side % (2 * half)] = -1

    # the back, where three rows become one
    (r0, r1), c = t.coarse_rows, t.coarse_from
    cells[r0:r1, c : 2 * half - c] = False
    dropped_rows = r0 + np.flatnonzero(np.arange(r1 - r0) % 3)
    part[np.ix_(dropped_rows, np.arange(c + 1, 2 * half - c))] = -1
    b.part[:] = part.ravel().tolist()

    wrapped = np.concatenate([grid, grid[:, :1]], 1)
    b.add(grid_quads(wrapped)[cells.ravel()])
    b.add(grid_quads(grid[r0 : r1 + 1 : 3, c + 1 : 2 * half - c]))
    left, _ = b.new_pair(((r1 - r0) // 3, 2), CRANIUM, CRANIUM)
    fine, coarse = grid[r0 : r1 + 1, c], grid[r0 : r1 + 1 : 3, c + 1]
    for g, (i, j) in enumerate(left):
        l0, l1, l2, l3 = fine[3 * g : 3 * g + 4]
        q0, q1 = coarse[g : g + 2]
        b.add(np.array([[l0, q0, i, l1], [l1, i, j, l2], [l2, j, q1, l3], [i, q0, q1, j]]), both=True)

    # the crown
    across, deep = t.crown_across, half - t.crown_across
    top = grid[-1]
    interior = b.new((deep - 1, across - 1), CRANIUM)
    b.pair(interior, interior[:, ::-1])
    block = np.empty((deep + 1, across + 1), int)  # row 0 in front, columns towards the character's left
    s = across // 2
    block[0] = top[np.arange(-s, s + 1)]
    block[-1] = top[half - np.arange(-s, s + 1)]
    block[:, -1] = top[s : s + deep + 1]
    block[:, 0] = top[-np.arange(s, s + deep + 1)]
    block[1:-1, 1:-1] = interior
    b.add(grid_quads(block))
    grids.update(
        body=np.where(part < 0, -1, grid),
        crown=block,
        transition_left=left,
        transition_right=np.asarray(b.mirror)[left],
    )
    grids["_full"] = grid


def _midline_rings(b: _Builder, recipe: Recipe, grids: dict) -> None:
    """Add the mouth: skin rings between the block and the lip seam, then the mouth bag and its cap."""
    t, grid = recipe.template, grids["_full"]
    (r0, r1), c = t.mouth_rows, t.mouth_columns
    outer = block_ring(grid[r0 : r1 + 1][:, np.arange(-c, c + 1)])
    k = len(outer)
    skin = b.new((t.mouth_rings, k), FACE)
    bag = b.new((len(recipe.mouth.bag_rings), k), BAG)
    interior = b.new((r1 - r0 - 1, 2 * c - 1), BAG)
    b.pair(skin, skin[:, ring_mirror(k)])
    b.pair(bag, bag[:, ring_mirror(k)])
    b.pair(interior, interior[:, ::-1])
    mouth = np.concatenate([skin, outer[None]])
    cap = fill_block(bag[-1], r1 - r0, 2 * c, interior)
    b.add(ring_quads(mouth))
    b.add(ring_quads(np.concatenate([bag[::-1], skin[:1]])))
    b.add(grid_quads(cap))
    grids.update(mouth=mouth, mouth_bag=bag, mouth_cap=cap)


def _paired_rings(b: _Builder, recipe: Recipe, grids: dict) -> None:
    """Add eyes with inner lids, nostrils and ears: rings inside their blocks, left and right together."""
    t = recipe.template
    parts = (
        ("eye", t.eye_rows, t.eye_columns, t.eye_rings, FACE, FACE),
        ("nostril", t.nostril_rows, t.nostril_columns, t.nostril_rings, FACE, FACE),
        ("ear", t.ear_rows, t.ear_columns, t.ear_rings, EAR_LEFT, EAR_RIGHT),
    )
    for name, (r0, r1), (c0, c1), count, left_part, right_part in parts:
        outer = block_ring(grids["_full"][r0 : r1 + 1, c0 : c1 + 1])
        left, _ = b.new_pair((count, len(outer)), left_part, right_part)
        mirror = np.asarray(b.mirror)
        rings = np.concatenate([left, outer[None]])
        b.add(ring_quads(rings), both=True)
        grids[f"{name}_left"], grids[f"{name}_right"] = rings, mirror[rings]
        if name == "eye":
            inner, _ = b.new_pair((t.lid_rings, len(outer)), LID_LEFT, LID_RIGHT)
            b.add(ring_quads(np.concatenate([inner[::-1], left[:1]])), both=True)
            grids["lid_inner_left"], grids["lid_inner_right"] = inner, np.asarray(b.mirror)[inner]
        else:
            interior, _ = b.new_pair((r1 - r0 - 1, c1 - c0 - 1), left_part, right_part)
            cap = fill_block(left[0], r1 - r0, c1 - c0, interior)
            b.add(grid_quads(cap), both=True)
            grids[f"{name}_cap_left"], grids[f"{name}_cap_right"] = cap, np.asarray(b.mirror)[cap]
    del grids["_full"]


def _gums_and_tongue(b: _Builder, recipe: Recipe, grids: dict) -> None:
    """Add the gums, open strips with rows from the outside over the ridge inwards, and the tongue, open at its root."""
    t = recipe.tongue
    for name, part, columns in (
        ("gum_upper", GUM_UPPER, t.gum_columns_upper),
        ("gum_lower", GUM_LOWER, t.gum_columns_lower),
    ):
        gum = b.new((t.gum_rows, columns), part)
        b.pair(gum, gum[:, ::-1])
        b.add(grid_quads(gum if name == "gum_lower" else gum[::-1]))
        grids[name] = gum
    ring = 2 * sum(t.cap)
    rows = b.new((t.rows, ring), TONGUE)  # from the root to the tip
    b.pair(rows, rows[:, ring_mirror(ring)])
    interior = b.new((t.cap[0] - 1, t.cap[1] - 1), TONGUE)
    b.pair(interior, interior[:, ::-1])
    cap = fill_block(rows[-1], *t.cap, interior)
    b.add(ring_quads(rows[::-1]))
    b.add(grid_quads(cap))
    grids.update(tongue=rows, tongue_cap=cap)


def _frills(b: _Builder, recipe: Recipe, grids: dict) -> None:
    """Add the frills, open at their roots, closed at their tips by a strip."""
    f = recipe.frills
    for i, name in enumerate(frill_settings(recipe)):
        part = len(PARTS) + 2 * i
        rows, other = b.new_pair((f.rows, f.ring), part, part + 1)  # from the root to the tip
        cap = fill_block(rows[-1], 1, f.ring // 2 - 1, np.empty((0, f.ring // 2 - 2), int))
        b.add(ring_quads(rows[::-1]), both=True)
        b.add(grid_quads(cap), both=True)
        grids[f"frill_{name}_left"], grids[f"frill_{name}_right"] = rows, other


def _teeth(b: _Builder, recipe: Recipe, grids: dict, first_part: int) -> tuple[str, ...]:
    """Add teeth: rings from the root to the edge, closed by a strip; the upper ones from right to left, then the lower.

    Returns the names of their parts.
    """
    if recipe.teeth.style == "strip":
        return _strips(b, recipe, grids, first_part)
    t, names, teeth = recipe.teeth, [], []
    for jaw, count in (("upper", t.upper), ("lower", t.lower)):
        first = len(teeth)
        for i in range(count):
            teeth.append(b.new((t.rings * t.ring,), first_part + len(names)))
            names.append(f"tooth_{jaw}_{i + 1:02d}")
        for i in range(count // 2):
            right, left = (teeth[first + j].reshape(t.rings, t.ring) for j in (i, count - 1 - i))
            b.pair(left, right[:, ring_mirror(t.ring, corner=True)])
    grids["teeth"] = np.asarray(teeth)
    for ids in teeth:
        rings = ids.reshape(t.rings, t.ring)
        b.add(ring_quads(rings[::-1]))
        b.add(grid_quads(fill_block(rings[-1], 1, t.ring // 2 - 1, np.empty((0, t.ring // 2 - 2), int))))
    return tuple(names)


def _strips(b: _Builder, recipe: Recipe, grids: dict, first_part: int) -> tuple[str, ...]:
    """Add teeth as one strip per jaw: rows from the outside over the edge inwards, columns from right to left."""
    t, teeth = recipe.teeth, []
    for jaw in range(2):
        strip = b.new((t.ring, 2 * max(t.upper, t.lower) + 1), first_part + jaw)
        b.pair(strip, strip[:, ::-1])
        b.add(grid_quads(strip if jaw else strip[::-1]))
        teeth.append(strip.ravel())
    grids["teeth"] = np.asarray(teeth)
    return "teeth_upper", "teeth_lower"


def check_count(recipe: Recipe, layout: Layout) -> None:
    """Raise InputError unless a layout has as many vertices as its recipe says."""
    if len(layout.part) != recipe.vertices:
        raise InputError(
            f"{recipe.file}: vertices: expected {len(layout.part)}, the count that the template gives, "
            f"got {recipe.vertices}"
        )


# Blocks and rings of vertex indices, and the cells between them.


def block_ring(block: Int[np.ndarray, "rows columns"]) -> Int[np.ndarray, " k"]:
    """Return a block's boundary as a ring: from the middle of its right side over the top, the left and the bottom."""
    m, h = block.shape[0] - 1, (block.shape[0] - 1) // 2
    return np.concatenate([block[h:m, -1], block[m, :0:-1], block[m:0:-1, 0], block[0, :-1], block[:h, -1]])


def grid_quads(grid: Int[np.ndarray, "rows columns"]) -> Int[np.ndarray, "q 4"]:
    """Return the cells of a grid whose rows run up and whose columns run to the right, seen from outside."""
    return np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], -1).reshape(-1, 4)


def ring_quads(rings: Int[np.ndarray, "rings k"]) -> Int[np.ndarray, "q 4"]:
    """Return the cells between closed rings, listed from the inside outwards and anticlockwise seen from outside."""
    loops = np.concatenate([rings, rings[:, :1]], 1)
    return np.stack([loops[:-1, :-1], loops[1:, :-1], loops[1:, 1:], loops[:-1, 1:]], -1).reshape(-1, 4)


def fill_block(
    ring: Int[np.ndarray, " k"], rows: int, columns: int, interior: Int[np.ndarray, "rows columns"]
) -> np.ndarray:
    """Return the (rows + 1, columns + 1) block with the given boundary ring and interior."""
    block = np.empty((rows + 1, columns + 1), int)
    block.flat[block_ring(np.arange(block.size).reshape(block.shape))] = ring
    block[1:-1, 1:-1] = interior
    return block


def ring_mirror(k: int, corner: bool = False) -> Int[np.ndarray, " k"]:
    """Return the mirror image of each position of a ring across the midline.

    corner: whether the ring starts at a corner, as that of a block one row high does.
    """
    return (k // 2 + corner - np.arange(k)) % k
