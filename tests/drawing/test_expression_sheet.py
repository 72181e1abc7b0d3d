"""The sheet of a character's expressions: every pose with its title and its props."""

from types import SimpleNamespace

import numpy as np
import pytest
from bumpy_plate import bumpy_plate
from plain_rig import PlainRig

from replicate.drawing.characters import expression_sheet, segment_colours
from replicate.geometry.mesh import Mesh
from replicate.report.pose_record import PoseRecord


@pytest.fixture
def record() -> PoseRecord:
    """A bumpy plate that two methods predict."""
    return bumpy_plate()


def test_an_expression_sheet_shows_every_pose_with_its_title_and_props(record):
    uv = (record.neutral[:, :2] + 90) / 180
    teeth = np.int32(record.neutral[:, 1] < -50)
    mesh = Mesh(record.neutral, record.faces, uv, teeth, ("face", "tooth_upper_01"))
    assert {tuple(colour) for colour in segment_colours(mesh)} == {(226, 178, 148), (245, 242, 230)}
    eye = record.neutral * 0.2 + np.float32([0, 0, 60])

    class Rig(SimpleNamespace, PlainRig):
        def __call__(self, params):
            return mesh.neutral + np.float32([params[0], 0, 0])

        def pose_props(self, params):
            return [("eye", eye, record.faces, (0.0, 0.0, 1.0))]

    rig = Rig(name="plate", mesh=mesh, controls=[None])
    poses = {"rest": np.zeros(1), "left": np.full(1, -30.0), "right": np.full(1, 30.0)}
    figure, words = expression_sheet(rig, poses, columns=2, width=60, height=50)
    pictures = [axes.images[0].get_array() for axes in figure.axes]
    assert [text.get_text() for text in figure.texts] == ["rest", "left", "right", ""]
    assert len(pictures) == 4 and (pictures[3] == 255).all()
    assert (pictures[1] != pictures[2]).any() and (pictures[0][..., 2] > pictures[0][..., 0] + 60).any()
    assert "plate in 3 poses: rest, left, right" in words.alt
