"""Segments and charts of a small model in ICT-FaceKit's format."""

import numpy as np
import pytest
from rig_poses import chart_areas
from small_facekit import PARTS

from data_recipes.ict import facekit_files, facekit_segments
from data_recipes.recipe.reading import load_recipe
from replicate.geometry.mesh import degenerate_faces


def test_the_mask_has_the_parts_in_mm_and_every_tooth_for_itself(mask, kit):
    sizes = {name: int((mask.mesh.segment == k).sum()) for k, name in enumerate(mask.mesh.segment_names)}
    soft = {"face": 37 * 31, "head": 7 * 12, "mouth": 42, "eye_socket_left": 25, "eye_socket_right": 25}
    assert sizes == soft | {"gums_tongue": 24, "tooth_upper_01": 8, "tooth_lower_01": 8}
    assert tuple(sizes)[:6] == PARTS[:6]
    neutral = mask.mesh.neutral
    assert np.ptp(neutral[:, 0]) == pytest.approx(150.0)
    assert neutral[mask.mesh.segment == 3, 0].mean() > 0  # left is +x
    assert not degenerate_faces(neutral, mask.mesh.faces).any()
    # Eyes at the height and depth of our own heads'; the mask's sockets are 5 mm before them.
    sockets = neutral[np.isin(mask.mesh.segment, [3, 4])]
    np.testing.assert_allclose(sockets.mean(axis=0), [0, 0, 66.4], atol=0.5)


def test_charts_are_the_models_own_or_laid_out_anew_and_nothing_flips(mask, kit):
    read = load_recipe(kit)
    segments = facekit_segments.split(facekit_files.read_model(read.vertices), read.parts, read.file)
    uv, anew = facekit_segments.build_charts(facekit_files.read_model(read.vertices), segments, 6)
    assert anew == ("head",)
    np.testing.assert_array_equal(np.clip(uv, 0, 1).astype(np.float32), mask.mesh.uv)
    u, v = np.meshgrid(np.linspace(0.01, 0.99, 31), np.linspace(0.01, 0.99, 37))
    np.testing.assert_allclose(uv[: 37 * 31], np.stack([u.ravel(), v.ravel()], 1), atol=2e-6)
    for k in range(6):
        faces = mask.mesh.faces[(mask.mesh.segment[mask.mesh.faces] == k).all(1)]
        areas = chart_areas(uv, faces)
        assert (areas > 1e-7).all() or (areas < -1e-7).all(), mask.mesh.segment_names[k]


def test_holes_are_bridged_and_borders_come_in_order():
    ring = np.arange(8)
    quads = np.stack([ring, np.roll(ring, -1), np.roll(ring, -1) + 8, ring + 8], 1)
    loops = facekit_segments.border_loops(quads)
    assert sorted(sorted(loop.tolist()) for loop in loops) == [list(range(8)), list(range(8, 16))]
    assert all((np.abs(np.diff(loop)) % 6 == 1).all() for loop in loops)
    uv = facekit_segments.lay_out(quads, np.zeros_like(quads, bool), 16, "ring")
    assert len(np.unique(uv.round(6), axis=0)) == 16
