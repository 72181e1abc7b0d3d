"""How a network's inputs and outputs are scaled, and its first weights drawn (DEVIATIONS D8).

Ours: parameters are divided by their largest absolute value in the training poses, so that rest stays at zero; each
network's output is multiplied by one fixed length, the RMS of its segment's targets; weights are those of He et al.

The paper says nothing about this. Its released code scales nothing: controls are in the rig's units, degrees beside
lengths, and offsets in its unit of length (its noise of 0.01 units is the paper's 4.5 mm); weights are TensorFlow's
defaults, and small ones for convolutions. Ray's ranges are in its list of controls.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import nn

from data_recipes.rig import Rig
from replicate.approximation.segments import Segment
from replicate.config import ConditioningConfig

OUTPUT_SHARE = 0.1  # the size of a fresh network's output, in that of its targets
CONVOLUTION_SD = 0.02  # standard deviation of the released code's first weights of convolutions
# The value 1 of our controls in Ray's ranges, in degrees or the rig's lengths, by how their names begin.
RELEASED_RANGES = (
    ("jaw_open", 22.0),
    ("jaw_", 7.5),
    ("lip_roll", 30.0),
    ("wrinkle", 2.0),
    ("lip_upper", 0.05),
    ("lip_lower", 0.05),
    ("lip_corner", 0.05),
    ("handle_brow", 0.25),
    ("handle_cheek", 0.5),
    ("handle_nose", 0.02),
    ("handle", 0.05),
    ("look", 30.0),
    ("bend", 30.0),
    ("twist", 30.0),
)


def input_scale(
    config: ConditioningConfig, params: Float[np.ndarray, "N m"], rig: Callable[[], Rig]
) -> Float32[np.ndarray, " m"]:
    """Return what each rig parameter is divided by before a network sees it.

    params: the training poses.
    rig: returns the rig; called only if the names of its controls matter.
    """
    if config.inputs == "largest":
        return parameter_scale(params)
    if config.inputs == "raw":
        return np.ones(params.shape[1], np.float32)
    return np.array([1 / _released_range(control.name) for control in rig().controls], np.float32)


def _released_range(name: str) -> float:
    return next((size for start, size in RELEASED_RANGES if name.startswith(start)), 1.0)


def parameter_scale(params: Float[np.ndarray, "N m"]) -> Float32[np.ndarray, " m"]:
    """Return the largest absolute value of each rig parameter over the training poses; 1 for one that stays zero."""
    largest = np.abs(np.asarray(params, np.float32)).max(0)
    return np.where(largest > 0, largest, np.float32(1))


def output_lengths(
    config: ConditioningConfig, segments: Sequence[Segment], targets: Float[np.ndarray, "b n 3"]
) -> list[float]:
    """Return the unit, in mm, of the output of each segment's network.

    targets: the offsets that the networks should predict at some training poses.
    """
    if config.unit_mm:
        return [config.unit_mm] * len(segments)
    lengths = [float(np.sqrt(np.mean(np.square(targets[:, s.vertices], dtype=np.float64)))) for s in segments]
    return [length if length > 0 else 1.0 for length in lengths]


def initialise(
    config: ConditioningConfig, networks: Sequence[nn.Module], slope: float, generator: torch.Generator
) -> None:
    """Draw the first weights of networks; biases start at zero. slope: that of their leaky ReLUs."""
    draw = _he(slope) if config.weights == "he" else _released
    with torch.no_grad():
        for layer in nn.ModuleList(networks).modules():
            if isinstance(layer, nn.Linear | nn.Conv2d):
                draw(layer, generator)
                layer.bias.zero_()
        if config.weights == "he":  # then a fresh network has little noise to unlearn
            for network in networks:
                network.output.weight.mul_(OUTPUT_SHARE)


def _he(slope: float) -> Callable:
    """Return a function that draws weights which keep the variance through leaky ReLUs (He et al. 2015)."""
    gain = (2 / (1 + slope**2)) ** 0.5

    def draw(layer: nn.Module, generator: torch.Generator) -> None:
        layer.weight.normal_(0, gain / layer.weight[0].numel() ** 0.5, generator=generator)

    return draw


def _released(layer: nn.Module, generator: torch.Generator) -> None:
    """Draw weights: Glorot and Bengio (2010) for dense layers, a truncated normal distribution for convolutions."""
    if isinstance(layer, nn.Linear):
        nn.init.xavier_uniform_(layer.weight, generator=generator)
    else:
        limit = 2 * CONVOLUTION_SD
        nn.init.trunc_normal_(layer.weight, 0.0, CONVOLUTION_SD, -limit, limit, generator=generator)
