"""The growth of costs: models of any size that all ways evaluate alike, the table, and the figure."""

from dataclasses import replace

import numpy as np
import pytest

from replicate.benchmarks import bench_growth
from replicate.benchmarks.bench_growth import OURS as METHOD
from replicate.benchmarks.bench_growth import (
    Face,
    flat_mesh,
    growth_figure,
    growth_tables,
    measure,
    models_of,
    random_poses,
    ways_of,
)
from replicate.methods.regional import RegionalConfig

OURS = "Regional (ours)"
SMALL = Face(vertices=96, segments=2, map_size=16, components=20)


@pytest.fixture
def _small(monkeypatch):
    monkeypatch.setattr(bench_growth, "Face", lambda: SMALL)


def test_all_ways_to_evaluate_a_random_model_agree_and_its_vertices_move(_small):
    neutral, pose = flat_mesh(96).neutral, random_poses()[:1]
    ways = ways_of("vertices", 96)
    assert set(ways) == {"coarse_plain", "coarse_fast", "dense_fast", "linear_fast", "regional", "regional_fast"}
    for own, fast in (("coarse_plain", "coarse_fast"), ("regional", "regional_fast")):
        moved = ways[own](pose)[0]
        np.testing.assert_allclose(ways[fast](pose) - neutral, moved, atol=1e-3)
        assert np.abs(moved).max() > 0.01


def test_a_larger_face_has_what_it_is_larger_in():
    model = models_of(replace(SMALL, segments=3, map_size=32), ("coarse",))["coarse"]
    assert len(model.networks) == 3 and {network.map_size for network in model.networks} == {32}
    ours = models_of(replace(SMALL, components=30, vertices=200), ("regional",))["regional"]
    assert {len(basis.steps) for basis in ours.bases} == {30} and ours.vertex_count == 200


def test_a_pose_moves_some_of_the_controls():
    assert 0.2 < (random_poses() != 0).mean() < 0.3


def test_ours_is_as_its_method_has_it():
    section = RegionalConfig()
    (ours,) = models_of(Face(vertices=200), (METHOD,)).values()
    networks = ours.network.networks
    assert len(ours.bases) == section.regions and {len(basis.fine) for basis in ours.bases} == {section.fine}
    assert len(networks) == (section.regions if section.by_region else 1)
    assert len(networks[0].layers) == len(section.hidden) and networks[0].output.in_features == section.hidden[-1]
    assert section.components == Face().components


def test_tables_and_figure_have_a_place_for_each_size_that_is_varied(_small, monkeypatch):
    sizes = {"vertices": (48, 96), "segments": (1, 2), "map_size": (16,), "components": (18, 20)}
    monkeypatch.setattr(bench_growth, "SIZES", sizes)
    rows = measure(2, sizes)
    tables = growth_tables(rows)
    assert [table.headers[0][1:] for table in tables] == [("48", "96"), ("1", "2"), ("16",), ("18", "20")]
    assert [line[0] for line in tables[3].body] == [OURS, f"{OURS}, fast"]
    figure, words = growth_figure(rows)
    assert figure.axes[0].get_xlabel() == "vertices" and len(figure.axes) == 4
    assert "Linear, fast, 48 to 96 vertices" in words.alt
