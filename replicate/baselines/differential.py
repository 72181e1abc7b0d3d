"""Differential subspace reconstruction (Song et al. 2020): a network predicts local shape, anchors hold it in place.

With L the mesh's umbrella Laplacian, each vertex's valence on the diagonal and −1 beside it, an offset differs from the
mean of its neighbours' by δ = L d / valence. One network predicts δ of all vertices in a PCA subspace; each of some
anchors has a small network for its own offset a. The face solves [L; I_A] d = [valence · δ; a] in the least-squares
sense, by one sparse Cholesky factor of LᵀL + I_AᵀI_A.

The solution is linear in δ and a. So a trained model keeps the offsets that each component of δ and each anchor gives
once they are solved for, which is an exact rewrite; it takes a third of the time of a back-substitution by SuperLU.
"""

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Float64, Int
from safetensors.torch import load, save
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu
from torch import nn

from replicate.approximation.model import SegmentedModel, load_model, save_model
from replicate.approximation.segments import Segment
from replicate.approximation.training import CHECKPOINT_S, LOG_COLUMNS, ROWS, learning_rate
from replicate.base.files import read_sealed, write_sealed
from replicate.config import TrainingConfig
from replicate.geometry.mesh import edges

_FACTS, _SPEED = ":facts", ":speed"  # of a checkpoint's arrays; no weight's name ends so

# Local shape, anchors, and the offsets that follow from both.


def umbrella(faces: Int[np.ndarray, "f 3"], count: int) -> csr_array:
    """Return L (count, count) of a mesh: each vertex's number of neighbours on the diagonal, −1 for each neighbour."""
    first, second = edges(faces).T
    places = np.concatenate([first, second]), np.concatenate([second, first])
    beside = csr_array((np.ones(2 * len(first)), places), shape=(count, count))
    return csr_array(diags_array(beside.sum(axis=1)) - beside)


def differences(laplacian: csr_array, offsets: Float[np.ndarray, "b k 3"]) -> Float32[np.ndarray, "b k 3"]:
    """Return δ: how far each offset is from the mean of its neighbours' offsets; 0 for a vertex without any."""
    mean = csr_array(diags_array(1 / np.maximum(laplacian.diagonal(), 1)) @ laplacian).astype(np.float32)
    return np.stack([mean @ pose for pose in np.asarray(offsets, np.float32)])


def choose_anchors(
    rest: Float[np.ndarray, "k 3"], laplacian: csr_array, motion: Float[np.ndarray, " k"], share: float
) -> Int[np.ndarray, " a"]:
    """Return a share of the vertices, ascending, denser where much moves; at least one in each part of the mesh.

    rest: the vertices in mm.
    laplacian: its entries say which vertices are neighbours.
    motion: how far each vertex moves.
    share: of the vertices.

    Each anchor is the vertex farthest from those before it along edges, where lengths count by the root of the vertex's
    motion plus the mean motion.
    """
    count, places = len(rest), laplacian.tocoo()
    apart = places.row != places.col
    rows, columns = places.row[apart], places.col[apart]
    lengths = np.maximum(np.linalg.norm(rest[rows].astype(np.float64) - rest[columns], axis=1), 1e-6)
    graph = csr_array((lengths, (rows, columns)), shape=(count, count))
    weight = np.sqrt(motion + max(float(motion.mean()), 1e-12))
    distance, chosen = np.full(count, np.inf), []
    while len(chosen) < round(share * count) or np.isinf(distance).any():
        apart = np.isinf(distance)
        chosen.append(int(np.argmax(np.where(apart, weight, -1.0) if apart.any() else distance * weight)))
        distance = np.minimum(distance, dijkstra(graph, indices=chosen[-1]))
    return np.sort(np.array(chosen, np.int64))


