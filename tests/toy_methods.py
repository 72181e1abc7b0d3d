"""Methods for tests of the measurement: one that sees parameters alone, and an oracle."""

import numpy as np
from small_face import small_mesh

from replicate.methods.measurement import MeasurementNumbers


def blind(inputs, numbers):
    """Return parameters → the neutral mesh moved along x by the first parameter times a number."""
    return lambda params: small_mesh().neutral + numbers * params[:, :1, None] * np.float32([1, 0, 0])


def seeing(inputs, numbers):
    """Return (parameters, truth) → the truth, moved along x by a number."""
    return lambda params, truth: truth + np.float32([numbers, 0, 0])


def facts(inputs, mesh):
    """Return one more number."""
    return [("vertices", "count", len(mesh.neutral))]


def multiplications(inputs, numbers):
    """Return one product for each coordinate of the mesh."""
    return 3 * len(small_mesh().neutral)


BLIND = MeasurementNumbers("toy", f"{__name__}:blind", "", 2.0, False, False, 0, 8, 0)  # on all test poses
