"""Training one network a segment from nothing: what the coarse CNN and the dense baseline share (§3.5, §5.1)."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32
from torch import nn

from replicate.approximation.model import SegmentedModel, fresh_model
from replicate.approximation.samples import SampleSet
from replicate.approximation.segments import Segment, segment_vertices
from replicate.approximation.supervision import Supervision
from replicate.approximation.training import prepare, train
from replicate.config import CoarseConfig, DenseConfig
from replicate.geometry.mesh import Mesh


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
    """Train the networks of some segments together on Eq. 1; return the model and its log.

    networks: one a segment; their weights are drawn anew. scratch: a folder of this training's own, continued from if
    it holds a checkpoint. progress: as for `training.train`. stream: names the training, in its progress and as its
    stream of random batches. scale: what rig parameters are divided by. base: a model of the same segments that stays
    as it is, and that the networks learn to add to; none by default. The log's mm and degrees are those of the
    validation poses, over all segments.
    """
    device = prepare(device)
    supervision = Supervision(mesh, samples, segment_vertices(segments), config.normal_weight, device)
    params, targets = supervision.statistics()
    if base is not None:
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
