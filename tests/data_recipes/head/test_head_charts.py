"""Charts hold what a deformation map needs: one to one, in the unit square, mirrored as the head is, evenly filled."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from heads import NAMES
from scipy.spatial import cKDTree

from data_recipes.head.head_charts import build_charts
from data_recipes.head.head_segments import build_segments
from data_recipes.head.topology import build_layout
from data_recipes.recipe.reading import load_recipe
from data_recipes.recipe.sections import PARTS

LAYOUTS = ("one_face", "fine")
TEXELS = 32  # of a coarse deformation map


SHARED = {"ears": ("ear_left", "ear_right"), "inside": ("mouth_bag", "gum_upper", "gum_lower", "tongue")}


def merged_recipe():
    """Return a recipe with as few segments as can be: parts share charts, and each jaw's teeth are one strip."""
    tiny = load_recipe("tiny")
    charts = replace(tiny.charts, segments=tiny.charts.segments | SHARED)
    layouts = replace(tiny.layouts, **{tiny.layout: charts})
    return replace(tiny, layouts=layouts, teeth=replace(tiny.teeth, style="strip"))


def layout_and_charts(recipe):
    """Return a head's layout with its segments, and its charts."""
    layout = build_layout(recipe)
    segment, names, uv = build_segments(recipe.charts, layout.part, layout.part_names, build_charts(recipe, layout))
    fields = {name: getattr(layout, name) for name in ("part", "quads", "mirror", "grids")}
    return SimpleNamespace(**fields, segment=segment, segment_names=names), uv


@pytest.fixture(scope="module", params=[*(f"{name}@{layout}" for name in NAMES for layout in LAYOUTS), "merged"])
def chart(request):
    return layout_and_charts(merged_recipe() if request.param == "merged" else load_recipe(request.param))


def triangles(layout, segment, cuts=((0, 1, 2), (0, 2, 3))):
    """Return the triangles of a segment's quads, and those that a quad on its border may be cut into."""
    inside = layout.segment[layout.quads] == segment
    quads, mixed = layout.quads[inside.all(1)], layout.quads[inside.sum(1) == 3]
    corner = np.array([[i for i in quad if layout.segment[i] == segment] for quad in mixed], int).reshape(-1, 3)
    return np.concatenate([*(quads[:, cut] for cut in cuts), corner])


def signed_areas(p):
    a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2


def test_no_triangle_is_flipped_however_quads_are_cut(chart):
    layout, uv = chart
    cuts = ((0, 1, 2), (0, 2, 3), (0, 1, 3), (1, 2, 3))
    for index, name in enumerate(layout.segment_names):
        areas = signed_areas(uv[triangles(layout, index, cuts)].astype(np.float32).astype(float))
        assert len(areas) and areas.min() > 1e-6, name


