"""A test pose to draw: what two methods make of a plate with bumps, and what a figure holds of it."""

import numpy as np
from plane import flat_grid

from replicate.report.pose_record import PoseRecord


def bumpy_plate() -> PoseRecord:
    """A bumpy plate, 180 mm wide, that the "dense" method roughens and the "coarse" one flattens."""
    flat, faces = flat_grid(np.linspace(-90, 90, 25), np.linspace(-90, 90, 25), 40)
    truth = flat.copy()
    truth[:, 2] += 4 * np.sin(flat[:, 1] / 8)
    rough = truth + np.random.default_rng(0).normal(size=truth.shape).astype(np.float32)
    region = np.int8(flat[faces].mean(1)[:, 1] < 20)
    vertices = {"truth": truth, "coarse": flat, "dense": rough}
    return PoseRecord("teen", 7, flat, faces, vertices, region_names=("forehead", "mouth"), region=region)


def pictures_of(figure) -> list[np.ndarray]:
    return [axes.images[0].get_array() for axes in figure.axes if axes.images]


def texts_of(figure) -> list[str]:
    return [text.get_text() for text in figure.texts]
