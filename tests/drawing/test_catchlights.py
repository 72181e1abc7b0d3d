"""The light in an eye."""

import numpy as np
import pytest

from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.scene import Camera, axes


@pytest.mark.parametrize("azimuth", [-40.0, 0.0, 40.0])
def test_a_catchlight_stays_on_the_cameras_side_of_an_eyeball(azimuth):
    turn, pitch = np.meshgrid(np.linspace(0, 6, 20), np.linspace(-1.4, 1.4, 12))
    unit = np.stack([np.cos(pitch) * np.sin(turn), np.sin(pitch), np.cos(pitch) * np.cos(turn)], -1).reshape(-1, 3)
    eye, centre = (20 * unit + (33, 2, 60)).astype(np.float32), np.array([33, 2, 60])
    camera = Camera((0, 0, 40), 264, azimuth)
    props = [(f"eye_{zone}_left", eye[part], np.int32([[0, 1, 2]]), (250, 250, 250))
             for zone, part in (("white", slice(0, 120)), ("iris", slice(120, 240)))]  # fmt: skip
    assert len(prop_surfaces(props)) == 2
    light = prop_surfaces(props, camera)[-1]
    towards = (light.vertices - centre) @ axes(camera)[0].T  # right, up, to the eye
    assert (towards[:, 0] < 0).all() and (towards[:, 1] > 0).all() and (towards[:, 2] > 15).all()
    assert np.linalg.norm(towards, axis=1) == pytest.approx(20 * 1.012, abs=0.1)
