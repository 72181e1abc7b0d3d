"""Rows of folds as skin has them: uneven in spacing, depth and length, with branches and ends.

A row of folds is a phase φ, one unit a fold, and an amplitude, as wrinkles on thin shells are described by Chen et al.
2021 ("Fine Wrinkling on Coarsely Meshed Thin Shells"). Three things make a regular row uneven. A smooth change of the
phase widens some folds and narrows others, and makes them waver. Around a few points the phase turns by one unit: there
a fold branches or ends, and the amplitude is 0 (the singularities of Chen et al. 2023, "Complex Wrinkle Fields"). A
smooth change of the amplitude makes some folds deep and lets others run out. Skin is stretched at rest and its deepest
folds appear first, so a fold's threshold is the resting stretch and more, the more the shallower it is.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_recipes.recipe.sections import Wrinkles

SPACING = 0.22  # standard deviation of the folds' density, at unevenness 1
DEPTH = 0.4  # of their amplitude
SHALLOWEST, DEEPEST = 0.15, 1.35  # amplitudes
ALONG_MM = 36.0  # how far along a fold its place and depth stay similar
ACROSS_FOLDS = 1.1  # the same across folds, in units of φ
FOLDS_PER_BRANCH = 3.0
CORE = 0.45  # around a branch's point, in folds, the amplitude falls to 0
LATER = 0.06  # compression by which the shallowest folds appear after the deepest
WAVES = 24  # of which a smooth random field consists


@dataclass(frozen=True)
class FoldRow:
    """Folds at s vertices: phase φ, amplitude (1 is usual), wave length in mm, and the compression that raises them."""

    phase: Float[np.ndarray, " s"]
    amplitude: Float[np.ndarray, " s"]
    wavelength_mm: Float[np.ndarray, " s"]
    threshold: Float[np.ndarray, " s"]

    def pattern(self, window: Float[np.ndarray, " s"]) -> Float[np.ndarray, " s"]:
        """Return the row's dimensionless height inside a window."""
        return window * self.amplitude * ridges(self.phase)


def ridges(phase: Float[np.ndarray, "*s"]) -> Float[np.ndarray, "*s"]:
    """Return round ridges at whole phases and sharp valleys half-way between them."""
    return (np.abs(np.cos(np.pi * phase)) ** 0.8 - 0.66) / 0.5


def stream(seed: int, name: str) -> np.random.Generator:
    """Return a region's random numbers: those of one region move no other's."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def random_field(
    generator: np.random.Generator, places: Float[np.ndarray, "s d"]
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, "s d"]]:
    """Return a smooth random field of variance 1 and its gradient; places in units of its correlation length."""
    wave = generator.normal(size=(WAVES, places.shape[1]))
    angle = places @ wave.T + generator.uniform(0, 2 * np.pi, WAVES)
    scale = np.sqrt(2 / WAVES)
    return scale * np.cos(angle).sum(axis=1), -scale * np.sin(angle) @ wave


def uneven(
    phase: Float[np.ndarray, " s"],
    along_mm: Float[np.ndarray, " s"],
    wavelength_mm: float,
    wrinkles: Wrinkles,
    generator: np.random.Generator,
) -> FoldRow:
    """Return a row of folds made uneven. along_mm: each vertex's place along its fold."""
    share = wrinkles.unevenness
    places = np.stack([phase / ACROSS_FOLDS, along_mm / ALONG_MM], axis=1)
    change, slope = random_field(generator, places)
    density = np.clip(1 + share * SPACING * slope[:, 0], 0.6, 1.6)
    moved = phase + share * SPACING * ACROSS_FOLDS * change
    depth, _ = random_field(generator, places)
    depth -= depth.mean() if len(depth) else 0.0  # a small region must not be flat as a whole
    amplitude = np.clip(1 + share * DEPTH * depth, SHALLOWEST, DEEPEST)
    if share > 0 and len(phase):
        low, high = np.quantile(phase, (0.15, 0.85))
        first, last = np.quantile(along_mm, (0.15, 0.85))
        for number in range(int((high - low) / FOLDS_PER_BRANCH + 0.3)):
            across = phase - generator.uniform(low, high)
            along = (along_mm - generator.uniform(first, last)) / wavelength_mm
            moved = moved + (-1) ** number * np.arctan2(along, across) / (2 * np.pi)
            distance = across**2 + along**2
            amplitude = amplitude * distance / (distance + CORE**2)
    later = LATER * share * np.clip((DEEPEST - amplitude) / (DEEPEST - SHALLOWEST), 0, 1)
    return FoldRow(moved, amplitude, wavelength_mm / density, wrinkles.tension + later)
