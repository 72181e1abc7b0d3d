"""The colours of methods in charts: every standard one looks unlike the others, to colour-blind readers too."""

import itertools

import numpy as np
import pytest

from replicate.drawing.prop_surfaces import perceived
from replicate.methods.method_registry import methods

# Red, green and blue as eyes without one of the three kinds of cones see them (Machado et al. 2009).
EYES = {
    "usual": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}


def as_seen(colour: str, eye: np.ndarray) -> np.ndarray:
    """Return a colour, "#E69F00", as an eye sees it, in L*a*b*."""
    part = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    light = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    light = np.clip(eye @ light, 0, 1)
    part = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return perceived([tuple(255 * part)])[0]


@pytest.mark.parametrize("eye", EYES)
def test_standard_methods_look_unlike_each_other(eye):
    shown = [method for method in methods().values() if method.standard and method.in_figures]
    seen = {method.name: as_seen(method.colour, EYES[eye]) for method in shown}
    assert {"coarse", "refined", "dense", "lbs32", "regional", "linear"} <= set(seen)
    for one, other in itertools.combinations(seen, 2):
        assert np.linalg.norm(seen[one] - seen[other]) > 15, (one, other)


def test_a_floor_has_the_colour_of_its_networks():
    known = methods()
    floors = [method for method in known.values() if method.floor_of]
    assert floors and all(floor.colour == known[floor.floor_of].colour for floor in floors)
