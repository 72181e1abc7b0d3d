"""Linear blend skinning that sees rig parameters: a small network p → bone transformations over a fitted skin.

The paper's LBS rows are oracles: their bones are refitted to each test mesh. Here a multilayer perceptron predicts the
bones from the rig parameters, as the other methods predict offsets. Skin and weights stay as SSDR has fitted them; the
network is trained through the skinning on Eq. 1, over all vertices. Not in the paper.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import nn
from torch.nn import functional

from replicate.approximation.conditioning import initialise, parameter_scale
from replicate.approximation.losses import Supervision
from replicate.approximation.model import SegmentedModel, load_model, save_model
from replicate.approximation.samples import SampleSet
from replicate.approximation.segments import Segment
from replicate.approximation.training import prepare, train
from replicate.baselines.skinning.bones import weighted_points
from replicate.baselines.skinning.ssdr import Skin, refit
from replicate.config import ConditioningConfig, DrivenConfig
from replicate.geometry.mesh import Mesh

SKIN = "skin.npz"
REFIT_POSES = 64  # training poses whose refitted bones show how far each bone goes
LEAST_TURN, LEAST_SHIFT_MM = 1e-3, 1e-2  # of a bone's usual turn (radians) and shift


class BoneNetwork(nn.Module):
    """(b, m) scaled parameters → (b, n, 3) offsets in mm: a turn and a shift of each bone, then skinning.

    turn, shift: (bones,), what the outputs are multiplied by: each bone's usual rotation about its centre in radians,
    and its usual translation in mm.
    """

    spread: torch.Tensor
    centres: torch.Tensor
    turn: torch.Tensor
    shift: torch.Tensor

    def __init__(self, inputs: int, skin: Skin, hidden: Sequence[int], slope: float):
        super().__init__()
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise((inputs, *hidden)))
        self.output = nn.Linear(hidden[-1], 6 * skin.bones)
        self.slope, self.bones = slope, skin.bones
        dense = skin.dense_weights()
        rest = np.concatenate([skin.neutral.astype(np.float64), np.ones((len(dense), 1))], 1)
        self.register_buffer("spread", torch.from_numpy(weighted_points(rest, dense)).float(), persistent=False)
        self.register_buffer("centres", torch.from_numpy(bone_centres(skin)).float(), persistent=False)
        self.register_buffer("turn", torch.ones(skin.bones))
        self.register_buffer("shift", torch.ones(skin.bones))

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b n 3"]:
        x = params
        for layer in self.hidden:
            x = functional.leaky_relu(layer(x), self.slope)
        turn, shift = self.output(x).unflatten(1, (2, self.bones, 3)).unbind(1)
        rotation = rotation_less_identity(turn * self.turn[:, None])
        translation = shift * self.shift[:, None] - (self.centres[:, None] @ rotation).squeeze(2)
        motion = torch.cat([rotation, translation[:, :, None]], 2)  # (b, bones, 4, 3), for row vectors (v, 1)
        return self.spread @ motion.flatten(1, 2)


def rotation_less_identity(turn: Float[torch.Tensor, "*k 3"]) -> Float[torch.Tensor, "*k 3 3"]:
    """Return R − I of rotation vectors in radians, for row vectors: v R turns v by |turn| about turn (Rodrigues)."""
    squared = (turn * turn).sum(-1)[..., None, None]
    small = squared < 1e-6
    angle = torch.where(small, torch.ones_like(squared), squared).sqrt()
    sine = torch.where(small, 1 - squared / 6, angle.sin() / angle)
    cosine = torch.where(small, 0.5 - squared / 24, (1 - angle.cos()) / angle**2)
    x, y, z = turn.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [torch.stack(row, -1) for row in ((zero, z, -y), (-z, zero, x), (y, -x, zero))]
    across = torch.stack(rows, -2)
    return sine * across + cosine * (across @ across)


def bone_centres(skin: Skin) -> Float[np.ndarray, "bones 3"]:
    """Return the mean rest position of each bone's vertices in mm, by weight."""
    dense = skin.dense_weights()
    total = np.maximum(dense.sum(0), 1e-9)
    return (dense.T @ skin.neutral.astype(np.float64)) / total[:, None]


def usual_motion(
    skin: Skin, vertices: Float[np.ndarray, "b n 3"]
) -> tuple[Float[np.ndarray, " bones"], Float[np.ndarray, " bones"]]:
    """Return the RMS rotation in radians and translation of the centre in mm of each bone, refitted to some poses."""
    rotation, translation = refit(skin, vertices)
    cosine = np.clip((np.trace(rotation, axis1=-2, axis2=-1) - 1) / 2, -1, 1)
    centres = bone_centres(skin)
    shift = np.einsum("kc,bkcd->bkd", centres, rotation) + translation - centres
    turn = np.sqrt((np.arccos(cosine) ** 2).mean(0))
    return np.maximum(turn, LEAST_TURN), np.maximum(np.sqrt((shift**2).sum(-1).mean(0)), LEAST_SHIFT_MM)


def train_driven(
    mesh: Mesh,
    skin: Skin,
    samples: SampleSet,
    config: DrivenConfig,
    scratch: Path,
    progress: Callable,
    seed: int,
    device: str = "cpu",
) -> tuple[SegmentedModel, list[dict]]:
    """Train the network of a skin; return the model and its log.

    mesh: the neutral face.
    skin: whose bones the network moves.
    samples: what it is trained on.
    config: its settings.
    scratch, progress, seed, device: as for `training.train_segments`.
    """
    # the supervision of a single segment, which has all vertices
    device = prepare(device)
    n, m = len(mesh.neutral), samples.params.shape[1]
    segment = Segment("skin", np.arange(n, dtype=np.int32), np.zeros((n, 2), np.float32), np.arange(m, dtype=np.int32))
    supervision = Supervision(mesh, samples, segment.vertices, config.normal_weight, device)
    network = BoneNetwork(m, skin, config.hidden, config.leaky_slope)
    initialise(ConditioningConfig(), [network], config.leaky_slope, torch.Generator().manual_seed(seed))
    _, offsets = supervision.statistics()
    # bones move as far as they do in refitted training poses
    turn, shift = usual_motion(skin, mesh.neutral + offsets[:REFIT_POSES])
    network.turn.copy_(torch.from_numpy(turn))
    network.shift.copy_(torch.from_numpy(shift))
    model = SegmentedModel([network], [segment], parameter_scale(samples.params), [1.0], n).to(device)

    def loss_of_step(step: int) -> torch.Tensor:
        params, target = supervision.batch(seed, "driven", step, config.training)
        return supervision.loss(model(params), target)

    validation = supervision.validation()
    log = train(model, loss_of_step, config.training, scratch, progress, "driven", lambda: validation(model.offsets))
    return model, log


def save(model: SegmentedModel, skin: Skin, folder: Path, config: DrivenConfig) -> None:
    """Write a driven model and its skin to a folder."""
    skin.save(Path(folder) / SKIN)
    save_model(model, folder, {"hidden": list(config.hidden), "leaky_slope": config.leaky_slope})


def load_driven(folder: Path) -> SegmentedModel:
    """Read a driven model; its `.offsets(params)` predicts. Raises InputError when there is none."""

    def network(segment: Segment, facts: dict) -> BoneNetwork:
        skin = Skin.load(Path(folder) / SKIN)
        return BoneNetwork(len(segment.parameters), skin, facts["hidden"], facts["leaky_slope"])

    return load_model(folder, network)