def test_no_triangles_overlap(chart):
    layout, uv = chart
    for index, name in enumerate(layout.segment_names[:12]):
        p = uv[triangles(layout, index)]
        points = p.mean(1)[:: max(len(p) // 1500, 1)]
        inside = np.ones((len(points), len(p)), bool)
        for i in range(3):
            a, b = p[:, i], p[:, (i + 1) % 3]
            along, towards = b - a, points[:, None] - a
            inside &= along[:, 0] * towards[..., 1] > along[:, 1] * towards[..., 0]
        assert (inside.sum(1) == 1).all(), name


def test_every_vertex_has_a_place_of_its_own_in_the_unit_square(chart):
    layout, uv = chart
    assert uv.min() >= 0 and uv.max() <= 1
    for index, name in enumerate(layout.segment_names):
        places = uv[layout.segment == index]
        assert cKDTree(places).query(places, k=2)[0][:, 1].min() > 1e-3, name


def test_charts_mirror_as_the_head_does(chart):
    layout, uv = chart
    skin = layout.part < len(PARTS)
    np.testing.assert_allclose((uv[layout.mirror] * (-1, 1) + (1, 0))[skin], uv[skin], atol=1e-9)


def test_the_face_stands_upright_with_its_left_to_the_right(chart):
    layout, uv = chart
    mouth, eye = layout.grids["mouth"], layout.grids["eye_left"]
    half = mouth.shape[1] // 2
    assert uv[mouth[0, 0], 0] > 0.5 > uv[mouth[0, half], 0]
    if "face" in layout.segment_names:
        assert uv[eye[0], 1].min() > uv[mouth[0], 1].max()
    assert uv[eye[0, 0], 0] > uv[eye[0, eye.shape[1] // 2], 0] > 0.5


def test_lips_and_lids_lie_apart():
    layout, uv = layout_and_charts(load_recipe("teen@one_face"))
    for name, least in (("mouth", 0.8), ("eye_left", 1.2)):
        rim = layout.grids[name][0]
        k = len(rim)
        upper, lower = rim[np.arange(k // 8, k // 2 - k // 8)], rim[np.arange(k // 2 + k // 8, k - k // 8)]
        apart = np.linalg.norm(uv[upper][:, None] - uv[lower][None], axis=2).min() * TEXELS
        assert apart > least, name


def test_the_teens_face_gives_its_vertices_even_room():
    layout, uv = layout_and_charts(load_recipe("teen@one_face"))
    areas = signed_areas(uv[triangles(layout, 0)])
    # Tutte's map with fixed weights, a chart without our rounds, has 20 here.
    assert np.quantile(areas, 0.95) / np.quantile(areas, 0.05) < 7
    spacing = cKDTree(uv[layout.segment == 0]).query(uv[layout.segment == 0], k=2)[0][:, 1] * TEXELS
    assert np.quantile(spacing, 0.05) > 0.2 and np.median(spacing) > 0.33


def test_parts_of_one_chart_keep_apart_by_more_than_a_texel():
    layout, uv = layout_and_charts(merged_recipe())
    segment, names = layout.segment, layout.segment_names
    assert names == ("face", "cranium", "neck", "ears", "lids_inner", "inside", "teeth_upper", "teeth_lower")
    for index in range(3, 6):
        parts = np.unique(layout.part[segment == index])
        for part in parts:
            mine = uv[layout.part == part]
            others = uv[(segment == index) & (layout.part != part)]
            assert cKDTree(others).query(mine)[0].min() * TEXELS > 1.5
    inside = segment == 5
    shares = np.bincount(layout.part[inside])[np.unique(layout.part[inside])] / inside.sum()
    heights = [np.ptp(uv[layout.part == part, 1]) for part in np.unique(layout.part[inside])]
    np.testing.assert_allclose(heights / np.sum(heights), shares, atol=0.03)


def test_bands_of_the_face_hold_equally_many_vertices_and_lie_one_above_the_other():
    layout, uv = layout_and_charts(load_recipe("teen@fine"))
    whole, face_uv = layout_and_charts(load_recipe("teen@one_face"))
    face = np.flatnonzero(whole.segment == 0)
    bands = [face[layout.segment[face] == k] for k in range(4)]
    assert layout.segment_names[:4] == ("face_1", "face_2", "face_3", "face_4")
    assert sum(map(len, bands)) == len(face) and np.ptp([len(band) for band in bands]) < 0.02 * len(face)
    edges = [(face_uv[band, 1].min(), face_uv[band, 1].max()) for band in bands]
    assert all(below[1] < above[0] for below, above in pairwise(edges))
    for band in bands:
        np.testing.assert_allclose(uv[band].min(0), 0, atol=1e-9)
        np.testing.assert_allclose(uv[band].max(0), 1, atol=1e-9)


def test_evenness_spreads_the_rows_of_a_band_and_leaves_it_full_and_mirrored():
    toon = load_recipe("toon@fine")
    assert toon.charts.evenness > 0

    def in_texel_rows(evenness):
        charts = replace(toon.layouts, fine=replace(toon.charts, evenness=evenness))
        layout, uv = layout_and_charts(replace(toon, layouts=charts))
        places = uv[layout.segment == layout.segment_names.index("face_1"), 1]
        np.testing.assert_allclose([places.min(), places.max()], [0, 1], atol=1e-9)
        return np.bincount((places * (TEXELS - 1)).astype(int).clip(0, TEXELS - 2))

    plain, even = in_texel_rows(0.0), in_texel_rows(toon.charts.evenness)
    assert even.max() < 0.8 * plain.max() and even.min() > 2 * plain.min()
