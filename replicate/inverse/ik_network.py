"""The networks that give rig parameters for control points, and their training (§4.3)."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32
from safetensors.torch import load_file, save_file
from torch import nn
from torch.nn import functional

from data_recipes.rig import Rig
from replicate.approximation.conditioning import initialise
from replicate.approximation.samples import SampleSet
from replicate.approximation.training import prepare, train
from replicate.base.exceptions import InputError
from replicate.config import ConditioningConfig
from replicate.inverse.control_points import ControlPoints, InverseConfig, Region

WEIGHTS, DESCRIPTION = "weights.safetensors", "model.json"
ARRAYS = ("points", "parameters")  # of a region


class RegionNetwork(nn.Module):
    """(b, i) → (b, r): hidden layers with leaky ReLU and a linear output, so that it can give any value."""

    def __init__(self, inputs: int, outputs: int, hidden: Sequence[int], slope: float):
        super().__init__()
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise((inputs, *hidden)))
        self.output = nn.Linear(hidden[-1], outputs)
        self.slope = slope

    def forward(self, points: Float[torch.Tensor, "b i"]) -> Float[torch.Tensor, "b r"]:
        x = points
        for layer in self.hidden:
            x = functional.leaky_relu(layer(x), self.slope)
        return self.output(x)


class IkModel(nn.Module):
    """f_IK: control points → rig parameters, one network a region (Eq. 7, Fig. 6).

    A parameter that several regions drive is the mean of what they say; one that none drives keeps its default.

    regions: the control points and parameters of each network
    hidden: widths of the hidden layers
    slope: of their leaky ReLU
    neutral: control points of the neutral pose, (c, 3), mm
    spread: what their moves are divided by, (c, a), mm; a is 2 for points in the image plane (§5.3.1), 3 in space
    default: parameters of the neutral pose, (m,)
    reach: what the networks' outputs are multiplied by, (m,)
    """

    def __init__(
        self,
        regions: Sequence[Region],
        hidden: Sequence[int],
        slope: float,
        neutral: Float[np.ndarray, "c 3"],
        spread: Float[np.ndarray, "c a"],
        default: Float[np.ndarray, " m"],
        reach: Float[np.ndarray, " m"],
    ):
        super().__init__()
        self.regions, self.axes, self.slope, self.widths = tuple(regions), spread.shape[1], slope, tuple(hidden)
        self.networks = nn.ModuleList(
            RegionNetwork(len(region.points) * self.axes, len(region.parameters), hidden, slope) for region in regions
        )
        counts = np.zeros(len(default))
        for region in regions:
            counts[region.parameters] += 1
        for name, value in (("neutral", neutral), ("spread", spread), ("default", default), ("reach", reach)):
            self.register_buffer(name, torch.tensor(np.asarray(value), dtype=torch.float32))
        share = torch.tensor(1 / np.maximum(counts, 1), dtype=torch.float32)
        self.register_buffer("share", share, persistent=False)
        for j, region in enumerate(self.regions):
            self.register_buffer(f"points_{j}", torch.from_numpy(region.points).long(), persistent=False)
            self.register_buffer(f"parameters_{j}", torch.from_numpy(region.parameters).long(), persistent=False)

    def forward(self, points: Float[torch.Tensor, "b c 3"]) -> Float[torch.Tensor, "b m"]:
        """Return raw rig parameters for control points in mm; z is ignored for points in the image plane."""
        moves = (points - self.neutral)[..., : self.axes] / self.spread
        total = torch.zeros(len(points), len(self.default), dtype=moves.dtype, device=moves.device)
        for j, network in enumerate(self.networks):
            driven = network(moves[:, getattr(self, f"points_{j}")].flatten(1))
            total = total.index_add(1, getattr(self, f"parameters_{j}"), driven)
        return self.default + total * self.share * self.reach

    def solve(self, points: Float[np.ndarray, "b c 3"]) -> Float32[np.ndarray, "b m"]:
        """Return raw rig parameters (b, m) for control points (b, c, 3) in mm."""
        with torch.no_grad():
            return self(torch.from_numpy(np.array(points, np.float32))).numpy()


def save_ik(model: IkModel, folder: Path) -> None:
    """Write weights.safetensors and model.json."""
    arrays = {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}
    for j, region in enumerate(model.regions):
        arrays |= {f"region.{j}.{field}": torch.from_numpy(getattr(region, field)) for field in ARRAYS}
    save_file(arrays, Path(folder) / WEIGHTS)
    facts = {"regions": [region.name for region in model.regions], "hidden": model.widths, "leaky_slope": model.slope}
    (Path(folder) / DESCRIPTION).write_text(json.dumps(facts, indent=1) + "\n")


def load_ik(folder: Path) -> IkModel:
    """Read what `save_ik` wrote. Raises InputError, naming the folder, where there is no such model."""
    try:
        facts = json.loads((Path(folder) / DESCRIPTION).read_text())
        arrays = load_file(Path(folder) / WEIGHTS)
        regions = [
            Region(name, *(arrays.pop(f"region.{j}.{field}").numpy() for field in ARRAYS))
            for j, name in enumerate(facts["regions"])
        ]
        buffers = [arrays[name].numpy() for name in ("neutral", "spread", "default", "reach")]
        model = IkModel(regions, facts["hidden"], facts["leaky_slope"], *buffers)
        model.load_state_dict(arrays)
    except Exception as error:  # safetensors raises its own class for a damaged file, Python others for a missing one
        raise InputError(f"{folder}: found no readable IK model there ({error}).") from error
    return model.eval()


# Training the IK networks through a frozen approximation, or through the rig itself (§4.1, §4.2).

LOG_COLUMNS = ("step", "loss", "mm", "amplitude")  # amplitude: L_reg of Eq. 10
STREAM = "inverse"
SMALLEST_MM = 0.1  # the least that a control point's moves are divided by


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
    """Return p_max − p_min of each parameter in the animation data (Eq. 10).

    It is taken from the control's limits for a parameter at rest in all clips, and for a rig without clips.
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
    """Train the IK networks (§4.2) and return them with the log of LOG_COLUMNS.

    All random draws are the same for every approximation, so that only the gradient differs.

    approximation: r̃_C, raw rig parameters (b, m) → positions (b, c, 3) of the control points in mm, differentiable
    rig: for its neutral pose and its parameters' ranges
    points: the rig's control points
    truth: where they are in the samples
    samples: draws the poses of each step
    section: settings of the networks and of their training
    seed: of the weights, the poses and the noise
    scratch: folder for checkpoints
    progress: as `StageContext.progress`
    label: the progress bar's
    """
    # the networks, with inputs and outputs scaled by the data
    device = prepare("cpu")
    neutral = rig.mesh.neutral[points.vertices].astype(np.float32)
    axes = section.coordinates
    spread = np.maximum(np.sqrt(np.square(truth.training - neutral).mean(axis=0))[:, :axes], SMALLEST_MM)
    ranges = parameter_ranges(rig)
    model = IkModel(points.regions, section.hidden, section.leaky_slope, neutral, spread, rig.default, ranges)
    initialise(ConditioningConfig(), list(model.networks), section.leaky_slope, torch.Generator().manual_seed(seed))
    model = model.to(device)
    # the loss of Eq. 8 on noisy targets, and what the log measures on held-out poses
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
