"""The training loop of all networks: Adam, a schedule, checkpoints (§3.5).

Nothing random happens here. A step's batch depends on seed, stream and step alone, so that a run that is stopped at any
moment and started again gives the same result, bit for bit, as one that never stopped.
"""

import json
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32
from safetensors.torch import load, save
from torch import nn

from replicate.approximation.losses import Supervision
from replicate.approximation.model import SegmentedModel, fresh_model
from replicate.approximation.samples import SampleSet
from replicate.approximation.segments import Segment, segment_vertices
from replicate.base.files import read_sealed, write_sealed
from replicate.base.tables import Column, write_csv
from replicate.config import CoarseConfig, DenseConfig, TrainingConfig
from replicate.geometry.mesh import Mesh

CHECKPOINT_S = 30.0
_FACTS = ":facts"  # the array of a checkpoint that holds step and log as JSON; no weight's name begins so
ROWS = 25  # of the log; each needs a measurement on held-out poses
LOG_COLUMNS = ("step", "loss", "mm", "degrees")


def learning_rate(config: TrainingConfig, step: int) -> float:
    """Return the learning rate of one step (0 ≤ step < config.steps).

    "paper": the rates one after another, each for its share of the steps. "one_cycle": a linear warm-up to the peak
    rate, then a cosine down to zero. "two_cycles": the same twice, each in half of the steps (a warm restart).
    """
    if config.schedule == "paper":
        ends = np.cumsum(config.shares) / sum(config.shares) * config.steps
        return config.rates[min(int(np.searchsorted(ends, step, side="right")), len(config.rates) - 1)]
    length = math.ceil(config.steps / 2) if config.schedule == "two_cycles" else config.steps
    step, warm_up = step % length, max(1, round(config.warm_up * length))
    if step < warm_up:
        return config.peak_rate * (step + 1) / warm_up
    return config.peak_rate * 0.5 * (1 + math.cos(math.pi * (step - warm_up) / max(1, length - warm_up)))


def prepare(device: str) -> torch.device:
    """Return the device; set torch to one thread, since stages run side by side, and to flush denormals to zero.

    Adam's second moments of weights at rest decay into denormals, which cost a hundred cycles each.
    """
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    return torch.device(device)


