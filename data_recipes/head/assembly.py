"""A head's positions: pins and relaxation for the skin, explicit shapes for what lies inside; and its triangles."""

from __future__ import annotations

from functools import partial

import numpy as np
from jaxtyping import Float, Int

from data_recipes.head import dentition, ears, eyes, frills, mouth, nostrils, placement
from data_recipes.head.shape import Shape
from data_recipes.head.topology import CRANIUM, FACE, NECK, Layout
from data_recipes.recipe.reading import Recipe


def triangulate(
    x: Float[np.ndarray, "n 3"], quads: Int[np.ndarray, "q 4"], mirror: Int[np.ndarray, " n"]
) -> Int[np.ndarray, "f 3"]:
    """Cut quads along their shorter diagonal, ties by the smallest index; mirrored quads are cut alike."""
    a = np.linalg.norm(x[quads[:, 0]] - x[quads[:, 2]], axis=1)
    b = np.linalg.norm(x[quads[:, 1]] - x[quads[:, 3]], axis=1)
    first = a < b - 1e-6
    tie = np.abs(a - b) <= 1e-6
    low = np.minimum(np.minimum(quads, mirror[quads])[:, 0], np.minimum(quads, mirror[quads])[:, 2])
    high = np.minimum(np.minimum(quads, mirror[quads])[:, 1], np.minimum(quads, mirror[quads])[:, 3])
    first |= tie & (low < high)
    p = np.where(first[:, None], quads, np.roll(quads, -1, axis=1))
    return np.concatenate([p[:, [0, 1, 2]], p[:, [0, 2, 3]]]).astype(np.int32)


def place(shape: Shape, layout: Layout) -> Float[np.ndarray, "n 3"]:
    """Pin the feature curves, relax the skin, and set the explicit parts."""
    recipe, grids = shape.recipe, layout.grids
    t = recipe.template
    k = grids["mouth"].shape[1]
    seam, border = mouth.lip_pins(shape, k)
    rim = eyes.rim_pins(recipe, grids["eye_left"].shape[1])
    nostril = nostrils.nostril_rings(shape, grids["nostril_left"].shape[1], nostrils.nostril_rim(recipe) + 1)
    base = ears.base_pins(shape, grids["ear_left"].shape[1])
    bottom = grids["body"][0]
    tips = mouth.corner_pins(shape)
    pins = {
        "corner": (grids["mouth"][1 : len(tips) + 1, 0], tips),
        "seam": (grids["mouth"][0], seam),
        "border": (grids["mouth"][t.lip_rings], border),
        "rim": (grids["eye_left"][0], rim),
        "nostril": (grids["nostril_left"][: len(nostril)], nostril),
        "ear": (grids["ear_left"][-1], base),
    }
    x = placement.start(shape, layout, pins)
    surface, is_pinned = np.isin(layout.part, (FACE, CRANIUM, NECK)), np.zeros(len(x), bool)
    for ids in (
        grids["mouth_bag"],
        grids["nostril_left"][: len(nostril) - 1],
        grids["nostril_cap_left"],
        grids["ear_left"][:-1],
    ):
        surface[ids], surface[layout.mirror[ids]] = False, False
    is_pinned[bottom] = True
    for ids, _ in pins.values():
        is_pinned[ids], is_pinned[layout.mirror[ids]] = True, True
    x = placement.relax(shape, layout, x, surface, is_pinned, weights(recipe, layout))

    x[grids["mouth_bag"]] = mouth.bag_positions(recipe, x[grids["mouth"][0]], len(grids["mouth_bag"]))
    x[grids["mouth_cap"]] = mouth.fill_cap(x[grids["mouth_cap"]])
    x[grids["lid_inner_left"]] = eyes.inner_lids(recipe, grids["lid_inner_left"].shape[1], t.lid_rings)
    x[grids["ear_left"][:-1]] = ears.ear_rings(recipe, x[grids["ear_left"][-1]], t.ear_rings)
    for cap in ("ear_cap_left", "nostril_cap_left"):
        x[grids[cap]] = mouth.fill_cap(x[grids[cap]])
    front = seam[:, 2].max() - recipe.teeth.setback
    jaw = partial(dentition.tooth_positions, recipe, front)
    x[grids["teeth"]] = np.concatenate([jaw(True), jaw(False)])
    for name, upper in (("gum_upper", True), ("gum_lower", False)):
        x[grids[name]] = dentition.gum_positions(recipe, front, upper, *grids[name].shape)
    x[grids["tongue"]] = dentition.tongue_positions(recipe, front, *grids["tongue"].shape)
    x[grids["tongue_cap"]] = mouth.fill_cap(x[grids["tongue_cap"]])
    for name, numbers in frills.frill_numbers(recipe).items():
        grid = grids[f"frill_{name}_left"]
        x[grid] = frills.frill_positions(shape, numbers, *grid.shape)
    return placement.mirror_left(layout, x)


def weights(recipe: Recipe, layout: Layout) -> Float[np.ndarray, " n"]:
    """Return how strongly each vertex draws its neighbours: the face is finer than the back, its rings finer still."""
    t, grids = recipe.template, layout.grids
    weight = np.ones(len(layout.part))
    body = grids["body"]
    row, column = np.indices(body.shape)
    column = np.minimum(column, body.shape[1] - column)
    face = np.clip((t.face_columns + 3 - column) / 6.0, 0, 1)
    forehead = face * np.clip((row - t.eye_rows[1]) / 3.0, 0, 1) * np.clip((t.hair_row + 3 - row) / 4.0, 0, 1)
    nose = np.exp(-((column / t.nostril_columns[1]) ** 4)) * (row > t.nostril_rows[0] - 1) * (row < t.eye_rows[1])
    total = 1 + 2.2 * face + 2.6 * forehead + t.nose_weight * nose
    weight[body[body >= 0]] = total[body >= 0]
    for name, ring in (
        ("mouth", 5.5),
        ("eye_left", 5.5),
        ("eye_right", 5.5),
        ("nostril_left", 2.5),
        ("nostril_right", 2.5),
    ):
        weight[grids[name][:-1]] = ring
    return weight
