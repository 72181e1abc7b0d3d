"""Frames of several characters: who is where, whether all ways pose them alike, and the table."""

import numpy as np
import pytest
from small_face import pose_offsets
from untrained_models import MESH, MODELS

from replicate.approximation.rigid import find_attachments
from replicate.benchmarks import bench_crowd
from replicate.benchmarks.bench_crowd import TABLE, crowd, crowd_table, energy_rows, ways_of
from replicate.methods.method import Method
from replicate.report.results import Row
from replicate.timing.single_poses import Way

POSES = np.random.default_rng(0).uniform(-1, 1, (9, 12)).astype(np.float32)
ATTACHMENTS = find_attachments(MESH, MESH.neutral + pose_offsets(MESH, POSES), 0.3, 4)


def test_every_character_is_at_another_place_and_goes_on():
    frames = crowd(POSES, 3, 4)
    assert frames.shape == (4, 3, 12)
    np.testing.assert_array_equal(frames[1:, 0], POSES[1:4])
    np.testing.assert_array_equal(frames[0], POSES[[0, 7, 14 % 9]])


def test_all_ways_pose_all_characters_of_a_frame_alike():
    method = Method("dense", "Dense", lambda plan: (), model=lambda inputs: MODELS["dense"]())
    ways = ways_of([method], {}, MESH, ATTACHMENTS)
    assert list(ways) == ["dense", "dense_onnx", "dense_fast"]
    posed = [way.evaluate(crowd(POSES, 5, 1)) for way in ways.values()]
    assert posed[0].shape == (5, len(MESH.neutral), 3) and np.abs(posed[0] - posed[0][:1]).max() > 0.01
    for other in posed[1:]:
        np.testing.assert_allclose(other, posed[0], atol=1e-3)


@pytest.mark.parametrize("name", ["driven", "dense"])
def test_a_method_without_the_rigid_step_is_timed_without_it_in_all_ways(name):
    model = MODELS[name]()
    method = Method(name, name, lambda plan: (), model=lambda inputs: model, rigid_step=False)
    frame = crowd(POSES, 5, 1)
    for way in ways_of([method], {}, MESH, ATTACHMENTS).values():
        np.testing.assert_allclose(way.evaluate(frame), MESH.neutral + model.offsets(frame[0]), atol=1e-3)


def test_the_table_has_a_column_for_each_number_of_characters():
    def row(method, characters, value):
        facts = (value, None, 1, 5, "bench", "teen")
        return Row(TABLE, "teen", method, f"frames_per_s[{characters}]", "count", *facts)

    given = [row("dense", 1, 1234.5), row("dense", 100, 12.0), row("dense_fast", 1, 2000.0), row("linear", 1, 3.0)]
    table = crowd_table(given, "teen")
    assert table.headers[0][2:] == ("1 character", "10 characters", "100 characters")
    assert table.body[0] == ("Dense", "the suite's", "1,234.5", "–", "12.0")
    assert table.body[1][:2] == ("Dense", "fast") and table.body[2] is None and table.body[3][0] == "Linear"


def test_energy_has_a_column_where_it_is_measured_and_a_sentence_where_it_is_not(monkeypatch):
    def row(metric, unit, value):
        return Row(TABLE, "teen", "dense", metric, unit, value, None, 1, 5, "bench", "teen")

    ways = {"dense": Way(lambda frame: frame)}
    monkeypatch.setattr(bench_crowd, "counters", list)
    assert energy_rows(ways, POSES, "teen") == []
    frames = row("frames_per_s[1]", "count", 100.0)
    without = crowd_table([frames], "teen")
    assert len(without.headers[0]) == 5 and any("Energy is not measured" in note for note in without.notes)
    monkeypatch.setattr(bench_crowd, "counters", lambda: ["a counter"])
    monkeypatch.setattr(bench_crowd, "energy_j", lambda call, over: (0.002, len(call()) + 6))
    (energy,) = energy_rows(ways, POSES, "teen")
    assert energy.value == 2.0 and energy.unit == "J" and energy.poses == 7
    measured = crowd_table([frames, energy], "teen")
    assert measured.headers[0][-1] == "J a 1,000 poses" and measured.body[0][-1] == "2.0"
