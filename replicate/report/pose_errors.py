"""How far a method is off in one recorded pose: over the whole mesh, and region by region of the face."""

import numpy as np

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.report.pose_record import TRUTH, PoseRecord

WHOLE = "whole mesh"  # what the mean over the whole mesh is called beside those of regions


def normal_means_deg(record: PoseRecord, method: str) -> dict[str, float]:
    """Return the mean normal error (Eq. 11) of a method in degrees, over the whole mesh and over each region.

    A region whose mesh faces have no normal gives NaN.
    """
    errors = normal_error(record.vertices[method], record.vertices[TRUTH], record.faces)
    means = {WHOLE: float(np.nanmean(errors))}
    for k, name in enumerate(record.region_names):
        own = errors[record.region == k]
        means[name] = float(np.nanmean(own)) if np.isfinite(own).any() else float("nan")
    return means


def vertex_mean_mm(record: PoseRecord, method: str) -> float:
    """Return the mean distance of a method's vertices from the true ones, in mm."""
    return float(vertex_error(record.vertices[method], record.vertices[TRUTH]).mean())
