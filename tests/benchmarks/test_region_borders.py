"""Borders of regions: which faces lie on them, errors there and nowhere else; and the method beside others."""

import numpy as np
import pytest
from sample_rows import mean_rows
from small_face import small_mesh

from replicate.benchmarks.bench_regional import (
    COSTS,
    ERRORS,
    border_faces,
    borders_table,
    mean_normal_errors,
    overview_table,
)
from replicate.regional.basis import split_regions
from replicate.report.results import Row

MESH = small_mesh()
MOVABLE = np.flatnonzero(MESH.segment == 0)


def test_every_face_of_what_moves_is_on_a_border_or_within_a_region():
    border, inner = border_faces(MESH, MOVABLE, 4)
    moved = np.isin(MESH.faces, MOVABLE).all(1)
    assert ((border ^ inner) == moved).all() and border.any() and inner.any()
    first = set(MOVABLE[split_regions(MESH.neutral[MOVABLE], 4)[0]].tolist())
    shares = {len(first.intersection(face)) for face in MESH.faces[border].tolist()}
    assert shares & {1, 2} and {len(first.intersection(face)) for face in MESH.faces[inner].tolist()} == {0, 3}
    assert not border_faces(MESH, MOVABLE, 1)[0].any()


def test_a_step_between_regions_is_an_error_on_borders_alone():
    groups = border_faces(MESH, MOVABLE, 2)
    step = np.zeros_like(MESH.neutral)
    step[MOVABLE[split_regions(MESH.neutral[MOVABLE], 2)[0]]] = 0.1 * np.ptp(MESH.neutral, axis=0)

    def offsets_of(params):
        return np.broadcast_to(step, (len(params), *step.shape))

    truth = np.zeros((20, *step.shape), np.float32)
    border, inner = mean_normal_errors(MESH, offsets_of, np.zeros((20, 3)), truth, groups)
    assert border > 5 and inner == pytest.approx(0, abs=1e-3)


def test_the_table_has_the_ratio_of_both():
    facts = ("deg", 0.5, None, 1, 64, "laptop", "bench-regional")
    rows = [Row("bench_regional", "teen", "regional", "border_normal_error[as it is]", *facts)]
    rows.append(Row("bench_regional", "teen", "regional", "inner_normal_error[as it is]", "deg", 0.4, *facts[2:]))
    assert borders_table(rows, ("as it is", "no line")).body == (("as it is", "0.50", "0.40", "1.25"),)


def test_the_overview_has_a_column_for_each_character_and_costs_in_millions():
    products = Row("table2", "teen", "refined", "multiplications", "count", 227_250_000.0, None, 1, None, "quick", "r")
    rows = [*mean_rows(normal={"refined": 0.5}), *mean_rows(character="toon"), products]
    errors, costs = (overview_table(rows, "Errors", metrics) for metrics in (ERRORS, COSTS))
    assert errors.headers == (("", "teen", "toon"),) and errors.body[1] == ("Refined", "0.50", "1.00")
    assert ("Refined", "227.25", "–") in costs.body
