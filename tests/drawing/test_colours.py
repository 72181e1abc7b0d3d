"""Colours: their bytes, and how far apart they look."""

import numpy as np

from replicate.drawing.prop_surfaces import colour_in_bytes, perceived


def test_colours_are_given_as_bytes_or_as_shares():
    assert colour_in_bytes((1.0, 0.5, 0)) == (255, 128, 0)
    assert colour_in_bytes((200, 0, 7)) == (200, 0, 7)


def test_perceived_colours_are_those_of_the_cie():
    white, black, red, blue = perceived([(255, 255, 255), (0, 0, 0), (255, 0, 0), (0, 0, 255)])
    np.testing.assert_allclose(white, (100, 0, 0), atol=0.1)
    np.testing.assert_allclose(black, (0, 0, 0), atol=0.1)
    np.testing.assert_allclose(red, (53.2, 80.1, 67.2), atol=0.5)
    np.testing.assert_allclose(blue, (32.3, 79.2, -107.9), atol=0.5)
