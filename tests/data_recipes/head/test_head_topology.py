"""The topology: counts, orientation, mirror map, grids."""

import numpy as np
import pytest
from heads import NAMES, head

from data_recipes.head.topology import block_ring, fill_block, grid_quads, ring_mirror, ring_quads

DEFORMABLE = (
    "face",
    "cranium",
    "neck",
    "ear_left",
    "ear_right",
    "lids_inner",
    "mouth_bag",
    "gum_upper",
    "gum_lower",
    "tongue",
)


def directed_edges(cells):
    return np.stack([cells, np.roll(cells, -1, axis=1)], -1).reshape(-1, 2)


def test_teen_has_the_papers_counts():
    teen = head("teen")
    assert len(teen.vertices) == 12510
    bands = ("face_1", "face_2", "face_3", "face_4")
    assert teen.segment_names[:10] == (
        *bands, "cranium", "neck", "ears", "lids_inner", "mouth_bag", "gums_and_tongue"
    )  # fmt: skip
    teeth = teen.segment_names[10:]
    assert len(teeth) == 26
    assert sum(name.startswith("tooth_upper") for name in teeth) == 14
    counts = np.bincount(teen.segment)
    assert (counts[10:] == 50).all()
    assert (teen.teeth_jaw == np.repeat([1, -1], [14, 12])).all()


@pytest.mark.parametrize(
    "name, vertices, deformable, upper, lower", [("woman", 12828, 7, 12, 12), ("toon", 4922, 6, 1, 1)]
)
def test_woman_and_toon_have_the_papers_counts(name, vertices, deformable, upper, lower):
    h = head(name)
    assert len(h.vertices) == vertices
    teeth = h.segment_names[deformable:]
    assert not any(segment.startswith(("tooth", "teeth")) for segment in h.segment_names[:deformable])
    assert [sum(jaw in segment for segment in teeth) for jaw in ("upper", "lower")] == [upper, lower]
    assert len(teeth) == upper + lower
    assert (h.teeth_jaw == np.repeat([1, -1], [upper, lower])).all()


def test_tiny_has_every_part_in_few_vertices():
    tiny = head("tiny")
    assert len(tiny.vertices) == tiny.recipe.vertices < 1000
    assert tiny.segment_names[:10] == DEFORMABLE
    assert len(tiny.segment_names) >= 14
    assert (np.bincount(tiny.segment) > 0).all()


@pytest.mark.parametrize("name", NAMES)
def test_parts_are_contiguous_runs_of_vertices(name):
    assert (np.diff(head(name).part) >= 0).all()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("cells", ("faces", "quads"))
def test_each_edge_has_at_most_two_cells_which_face_the_same_way(name, cells):
    edges = directed_edges(getattr(head(name), cells))
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert (edges[:, 0] != edges[:, 1]).all()


@pytest.mark.parametrize("name", NAMES)
def test_open_edges_are_where_they_belong(name):
    h = head(name)
    edges = directed_edges(h.quads)
    edge_set = set(map(tuple, edges.tolist()))
    loose = {a for a, b in edge_set if (b, a) not in edge_set}
    expected = set(h.grids["body"][0].tolist()) | set(h.grids["tongue"][0].tolist())
    for side in ("left", "right"):
        expected |= set(h.grids[f"lid_inner_{side}"][-1].tolist())
    for jaw in ("upper", "lower"):
        gum = h.grids[f"gum_{jaw}"]
        expected |= set(np.concatenate([gum[0], gum[-1], gum[:, 0], gum[:, -1]]).tolist())
    if h.recipe.teeth.style == "strip":
        for strip in h.grids["teeth"].reshape(2, h.recipe.teeth.ring, -1):
            expected |= set(np.concatenate([strip[0], strip[-1], strip[:, 0], strip[:, -1]]).tolist())
    else:
        expected |= set(h.grids["teeth"][:, : h.recipe.teeth.ring].ravel().tolist())
    assert loose == expected


@pytest.mark.parametrize("name", NAMES)
def test_every_vertex_is_used_and_in_one_chart_face(name):
    h = head(name if name == "tiny" else f"{name}@one_face")  # a cut across the face leaves a few vertices without
    same = (h.segment[h.faces] == h.segment[h.faces][:, :1]).all(1)
    assert len(np.unique(h.faces[same])) == len(h.vertices)


@pytest.mark.parametrize("name", NAMES)
def test_mirror_is_an_involution_that_keeps_faces_and_swaps_sides(name):
    h = head(name)
    assert (h.mirror[h.mirror] == np.arange(len(h.mirror))).all()
    there = {tuple(sorted(face)) for face in h.faces.tolist()}
    assert all(tuple(sorted(face)) in there for face in h.mirror[h.faces].tolist())
    opposite = h.part_names[h.part[h.mirror[h.grids["ear_left"][0, 0]]]]
    assert opposite == "ear_right"


@pytest.mark.parametrize("name", NAMES)
def test_grids_and_curves_hold_valid_indices_and_right_parts_mirror_left_ones(name):
    h = head(name)
    for key, grid in h.grids.items():
        if key != "body":
            assert grid.min() >= 0, key
            assert len(np.unique(grid)) == grid.size, key
        assert grid.max() < len(h.vertices), key
        if key.endswith("_left"):
            assert (h.grids[key.replace("_left", "_right")] == h.mirror[grid]).all(), key
    for key, curve in h.curves.items():
        assert curve.min() >= 0 and len(np.unique(curve)) == len(curve), key
        steps = np.linalg.norm(np.diff(h.vertices[curve], axis=0), axis=1)
        assert steps.max() < 70, key


def test_block_ring_starts_on_the_right_and_runs_over_the_top():
    block = np.arange(15).reshape(3, 5)
    assert block_ring(block).tolist() == [9, 14, 13, 12, 11, 10, 5, 0, 1, 2, 3, 4]
    assert (fill_block(block_ring(block), 2, 4, block[1:-1, 1:-1]) == block).all()


def test_ring_mirror_pairs_the_two_sides_of_a_block():
    for shape, corner in (((3, 5), False), ((2, 5), True)):
        block = np.arange(np.prod(shape)).reshape(shape)
        ring = block_ring(block)
        opposite = dict(zip(block.ravel().tolist(), block[:, ::-1].ravel().tolist(), strict=True))
        assert [opposite[i] for i in ring.tolist()] == ring[ring_mirror(len(ring), corner)].tolist()


def test_grid_and_ring_cells_run_anticlockwise():
    rows, columns = np.mgrid[:3, :4]
    flat = np.stack([columns.ravel(), rows.ravel()], -1).astype(float)
    phase = 2 * np.pi * np.arange(6) / 6
    round_ = np.concatenate([r * np.stack([np.cos(phase), np.sin(phase)], -1) for r in (1, 2, 3)])
    for quads, place in (
        (grid_quads(np.arange(12).reshape(3, 4)), flat),
        (ring_quads(np.arange(18).reshape(3, 6)), round_),
    ):
        a, b, c = (place[quads[:, i]] for i in (0, 1, 2))
        assert (np.cross(b - a, c - a) > 0).all()
