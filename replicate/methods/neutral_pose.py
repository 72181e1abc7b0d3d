"""The neutral pose as prediction for all parameters: its errors say how much the test poses move."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from replicate.methods import artefacts
from replicate.methods.method import Method


def load(inputs: Mapping[str, Path], settings: None) -> Callable:
    """Return parameters (b, m) → the neutral vertices (b, n, 3)."""
    neutral = artefacts.load_mesh(inputs).neutral
    return lambda params: np.broadcast_to(neutral, (len(params), *neutral.shape))


def multiplications(inputs: Mapping[str, Path], settings: None) -> int:
    """Return 0: nothing is computed."""
    return 0


METHOD = Method(
    "neutral",
    "Neutral pose",
    lambda plan: (),
    load,
    place=100,
    rigid_step=False,
    note="The neutral pose as prediction: how much the test poses move.",
    mark="§",
    colour="#CC79A7",
    in_figures=False,
    in_charts=False,
    multiplications=multiplications,
)
