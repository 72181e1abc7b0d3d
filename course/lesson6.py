"""What lesson 6 is set up with: poses of the tiny head, small networks, and a training loop."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from torch import nn

from data_recipes.rig import Rig
from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.samples import evaluate
from replicate.approximation.sampling import augment, split_clips
from replicate.baselines.dense import DenseNetwork
from replicate.methods.artefacts import rig_of
from replicate.methods.linear import ridge, with_constant

POSES, TEST_POSES = 2_500, 200
HIDDEN, SLOPE = (64, 64), 0.2
STEPS, BATCH, RATE, EVERY = 400, 8, 5e-3, 80


@dataclass(frozen=True)
class Face:
    """A rig and poses of it: Eq. 5 on some clips for training, frames of other clips for the test.

    neutral: (n, 3) mm. faces: (f, 3). scale: (m,), what raw parameters were divided by.
    params, test_params: (b, m), scaled, float32. offsets, test_offsets: (b, n, 3) mm, float32.
    """

    rig: Rig
    neutral: np.ndarray
    faces: np.ndarray
    scale: np.ndarray
    params: np.ndarray
    offsets: np.ndarray
    test_params: np.ndarray
    test_offsets: np.ndarray


@cache
def tiny_face() -> Face:
    """Return the tiny head with poses; no test clip has a frame among the training poses."""
    rig, rng = rig_of("tiny"), np.random.default_rng(6)
    animation, test = split_clips([clip.values for clip in rig.clips], rng)
    training, test = augment(animation, POSES, rng), rng.permutation(test)[:TEST_POSES]
    scale, neutral = parameter_scale(training), rig.mesh.neutral
    parts = []
    for poses in (training, test):
        vertices = np.concatenate([posed for _, posed in evaluate(rig, poses)])
        parts += [(poses / scale).astype(np.float32), vertices - neutral]
    return Face(rig, neutral, rig.mesh.faces, scale, *parts)


STRENGTH = 1e-6  # λ of ridge regression


def ridge_line(face: Face, params: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (m + 1, 3n) of ridge regression on the training poses, the constant last, and its offsets.

    params: (b, m), the poses whose offsets (b, n, 3), mm, are returned.
    """
    targets = face.offsets.reshape(len(face.offsets), -1).astype(np.float64)
    (weights,) = ridge(with_constant(face.params), [targets], (STRENGTH,))
    offsets = with_constant(params) @ weights
    return weights.astype(np.float32), offsets.astype(np.float32).reshape(len(params), -1, 3)


def rms(lengths: np.ndarray) -> float:
    """Return the root of the mean square of some numbers."""
    return float(np.sqrt(np.mean(np.square(lengths, dtype=np.float64))))


def small_network(face: Face, seed: int = 0) -> DenseNetwork:
    """Return a fresh dense network, (b, m) → (b, n, 3), whose outputs are small beside 1."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = DenseNetwork(face.params.shape[1], len(face.neutral), HIDDEN, SLOPE)
    with torch.no_grad():
        network.output.weight.mul_(0.1)
        network.output.bias.zero_()
    return network


class Alone(nn.Module):
    """A network by itself: scaled parameters → unit_mm times what it gives, offsets in mm."""

    def __init__(self, network: nn.Module, unit_mm: float):
        super().__init__()
        self.network, self.unit_mm = network, unit_mm

    def forward(self, params: torch.Tensor) -> torch.Tensor:
        """Return offsets (b, n, 3) in mm."""
        return self.unit_mm * self.network(params)


def errors(face: Face, offsets: np.ndarray) -> tuple[float, float]:
    """Return the mean distance in mm and the mean normal error in degrees of predicted test offsets."""
    posed, truth = face.neutral + offsets, face.neutral + face.test_offsets
    return float(vertex_error(posed, truth).mean()), float(np.nanmean(normal_error(posed, truth, face.faces)))


def wins(face: Face, first: np.ndarray, second: np.ndarray) -> str:
    """Say on how many test poses the line's offsets `first` are nearer than a network's, `second`; (b, n, 3) mm."""
    truth = face.neutral + face.test_offsets
    posed = [face.neutral + offsets for offsets in (first, second)]
    mm = [vertex_error(each, truth).mean(1) for each in posed]
    degrees = [np.nanmean(normal_error(each, truth, face.faces), axis=1) for each in posed]
    shares = (float((one < other).mean()) for one, other in (mm, degrees))
    return "over all test poses the line beats the network on {:.0%} in mm, on {:.0%} in degrees".format(*shares)


def predict(model: nn.Module, params: np.ndarray) -> np.ndarray:
    """Return a model's offsets (b, n, 3) in mm at some scaled parameters."""
    with torch.no_grad():
        return model(torch.from_numpy(params)).numpy()


def train(
    model: nn.Module,
    face: Face,
    loss: Callable[[torch.Tensor, torch.Tensor, torch.Tensor, float], torch.Tensor],
    steps: int = STEPS,
    seed: int = 0,
    alpha: float = 5.0,
    every: int = EVERY,
    rate: float = RATE,
) -> list[tuple[int, float, float]]:
    """Train a model in place by Adam; return (step, mm, degrees) on the test poses, at the start and every so often.

    model: scaled parameters (b, m) → offsets (b, n, 3) in mm.
    face: the poses.
    loss: (vertices, target, faces, α) → a number, as in Eq. 1.
    steps: how many; the learning rate falls to zero at the last one.
    seed: of the batches, which are the same for all models.
    alpha: α.
    every: how many steps lie between two measurements.
    rate: the highest learning rate.

    Gradients are clipped to a norm of 1 over all weights.
    """
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    arrays = (face.neutral, face.params, face.offsets, face.faces.astype(np.int64))
    neutral, params, offsets, faces = map(torch.from_numpy, arrays)
    weights = [weight for weight in model.parameters() if weight.requires_grad]
    optimiser = torch.optim.Adam(weights, lr=rate, fused=True)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=steps)
    batches = np.random.default_rng(seed).integers(len(params), size=(steps, BATCH))
    log = [(0, *errors(face, predict(model, face.test_params)))]
    for step, rows in enumerate(torch.from_numpy(batches), 1):
        optimiser.zero_grad()
        loss(neutral + model(params[rows]), neutral + offsets[rows], faces, alpha).backward()
        nn.utils.clip_grad_norm_(weights, 1.0)
        optimiser.step()
        schedule.step()
        if step % every == 0 or step == steps:
            log.append((step, *errors(face, predict(model, face.test_params))))
    return log


def leaky_product(width: int = 8, steps: int = 800, seeds: int = 4) -> Callable[[np.ndarray], np.ndarray]:
    """Return the best of some networks of leaky ReLUs, (b, 2) → (b,), that have learnt to multiply from 0 to 1."""
    torch.set_num_threads(1)
    trained = []
    for seed in range(seeds):
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            network = nn.Sequential(nn.Linear(2, width), nn.LeakyReLU(SLOPE), nn.Linear(width, 1))
            optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
            losses = []
            for _ in range(steps):
                pairs = torch.rand(64, 2)
                optimiser.zero_grad()
                loss = (network(pairs)[:, 0] - pairs.prod(1)).square().mean()
                loss.backward()
                optimiser.step()
                losses.append(loss.item())
        trained.append((np.mean(losses[-100:]), seed, network))
    best = min(trained)[-1]
    return lambda pairs: predict(best, np.asarray(pairs, np.float32))[:, 0]
