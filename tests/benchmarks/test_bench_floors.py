"""Floors at several resolutions: errors of the whole and of the refined regions, and how they are shown."""

import numpy as np
import pytest
from small_face import small_mesh, small_samples

from replicate.approximation.rigid import find_attachments
from replicate.benchmarks import bench_floors as floors
from replicate.geometry.mesh import Mesh
from replicate.report.results import Row


def two_squares() -> Mesh:
    """Two separate squares of two triangles each, in one segment."""
    square = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    other = square + np.float32([5, 0, 0])
    neutral = np.concatenate([square, other])
    faces = np.int32([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    return Mesh(neutral, faces, np.zeros((8, 2), np.float32), np.zeros(8, np.int32), ("face",))


def test_a_floor_that_holds_nothing_misses_all_of_the_motion_where_it_is():
    mesh, inside = two_squares(), np.arange(8) >= 4
    offsets = np.zeros((30, 8, 3), np.float32)  # more than a batch
    offsets[:, 5:7, 2] = 1.0  # the second square turns by 45 degrees about its edge x = 5
    errors = floors.floor_errors(mesh, np.zeros_like, offsets, inside)
    assert errors[""] == pytest.approx((2 / 8, 22.5)) and errors["refined"] == pytest.approx((2 / 4, 45.0))
    exact = floors.floor_errors(mesh, lambda o: o, offsets, inside)
    assert exact[""] == exact["refined"] == (0, 0)


def test_a_placed_floor_moves_rigid_segments_with_what_carries_them():
    mesh = small_mesh()
    samples = small_samples(mesh)
    attachments = find_attachments(mesh, mesh.neutral + samples.offsets(np.arange(32)), 0.3, 4)
    tooth = mesh.segment == 2
    assert attachments.segment.tolist() == [2]
    offsets = np.full((2, *mesh.neutral.shape), np.float32([3, 0, 4]))

    def at_rest(true):
        return np.where(tooth[:, None], 0, true).astype(np.float32)

    placed = floors.placed_floor(mesh, attachments, at_rest)
    np.testing.assert_allclose(placed(offsets), offsets, atol=1e-3)
    assert floors.floor_errors(mesh, at_rest, offsets, tooth)["refined"][0] == pytest.approx(5)
    assert floors.floor_errors(mesh, placed, offsets, tooth)["refined"][0] == pytest.approx(0, abs=1e-3)


def test_the_table_sets_each_resolution_against_half_of_it():
    def row(level, metric, value):
        return Row(
            floors.TABLE, "teen", level, f"normal_error_mean[{metric}]", "deg", value, None, 1, 9, "quick", "run"
        )

    rows = [row("coarse", "16", 3.0), row("coarse", "32", 1.5), row("refinement", "32, refined", 1.0)]
    table = floors.floors_table([*rows, row("refinement", "64, refined", 0.4)], "teen")
    lines = {line[0]: line[1:] for line in table.body if line}
    assert lines["coarse maps, 32×32"][3:5] == ("1.50", "0.50")
    assert lines["coarse maps, 16×16"][3:5] == ("3.00", "–")
    assert lines["refinement maps on coarse ones, 64×64"][7:9] == ("0.40", "0.40")


def test_a_character_that_there_is_not_is_named(capsys):
    assert floors.main(["--characters", "nobody"]) == 2
    assert "nobody" in capsys.readouterr().err
