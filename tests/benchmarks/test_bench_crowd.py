"""Frames of several characters: who is where, whether all ways pose them alike, and the table."""

import numpy as np
from small_face import pose_offsets
from untrained_models import MESH, MODELS

from replicate.approximation.rigid import find_attachments
from replicate.benchmarks.bench_crowd import TABLE, crowd, crowd_table, start_table, ways_of
from replicate.methods.method import Method
from replicate.report.results import Row

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


def test_the_table_has_a_column_for_each_number_of_characters():
    def row(method, characters, value):
        facts = (value, None, 1, 5, "bench", "teen")
        return Row(TABLE, "teen", method, f"frames_per_s[{characters}]", "count", *facts)

    given = [row("dense", 1, 1234.5), row("dense", 100, 12.0), row("dense_fast", 1, 2000.0), row("linear", 1, 3.0)]
    table = crowd_table(given, "teen")
    assert table.headers[0][2:] == ("1 character", "10 characters", "100 characters")
    assert table.body[0] == ("Dense", "the suite's", "1,234.5", "–", "12.0")
    assert table.body[1][:2] == ("Dense", "fast") and table.body[2] is None and table.body[3][0] == "Linear"


def test_what_a_method_needs_until_its_first_pose_has_a_table_of_its_own():
    numbers = (
        ("dense", "first_pose", "s", 2.5),
        ("dense", "peak_memory", "MB", 300.0),
        ("dense", "model_size", "MB", 4.0),
    )
    numbers += (("dense_onnx", "first_pose", "s", 0.5),)
    rows = [Row(TABLE, "teen", *number, None, 1, 2, "bench", "teen") for number in numbers]
    table = start_table(rows, "teen")
    assert [line[:2] for line in table.body] == [("Dense", "the suite's"), ("Dense", "ONNX Runtime")]
    assert table.body[0][3] == "2.5" and table.body[1][3] == "0.5"
    assert table.body[0][2] == table.body[1][2] != "–", "both ways evaluate the same model"
    assert table.body[1][4] == "–" and start_table([], "teen") is None
