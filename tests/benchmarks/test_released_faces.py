"""Faces of the two recipes: the pose by its rule, and a sheet with the errors of each prediction."""

import numpy as np
import pytest
from small_face import small_mesh

from replicate.benchmarks import bench_released
from replicate.benchmarks.bench_released import SHOWN, median_pose, released_faces
from replicate.report.pose_record import TRUTH, PoseRecord


def test_what_is_shown_is_among_what_is_trained():
    assert all(change in bench_released.CHANGES[method] for method, change in SHOWN)


def test_the_pose_is_the_median_by_motion():
    size = np.float32([3.0, 0.0, 1.0, 9.0, 2.0])
    assert median_pose(size[:, None, None] * np.ones((5, 4, 3), np.float32)) == 4


def test_the_sheet_says_each_predictions_errors():
    mesh = small_mesh()
    truth = mesh.neutral.astype(np.float32)
    vertices = {"Dense: ours": truth + np.float32([3, 4, 0]), "Dense: released": 2 * truth, TRUTH: truth}
    figure, words = released_faces(PoseRecord("tiny", 0, truth, mesh.faces, vertices))
    texts = [text.get_text() for text in figure.texts]
    assert texts.count("5.00 mm") == 1
    angle = float(words.alt.partition("Dense: ours, 5.00 mm and ")[2].partition("°")[0])
    assert angle == pytest.approx(0, abs=0.05), "moved as a whole, it keeps its normals"
    assert "the rig" in texts and len(figure.axes) == 4