def train(
    model: nn.Module,
    loss_of_step: Callable[[int], torch.Tensor],
    config: TrainingConfig,
    scratch: Path,
    progress: Callable,
    label: str,
    measure: Callable[[], tuple[float, float]],
    columns: Sequence[str] = LOG_COLUMNS,
) -> list[dict]:
    """Minimise a loss over a model's weights, in place, and return the log: a dict of `columns` for each row.

    loss_of_step: step → the differentiable loss of its batch.
    config: the schedule.
    scratch: a folder for checkpoints, used by this training alone; a checkpoint in it is continued.
    progress: (total, label, initial) → a context manager with update(k).
    label: names the training in its progress.
    measure: () → (mm, degrees) on held-out poses, for the log.
    columns: those of the log, if something else is measured.
    """
    weights = dict(model.named_parameters())
    optimiser = torch.optim.Adam(weights.values(), lr=config.peak_rate, fused=True)
    checkpoint = Path(scratch) / "checkpoint.sealed"
    first, log, running = _resume(checkpoint, weights, optimiser)
    every = max(1, config.steps // ROWS)
    last_save = time.monotonic()
    with progress(config.steps, label, first) as bar:
        for step in range(first, config.steps):
            # one step
            optimiser.param_groups[0]["lr"] = learning_rate(config, step)
            optimiser.zero_grad(set_to_none=True)
            loss = loss_of_step(step)
            loss.backward()
            if config.largest_gradient:
                nn.utils.clip_grad_norm_(weights.values(), config.largest_gradient)
            optimiser.step()
            running.append(loss.item())
            # the log, and a checkpoint
            if (step + 1) % every == 0 or step + 1 == config.steps:
                row = (step + 1, math.fsum(running) / len(running), *measure())
                log.append(dict(zip(columns, row, strict=True)))
                running = []
            if time.monotonic() - last_save > CHECKPOINT_S or step + 1 == config.steps:
                _save(checkpoint, weights, optimiser, step + 1, log, running)
                last_save = time.monotonic()
            bar.update(1)
    return log


def _save(checkpoint: Path, weights: dict, optimiser, step: int, log: list, running: list) -> None:
    arrays = {}
    for name, weight in weights.items():
        state = optimiser.state[weight]
        arrays |= {name: weight.detach(), f"{name}:m": state["exp_avg"], f"{name}:v": state["exp_avg_sq"]}
    facts = json.dumps({"step": step, "log": log, "running": running}).encode()
    arrays[_FACTS] = torch.frombuffer(bytearray(facts), dtype=torch.uint8)
    data = save({name: array.cpu().contiguous() for name, array in arrays.items()})
    write_sealed(checkpoint, lambda stream: stream.write(data))


def _resume(checkpoint: Path, weights: dict, optimiser) -> tuple[int, list, list]:
    """Restore weights and moments from a checkpoint if there is a sound one; return (step, log, recent losses)."""
    arrays = read_sealed(checkpoint, lambda stream: load(stream.read()))
    if arrays is None:
        return 0, [], []
    facts = json.loads(arrays[_FACTS].numpy().tobytes())
    with torch.no_grad():
        for name, weight in weights.items():
            weight.copy_(arrays[name])
            optimiser.state[weight] = {
                "step": torch.tensor(float(facts["step"])).to(weight.device),
                "exp_avg": torch.empty_like(weight).copy_(arrays[f"{name}:m"]),
                "exp_avg_sq": torch.empty_like(weight).copy_(arrays[f"{name}:v"]),
            }
    return facts["step"], facts["log"], facts["running"]


def write_log(log: Sequence[dict], file: Path) -> None:
    """Write a training log as CSV: step, mean loss since the row before, and what was measured on held-out poses."""
    columns = [Column(name, "whole number" if name == "step" else "number") for name in log[0]]
    write_csv(file, columns, (list(row.values()) for row in log))


# Training a network for each segment, which the coarse CNN and the dense baseline share (§3.5, §5.1).


def train_segments(
    mesh: Mesh,
    segments: Sequence[Segment],
    networks: Sequence[nn.Module],
    samples: SampleSet,
    config: CoarseConfig | DenseConfig,
    scratch: Path,
    progress: Callable,
    stream: str,
    seed: int,
    scale: Float32[np.ndarray, " m"],
    device: str = "cpu",
    base: SegmentedModel | None = None,
) -> tuple[SegmentedModel, list[dict]]:
    """Train the networks of some segments together on Eq. 1; return the model and its log of validation errors.

    networks: one for each segment; their weights are drawn anew from `seed`.
    samples: the training and validation poses.
    config: the networks' section: loss, conditioning and schedule.
    scratch, progress: as for `train`.
    stream: names the training in its progress, and its stream of random batches.
    seed: decides weights and batches.
    scale: what rig parameters are divided by.
    device: "cpu" or "cuda".
    base: a fixed model of the same segments that the networks add to; none by default.
    """
    device = prepare(device)
    supervision = Supervision(mesh, samples, segment_vertices(segments), config.normal_weight, device)
    params, targets = supervision.statistics()
    if base is not None:  # the networks learn what it leaves
        targets = targets - base.offsets(params)
        base = base.to(device)
    model = fresh_model(networks, segments, scale, targets, config, seed).to(device)

    def loss_of_step(step: int) -> torch.Tensor:
        params, target = supervision.batch(seed, stream, step, config.training)
        if base is None:
            return supervision.loss(model(params), target)
        with torch.no_grad():
            start = base(params)
        return supervision.loss(start + model(params), target)

    validation = supervision.validation(base.offsets if base is not None else None)
    log = train(model, loss_of_step, config.training, scratch, progress, stream, lambda: validation(model.offsets))
    return model, log