@dataclass(frozen=True)
class Reconstruction:
    """What turns δ and the anchors' offsets into the offsets of all vertices.

    laplacian: L (k, k).
    anchors: (a,), the indices of vertices; each part of the mesh has one.
    """

    laplacian: csr_array
    anchors: np.ndarray

    @cached_property
    def _factor(self) -> Any:
        """The factor of LᵀL + I_AᵀI_A, symmetric, without pivots."""
        held = np.zeros(self.laplacian.shape[0])
        held[self.anchors] = 1
        normal = (self.laplacian.T @ self.laplacian + diags_array(held)).tocsc()
        return splu(normal, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    @property
    def nonzeros(self) -> int:
        """How many entries the Cholesky factor has."""
        return int(self._factor.L.nnz)

    def offsets(
        self, delta: Float[np.ndarray, "b k 3"], held: Float[np.ndarray, "b a 3"]
    ) -> Float64[np.ndarray, "b k 3"]:
        """Return the offsets with these δ and anchors, in the least-squares sense."""
        valence = self.laplacian.diagonal()[:, None]
        return np.stack(
            [
                self._factor.solve(self.laplacian.T @ (valence * pose) + self._spread(fixed))
                for pose, fixed in zip(delta.astype(np.float64), held, strict=True)
            ]
        )

    def pins(self) -> Float32[np.ndarray, "k a"]:
        """Return how far each vertex follows each anchor."""
        return self._factor.solve(self._spread(np.eye(len(self.anchors)))).astype(np.float32)

    def _spread(self, held: np.ndarray) -> np.ndarray:
        out = np.zeros((self.laplacian.shape[0], held.shape[1]))
        out[self.anchors] = held
        return out


# The networks.


class AnchorNetworks(nn.Module):
    """(b, m) scaled parameters → (b, a, 3) in the unit of the anchors' offsets: a network for each anchor, all at once.

    sees: (a, m), which parameters each of them sees.
    hidden: the widths of each network's layers.
    """

    sees: torch.Tensor

    def __init__(self, sees: Bool[np.ndarray, "a m"], hidden: Sequence[int]):
        super().__init__()
        widths = [*pairwise((sees.shape[1], *hidden, 3))]
        self.weights = nn.ParameterList([nn.Parameter(torch.zeros(len(sees), a, b)) for a, b in widths])
        self.biases = nn.ParameterList([nn.Parameter(torch.zeros(len(sees), 1, b)) for _, b in widths])
        self.register_buffer("sees", torch.from_numpy(sees).float())

    def start(self, generator: torch.Generator) -> None:
        """Draw the first weights (He et al. 2015), each by how many parameters its network sees."""
        with torch.no_grad():
            for k, weight in enumerate(self.weights):
                inputs = self.sees.sum(1).clamp(min=1)[:, None, None] if k == 0 else weight.shape[1]
                weight.normal_(0, 1, generator=generator).mul_((2 / torch.as_tensor(inputs)) ** 0.5)

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b a 3"]:
        x = params[None] * self.sees[:, None]
        layers = list(zip(self.weights, self.biases, strict=True))
        for weight, bias in layers[:-1]:
            x = torch.relu(torch.matmul(x, weight) + bias)
        weight, bias = layers[-1]
        return (torch.matmul(x, weight) + bias).transpose(0, 1)

    def seen_weights(self) -> int:
        """Return how many weights multiply something: those of parameters that a network doesn't see are left out."""
        first, *others = self.weights
        return int(self.sees.sum()) * first.shape[2] + sum(weight.numel() for weight in others)


class DifferentialNetwork(nn.Module):
    """(b, m) scaled parameters → (b, k, 3) offsets in mm, by the components of δ and by the anchors.

    sees: as for `AnchorNetworks`.
    hidden, anchor_hidden: the widths of the layers of both kinds of networks.
    components: how many δ has.
    vertices: k.

    Buffers, set by `reconstruct_by`: shapes (c, 3k) and mean (3k,), the offsets that δ gives; pins (k, a).
    """

    shapes: torch.Tensor
    mean: torch.Tensor
    pins: torch.Tensor
    length: torch.Tensor

    def __init__(
        self,
        sees: Bool[np.ndarray, "a m"],
        hidden: Sequence[int],
        anchor_hidden: Sequence[int],
        components: int,
        vertices: int,
    ):
        super().__init__()
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise((sees.shape[1], *hidden)))
        self.output = nn.Linear(hidden[-1], components)
        self.anchors = AnchorNetworks(sees, anchor_hidden)
        self.register_buffer("length", torch.ones(()))
        self.register_buffer("shapes", torch.zeros(components, 3 * vertices))
        self.register_buffer("mean", torch.zeros(3 * vertices))
        self.register_buffer("pins", torch.zeros(vertices, len(sees)))

    def reconstruct_by(
        self, solver: Reconstruction, basis: Float[np.ndarray, "c d"], mean: Float[np.ndarray, " d"], length: float
    ) -> None:
        """Set the offsets that δ and anchors give.

        solver: has the mesh and the anchors.
        basis, mean: δ in mm is the mean plus the coefficients times the basis.
        length: the unit of the anchors' networks, mm.
        """
        solved = solver.offsets(
            np.concatenate([basis, mean[None]]).reshape(len(basis) + 1, -1, 3),
            np.zeros((len(basis) + 1, len(solver.anchors), 3)),
        ).reshape(len(basis) + 1, -1)
        self.shapes.copy_(torch.from_numpy(solved[:-1]))
        self.mean.copy_(torch.from_numpy(solved[-1]))
        self.pins.copy_(torch.from_numpy(solver.pins()))
        self.length.fill_(length)

    def coefficients(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b c"]:
        """Return the coefficients of the components of δ."""
        x = params
        for layer in self.hidden:
            x = torch.relu(layer(x))
        return self.output(x)

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b k 3"]:
        smooth = torch.addmm(self.mean, self.coefficients(params), self.shapes).unflatten(1, (-1, 3))
        return smooth + torch.matmul(self.pins, self.anchors(params) * self.length)


class DifferentialModel(SegmentedModel):
    """One such network for all that deforms.

    nonzeros: of the Cholesky factor.
    """

    nonzeros: int = 0

    def size_mb(self) -> float:
        """Return the size of networks, components of δ and their mean as float32, in MB of 10⁶ bytes.

        The factor is left out: it follows from the mesh and the choice of anchors.
        """
        (network,) = self.networks
        trained = sum(weight.numel() for weight in network.parameters())
        unseen = (
            network.anchors.weights[0].numel() - int(network.anchors.sees.sum()) * network.anchors.weights[0].shape[2]
        )
        return (trained - unseen + network.shapes.numel() + network.mean.numel()) * 4 / 1e6

    def multiplications(self) -> int:
        """Return the multiplications of the published algorithm, with a back-substitution for each axis.

        Each entry of the factor is used on the way down and on the way up.
        """
        (network,) = self.networks
        layers = sum(layer.weight.numel() for layer in (*network.hidden, network.output))
        return layers + network.anchors.seen_weights() + network.shapes.numel() + 2 * 3 * self.nonzeros


def save_differential(
    model: DifferentialModel, folder: Path, hidden: Sequence[int], anchor_hidden: Sequence[int]
) -> None:
    """Write a model to a folder."""
    facts = {
        "hidden": list(hidden),
        "anchor_hidden": list(anchor_hidden),
        "components": len(model.networks[0].shapes),
        "anchors": len(model.networks[0].anchors.sees),
        "nonzeros": model.nonzeros,
    }
    save_model(model, folder, facts)


def load_differential(folder: Path) -> DifferentialModel:
    """Read a model; its `.offsets(params)` predicts. Raises InputError when there is none."""
    found = {}

    def network(segment: Segment, facts: dict) -> DifferentialNetwork:
        found.update(facts)
        sees = np.zeros((facts["anchors"], len(segment.parameters)), bool)
        return DifferentialNetwork(
            sees, facts["hidden"], facts["anchor_hidden"], facts["components"], len(segment.vertices)
        )

    read = load_model(folder, network)
    model = DifferentialModel(list(read.networks), read.segments, read.scale, read.lengths, read.vertex_count)
    model.nonzeros = found["nonzeros"]
    return model


# Stochastic gradient descent with momentum, as the paper has it; the suite's other networks have Adam.


def descend(
    network: nn.Module,
    loss_of_step: Callable[[int], torch.Tensor],
    config: TrainingConfig,
    momentum: float,
    scratch: Path,
    progress: Callable,
    label: str,
    measure: Callable[[], tuple[float, float]],
) -> list[dict]:
    """Minimise a loss over a network's weights, in place, and return the log as `training.train` does.

    network: its weights are trained, where they need a gradient.
    loss_of_step, config, scratch, progress, label, measure: as for `training.train`.
    momentum: the share of a step that the next one goes on with.

    A run that is stopped continues from its checkpoint, with the same result.
    """
    weights = {name: weight for name, weight in network.named_parameters() if weight.requires_grad}
    speeds = {name: torch.zeros_like(weight) for name, weight in weights.items()}
    checkpoint, first, log, running = Path(scratch) / "checkpoint.sealed", 0, [], []
    if arrays := read_sealed(checkpoint, lambda stream: load(stream.read())):
        first, log, running = json.loads(arrays.pop(_FACTS).numpy().tobytes())
        for name, array in arrays.items():
            speed = name.endswith(_SPEED)
            (speeds[name.removesuffix(_SPEED)] if speed else weights[name].data).copy_(array)
    every, last_save = max(1, config.steps // ROWS), time.monotonic()
    with progress(config.steps, label, first) as bar:
        for step in range(first, config.steps):
            loss = loss_of_step(step)
            gradients = torch.autograd.grad(loss, list(weights.values()))
            with torch.no_grad():
                for (name, weight), gradient in zip(weights.items(), gradients, strict=True):
                    speeds[name].mul_(momentum).add_(gradient)
                    weight.sub_(learning_rate(config, step) * speeds[name])
            running.append(loss.item())
            if (step + 1) % every == 0 or step + 1 == config.steps:
                row = (step + 1, math.fsum(running) / len(running), *measure())
                log.append(dict(zip(LOG_COLUMNS, row, strict=True)))
                running = []
            if time.monotonic() - last_save > CHECKPOINT_S or step + 1 == config.steps:
                state = weights | {name + _SPEED: speed for name, speed in speeds.items()}
                arrays = {name: array.detach().cpu().contiguous() for name, array in state.items()}
                facts = json.dumps([step + 1, log, running]).encode()
                data = save(arrays | {_FACTS: torch.frombuffer(bytearray(facts), dtype=torch.uint8)})
                write_sealed(checkpoint, lambda stream, data=data: stream.write(data))
                last_save = time.monotonic()
            bar.update(1)
    return log
