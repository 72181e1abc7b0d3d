"""A neutral head, put together: its shape, its topology, where its vertices lie, its charts, paint and props."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from data_recipes.head import mouth, placement
from data_recipes.head.assembly import place, triangulate
from data_recipes.head.head_charts import build_charts
from data_recipes.head.head_paint import paint
from data_recipes.head.head_props import Prop, build_props
from data_recipes.head.head_segments import build_segments
from data_recipes.head.landmarks import name_curves, name_landmarks
from data_recipes.head.shape import build_shape, eye_frame, skull_distance
from data_recipes.head.topology import build_layout, check_count
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
        part, part_names: what each vertex belongs to, whichever parts the recipe puts into one segment.
        mirror: (n,) the vertex on the other side, or the vertex itself.
        grids: vertex indices by part (see `topology`); rings run from the inside outwards except those of `mouth_bag`
            and `lid_inner_*` (away from the rim) and `tongue` (root to tip). `body` is (rows, columns), -1 where
            removed.
        ring_parameter: `mouth_u`, `mouth_side`, `eye_u`, `eye_side`: the place along the seam or rim in [-1, 1], and
            +1 upper, -1 lower, 0 in the corners.
        curves: ordered vertex indices; landmarks: single ones.
        mouth_axis: (z, radius) of the wrapped coordinates. jaw_pivot: (3,).
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

    Raises:
        InputError: the template doesn't meet the recipe's vertex count.
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
        "right": Eye(left * placement.FLIP, recipe.eyes.radius, frame * placement.FLIP),
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
