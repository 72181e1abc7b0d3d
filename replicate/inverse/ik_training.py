"""Training the IK networks through a frozen approximation, or through the rig itself (§4.1, §4.2).

The rig is not asked: its samples give the control points, and the approximation gives the gradient.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32

from data_recipes.rig import Rig
from replicate.approximation.conditioning import initialise
from replicate.approximation.samples import SampleSet
from replicate.approximation.training import prepare, train
from replicate.config import ConditioningConfig
from replicate.inverse.control_points import ControlPoints
from replicate.inverse.ik_config import InverseConfig
from replicate.inverse.ik_network import IkModel

LOG_COLUMNS = ("step", "loss", "mm", "amplitude")  # amplitude: L_reg of Eq. 10
STREAM = "inverse"
SMALLEST_MM = 0.1  # of what a control point's moves are divided by


@dataclass(frozen=True)
class Truth:
    """Positions of the control points in samples, (b, c, 3) mm: of training and of validation poses."""

    training: Float32[np.ndarray, "a c 3"]
    validation: Float32[np.ndarray, "b c 3"]


def read_truth(samples: SampleSet, neutral: Float[np.ndarray, "n 3"], points: ControlPoints) -> Truth:
    """Return where the control points are in the samples."""
    rest = neutral[points.vertices].astype(np.float32)
    training = samples.vertices_subset(np.arange(len(samples)), points.vertices)
    held_out = np.asarray(samples.validation_offsets[:, points.vertices], np.float32)
    return Truth(rest + training, rest + held_out)


def parameter_ranges(rig: Rig) -> Float32[np.ndarray, " m"]:
    """Return p_max − p_min of each parameter in the animation data (Eq. 10); of one that rests there, its limits'.

    A rig without animation has the limits of its controls.
    """
    limits = rig.upper - rig.lower
    if not rig.clips:
        return limits
    values = np.concatenate([clip.values for clip in rig.clips])
    ranges = np.ptp(values, axis=0).astype(np.float32)
    return np.where(ranges > 1e-3 * limits, ranges, limits)


def point_loss(
    reached: Float[torch.Tensor, "b c 3"], targets: Float[torch.Tensor, "b c 3"], axes: int
) -> Float[torch.Tensor, ""]:
    """Return L_point of Eq. 9, mm: the mean over points of the L1 norm of their difference, over poses too."""
    return (reached - targets)[..., :axes].abs().sum(dim=-1).mean()


def amplitude(
    params: Float[torch.Tensor, "b m"], default: Float[torch.Tensor, " m"], ranges: Float[torch.Tensor, " m"]
) -> Float[torch.Tensor, ""]:
    """Return L_reg of Eq. 10: the summed sizes of the parameters in shares of their ranges, the mean over poses."""
    return ((params - default) / ranges).abs().sum(dim=1).mean()


def train_ik(
    approximation: Callable[[torch.Tensor], torch.Tensor],
    rig: Rig,
    points: ControlPoints,
    truth: Truth,
    samples: SampleSet,
    section: InverseConfig,
    seed: int,
    scratch: Path,
    progress: Callable,
    label: str,
) -> tuple[IkModel, list[dict]]:
    """Train the IK networks and return them with the log of LOG_COLUMNS.

    approximation: r̃_C, raw rig parameters (b, m) → positions (b, c, 3) of the control points in mm, differentiable.
    All else is drawn alike for every approximation: what differs is the gradient alone.
    """
    device = prepare("cpu")
    neutral = rig.mesh.neutral[points.vertices].astype(np.float32)
    axes = section.coordinates
    spread = np.maximum(np.sqrt(np.square(truth.training - neutral).mean(axis=0))[:, :axes], SMALLEST_MM)
    ranges = parameter_ranges(rig)
    model = IkModel(points.regions, section.hidden, section.leaky_slope, neutral, spread, rig.default, ranges)
    initialise(ConditioningConfig(), list(model.networks), section.leaky_slope, torch.Generator().manual_seed(seed))
    model = model.to(device)
    scales = torch.from_numpy(ranges)
    held_out = torch.from_numpy(truth.validation)

    def loss_of_step(step: int) -> torch.Tensor:
        training = section.training
        rows = samples.draw_for_step(seed, STREAM, step, training.batch, training.draws)
        targets = truth.training[rows]
        noise = np.random.default_rng([seed, step]).uniform(-section.noise_mm, section.noise_mm, targets.shape)
        targets = torch.from_numpy(targets + noise.astype(np.float32))
        params = model(targets)
        fit = point_loss(approximation(params), targets, axes)
        return fit + section.regularisation * amplitude(params, model.default, scales)

    def measure() -> tuple[float, float]:
        with torch.no_grad():
            params = model(held_out)
            apart = (approximation(params) - held_out)[..., :axes].norm(dim=-1).mean()
            return float(apart), float(amplitude(params, model.default, scales))

    log = train(model, loss_of_step, section.training, scratch, progress, label, measure, LOG_COLUMNS)
    return model.eval(), log
