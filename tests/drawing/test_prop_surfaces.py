"""Display-only meshes: they go with the skin that they lie on, eyeballs with none."""

import numpy as np

from replicate.drawing.prop_surfaces import carry_props

FACES = np.int32([[0, 1, 2]])
BROW = np.float32([[0, 0, 1], [4, 0, 1], [0, 4, 1]])


def test_a_brow_goes_with_the_skin_below_it_and_an_eyeball_stays():
    x, y = np.meshgrid(np.arange(-20.0, 21, 2), np.arange(-20.0, 21, 2))
    skin = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1).astype(np.float32)
    away = skin + np.float32([0, 0, 3])
    props = [("brow_left", BROW, FACES, (0, 0, 0)), ("eye_white_left", BROW, FACES, (255, 255, 255))]
    brow, eye = carry_props(props, skin, away)
    np.testing.assert_allclose(brow[1], BROW + np.float32([0, 0, 3]), atol=1e-5)
    assert eye[1] is BROW and brow[0] == "brow_left" and brow[3] == (0, 0, 0)


def test_only_the_skin_nearby_counts():
    skin = np.float32([[0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0], [100, 0, 0], [100, 2, 0]])
    away = skin.copy()
    away[4:] += 50
    brow, *_ = carry_props([("brow_left", BROW, FACES, (0, 0, 0))], skin, away)
    np.testing.assert_allclose(brow[1], BROW, atol=1e-4)
