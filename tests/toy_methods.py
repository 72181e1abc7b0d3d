"""Methods for tests of the measurement: one that sees parameters alone, and an oracle."""

import numpy as np
from small_face import small_mesh

from replicate.methods.measurement import MeasurementSettings


def blind(inputs, settings):
    """Return parameters → the neutral mesh moved along x by the first parameter times a number."""
    return lambda params: small_mesh().neutral + settings * params[:, :1, None] * np.float32([1, 0, 0])


def seeing(inputs, settings):
    """Return (parameters, truth) → the truth, moved along x by a number."""
    return lambda params, truth: truth + np.float32([settings, 0, 0])


ANSWERS = {  # what a method could return by mistake, for vertices (b, n, 3)
    "None": lambda vertices: None,
    "a list of two shapes": lambda vertices: [vertices[0], vertices[0, :1]],
    "a pose too few": lambda vertices: vertices[:1],
    "the first pose alone": lambda vertices: vertices[0],
    "a vertex too few": lambda vertices: vertices[:, 1:],
    "a column": lambda vertices: vertices[..., :1],
    "complex numbers": lambda vertices: vertices.astype(complex),
    "texts": lambda vertices: vertices.astype(str),
    "true and false": lambda vertices: vertices > 0,
    "objects": lambda vertices: vertices.astype(object),
    "NaN": lambda vertices: np.where(np.arange(vertices.size).reshape(vertices.shape) == 7, np.nan, vertices),
    "infinity": lambda vertices: vertices - np.float32(np.inf),
    "beyond float32": lambda vertices: vertices.astype(float) + 1e300,
    "a list": lambda vertices: vertices.tolist(),
    "whole numbers": lambda vertices: np.rint(vertices).astype(int),
}
GOOD = ("a list", "whole numbers")


def mistaken(inputs, settings):
    """Return parameters → the neutral mesh as one of `ANSWERS` changes it."""
    neutral = small_mesh().neutral
    return lambda params: ANSWERS[settings](np.broadcast_to(neutral, (len(params), *neutral.shape)))


def facts(inputs, mesh):
    """Return one more number."""
    return [("vertices", "count", len(mesh.neutral))]


def multiplications(inputs, settings):
    """Return one product for each coordinate of the mesh."""
    return 3 * len(small_mesh().neutral)


BLIND = MeasurementSettings("toy", f"{__name__}:blind", "", 2.0, False, False, 0, 8, 0)  # on all test poses
