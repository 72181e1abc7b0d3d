"""A neutral head, put together: its shape, its topology, where its vertices lie, its charts, paint and props."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Int, UInt8

from data_recipes.head import dentition, ears, eyes, frills, mouth, placement
from data_recipes.head.head_charts import build_charts
from data_recipes.head.head_paint import paint
from data_recipes.head.head_props import Prop, build_props
from data_recipes.head.head_segments import build_segments
from data_recipes.head.landmarks import name_curves, name_landmarks
from data_recipes.head.shape import FLIP, Shape, build_shape, eye_frame, skull_distance
from data_recipes.head.topology import CRANIUM, FACE, NECK, Layout, build_layout, check_count
from data_recipes.recipe.reading import Recipe

__all__ = ["Eye", "Head", "Prop", "build_head"]


@dataclass(frozen=True)
class Eye:
    """One eyeball: centre (3,) and radius in mm; `frame` rows are towards the temple, up, and along the gaze."""

    centre: Float[np.ndarray, " 3"]
    radius: float
    frame: Float[np.ndarray, "3 3"]


@dataclass(frozen=True)
class Head:
    """A neutral head.

    Attributes:
        vertices: (n, 3) mm; x towards the character's left, y up, z forward, eyes at y = 0; exactly mirror-symmetric.
        faces, quads: triangles, and the same surface in quads; both face outwards.
        uv, segment, segment_names: a chart in [0, 1]^2 per segment; deformable segments first, then the teeth.
        part, part_names: the part that each vertex belongs to; a segment may have several parts.
        mirror: (n,) the vertex on the other side, or the vertex itself.
        grids: vertex indices by part (see `topology`); rings run from the inside outwards except those of `mouth_bag`
            and `lid_inner_*` (away from the rim) and `tongue` (root to tip). `body` is (rows, columns), -1 where
            removed.
        ring_parameter: `mouth_u` and `eye_u` are the place along the seam or rim in [-1, 1], `mouth_side` and
            `eye_side` +1 on the upper side, -1 on the lower one, 0 in the corners.
        curves, landmarks: vertex indices, in order and single ones.
        mouth_axis: (z, radius) of the wrapped coordinates, mm.
        teeth_jaw: +1 upper, -1 lower, per tooth or strip.
        props, paint: for display only; `paint` is a colour 0–255 for each vertex.
    """

    recipe: Recipe
    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    quads: Int[np.ndarray, "q 4"]
    uv: Float[np.ndarray, "n 2"]
    segment: Int[np.ndarray, " n"]
    segment_names: tuple[str, ...]
    part: Int[np.ndarray, " n"]
    part_names: tuple[str, ...]
    mirror: Int[np.ndarray, " n"]
    grids: dict[str, np.ndarray]
    ring_parameter: dict[str, np.ndarray]
    curves: dict[str, np.ndarray]
    landmarks: dict[str, int]
    eyes: dict[str, Eye]
    jaw_pivot: Float[np.ndarray, " 3"]
    mouth_axis: tuple[float, float]
    teeth_jaw: Int[np.ndarray, " teeth"]
    props: tuple[Prop, ...]
    paint: UInt8[np.ndarray, "n 3"]

    def sdf(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        """Return the distance (mm, negative inside) to the head without lips and lids."""
        return skull_distance(self.recipe, np.asarray(points, float))


def build_head(recipe: Recipe) -> Head:
    """Build a character's neutral head; the same recipe gives the same bytes.

    Raises InputError when the template has another number of vertices than the recipe says.
    """
    layout = build_layout(recipe)
    check_count(recipe, layout)
    shape = build_shape(recipe)
    x = place(shape, layout)
    faces = triangulate(x, layout.quads, layout.mirror)
    mouth_u, mouth_side = mouth.ring_parameter(layout.grids["mouth"].shape[1])
    eye_u, eye_side = mouth.ring_parameter(layout.grids["eye_left"].shape[1])
    curves = name_curves(recipe, layout)
    uv = build_charts(recipe, layout)
    segment, segment_names, uv = build_segments(recipe.charts, layout.part, layout.part_names, uv)
    tooth_names = layout.part_names[-len(layout.grids["teeth"]) :]
    left, frame = np.array(recipe.eyes.centre), eye_frame(recipe)
    both = {
        "left": Eye(left, recipe.eyes.radius, frame),
        "right": Eye(left * FLIP, recipe.eyes.radius, frame * FLIP),
    }
    return Head(
        recipe=recipe,
        vertices=x,
        faces=faces,
        quads=layout.quads,
        uv=uv,
        segment=segment,
        segment_names=segment_names,
        part=layout.part,
        part_names=layout.part_names,
        mirror=layout.mirror,
        grids=layout.grids,
        ring_parameter={"mouth_u": mouth_u, "mouth_side": mouth_side, "eye_u": eye_u, "eye_side": eye_side},
        curves=curves,
        landmarks=name_landmarks(recipe, layout, x),
        eyes=both,
        jaw_pivot=np.array(recipe.skull.jaw_pivot),
        mouth_axis=(recipe.mouth.axis_z, recipe.mouth.axis_radius),
        teeth_jaw=np.array([1 if "upper" in name else -1 for name in tooth_names], np.int32),
        props=build_props(recipe, layout, x),
        paint=paint(recipe, layout, x),
    )


# Where a head's vertices lie, and its triangles.


def triangulate(
    x: Float[np.ndarray, "n 3"], quads: Int[np.ndarray, "q 4"], mirror: Int[np.ndarray, " n"]
) -> Int[np.ndarray, "f 3"]:
    """Cut quads along their shorter diagonal, for a tie at the smallest index; mirrored quads are cut alike."""
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
    """Pin the feature curves, relax the skin, and set the parts inside and the ears."""
    # pins on the left
    recipe, grids = shape.recipe, layout.grids
    t = recipe.template
    k = grids["mouth"].shape[1]
    seam, border = mouth.lip_pins(shape, k)
    rim = eyes.rim_pins(recipe, grids["eye_left"].shape[1])
    nostril = ears.nostril_rings(shape, grids["nostril_left"].shape[1], ears.nostril_rim(recipe) + 1)
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
    # the skin between them
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

    # parts whose shape is given
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
    for name, settings in frills.frill_settings(recipe).items():
        grid = grids[f"frill_{name}_left"]
        x[grid] = frills.frill_positions(shape, settings, *grid.shape)
    return placement.mirror_left(layout, x)


def weights(recipe: Recipe, layout: Layout) -> Float[np.ndarray, " n"]:
    """Return how strongly each vertex pulls its neighbours: most on the rings, more on the face than on the back."""
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
