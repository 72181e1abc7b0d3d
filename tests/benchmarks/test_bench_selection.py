"""Readings of §3.3: their rules for the number of clusters, and how they are shown."""

from types import SimpleNamespace

import numpy as np
import pytest
from plain_rig import PlainRig

from replicate.approximation.segments import make_segment
from replicate.benchmarks import bench_selection as selection
from replicate.report.results import Row

BENT = [1.0, 0.6, 0.2, 0.18, 0.16, 0.14, 0.12, 0.10, 0.09, 0.08, 0.07]
EVEN = [1.0, 0.7, 0.5, 0.4, 0.33, 0.28, 0.24, 0.2, 0.17, 0.15, 0.13]


def test_the_rules_take_the_bend_the_gap_and_the_share():
    assert selection.chord([100, 60, 20, 18, 16, 14, 12, 10]) == 3
    assert selection.count("chord10", BENT, EVEN) == selection.count("gap", BENT, EVEN) == 3
    assert selection.count("explained", BENT, EVEN) == 8
    assert selection.count("explained", BENT[:4], EVEN[:4]) == 4  # never reached


def test_in_one_plane_all_charts_have_the_same_centroids():
    uv = np.random.default_rng(0).uniform(0, 1, (1500, 2)).astype(np.float32)
    influence = np.ones((3000, 2), bool)
    segments = [make_segment(name, np.arange(1500) + 1500 * i, uv, influence) for i, name in enumerate("ab")]
    errors = np.zeros(3000)
    errors[:1500] = sum(np.exp(-((uv - place) ** 2).sum(1) / 0.002) for place in (0.2, 0.8))
    k, (a, b) = selection.centroids(segments, errors, "plane")["gap"]
    assert k == 2 and a is b
    np.testing.assert_allclose(np.sort(a, axis=0), [[0.2, 0.2], [0.8, 0.8]], atol=0.02)
    k, (a, b) = selection.centroids(segments, errors, "charts")["gap"]
    assert len(a) == k and len(b) == 0  # the chart without an error gets none


def test_the_table_has_a_line_a_reading():
    rows = [
        Row(selection.TABLE, "teen", "offsets_charts_gap", metric, unit, 4.0, None, 1, 9, "quick", "run")
        for metric, (unit, _) in selection.METRICS.items()
    ]
    table = selection.selection_table(rows, "teen")
    lines = {line[0]: line[1:] for line in table.body if line}
    assert lines["offsets, a cluster in one chart, gap"] == ("4", "4", "4.00", "4.00", "4.00")
    assert len(lines) == 16 and set(lines["positions, all charts in one plane, gap"]) == {"–"}


class Smooth(PlainRig):
    """A rig of ours whose chain of deformers has no wrinkles."""

    name = "smooth"

    def wrinkle_states(self, params):
        return {}


@pytest.mark.parametrize("rig", [PlainRig(), Smooth()])
def test_a_rig_without_wrinkles_ends_in_a_sentence_before_anything_is_made(rig, monkeypatch, capsys):
    monkeypatch.setattr(selection.artefacts, "rig_of", lambda name: rig)
    monkeypatch.setattr(selection, "readings", lambda *inputs: pytest.fail("it makes samples"))
    assert selection.main(["--characters", "teen"]) == 2
    assert f"the rig {rig.name} has no wrinkles" in capsys.readouterr().err


def test_wrinkled_vertices_are_those_of_all_regions_each_once():
    class Wrinkled(PlainRig):
        def wrinkle_states(self, params):
            return {name: SimpleNamespace(vertices=np.array(v)) for name, v in (("brow", [4, 2]), ("nose", [2, 7]))}

    assert selection.wrinkled_vertices(Wrinkled()).tolist() == [2, 4, 7]


def test_a_character_that_there_is_not_is_named(capsys):
    assert selection.main(["--characters", "nobody"]) == 2
    assert "nobody" in capsys.readouterr().err
