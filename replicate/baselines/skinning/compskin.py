"""Compressed skinning (Kavan et al. 2024): shapes as sparse linearised motions of a few bones, driven by a network.

A shape moves each bone by six numbers, a small rotation ω and a translation t, and vertex v of rest by
Σ_b w_b (ω_b × (v − c_b) + t_b). With Z = (weights × rest) and M the motions of all shapes, the loss
mean |Z M − A|² + α mean |U Z M|² of the shapes' offsets A, U the umbrella operator, is minimised by Adam. After each
step each vertex keeps its largest weights, none of them negative, and of all motions the largest numbers stay.

A network of the controls gives the coefficients of the shapes. It is trained on Eq. 1 through the compressed shapes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32
from scipy.sparse import csr_array, diags_array
from torch import nn
from torch.nn import functional

from replicate.approximation.model import SegmentedModel, load_model, save_model
from replicate.approximation.segments import Segment
from replicate.baselines.multiplications import AFFINE

MM = 10.0  # in a centimetre, the unit of lengths here
BYTES = 4
STIFF = 1e-3  # penalty of the first motions, in mean squares of what they are multiplied by


@dataclass(frozen=True)
class Limits:
    """What a compressed skin may have, and how it is found.

    weights: the most of each vertex.
    numbers: the most that are not zero in the motions of all shapes.
    smoothness: α.
    steps: with free weights, then as many with weights that sum to 1.
    rate: of Adam, whose moments both decay by 0.9.
    """

    weights: int
    numbers: int
    smoothness: float
    steps: int
    rate: float


@dataclass(frozen=True)
class CompressedShapes:
    """Shapes of n vertices as motions of p bones.

    weights: (n, p), at most `Limits.weights` of a row are positive, the others 0; rows sum to 1.
    motions: (s, p, 6), a rotation in radians and a translation in cm of each bone in each shape.
    centres: (p, 3), what bones turn about, cm.
    """

    weights: Float32[np.ndarray, "n p"]
    motions: Float32[np.ndarray, "s p 6"]
    centres: Float32[np.ndarray, "p 3"]


def matrices(motions: Float[torch.Tensor, "s p 6"]) -> Float[torch.Tensor, "s p 4 3"]:
    """Return the matrices by which motions act on row vectors (v, 1): offsets in the unit of v."""
    x, y, z, *shift = motions.unbind(-1)
    zero = torch.zeros_like(x)
    rows = ((zero, z, -y), (-z, zero, x), (y, -x, zero), shift)
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def weighted_rest(
    weights: Float[torch.Tensor, "n p"], rest: Float[torch.Tensor, "n 3"], centres: Float[torch.Tensor, "p 3"]
) -> Float[torch.Tensor, "n q"]:
    """Return Z (n, 4p): for each bone the weighted place of each vertex beside the bone's centre, and the weight."""
    apart = functional.pad(rest[:, None] - centres, (0, 1), value=1.0)
    return (weights[:, :, None] * apart).flatten(1)


def keep_largest(values: torch.Tensor, count: int) -> None:
    """Set all but the `count` largest absolute values of a tensor to zero, in place."""
    flat = values.view(-1)
    if count < len(flat):
        flat[torch.topk(flat.abs(), len(flat) - count, largest=False).indices] = 0


def project_weights(weights: Float[torch.Tensor, "n p"], count: int, normalised: bool) -> None:
    """Keep the `count` largest weights of each vertex, none negative, in place; normalised: their sum becomes 1."""
    weights.clamp_(min=0)
    if count < weights.shape[1]:
        least = torch.topk(weights, weights.shape[1] - count, 1, largest=False).indices
        weights.scatter_(1, least, 0.0)
    if normalised:
        total = weights.sum(1, keepdim=True)
        weights.copy_(torch.where(total > 1e-6, weights / total.clamp(min=1e-6), 0.0))


def first_bones(
    rest: Float[np.ndarray, "n 3"], motion: Float[np.ndarray, " n"], bones: int, most: int, seed: int
) -> tuple[Float32[np.ndarray, "n p"], Float32[np.ndarray, "p 3"]]:
    """Return first weights, and the bones' centres, denser where much moves: clusters of the vertices by k-means.

    rest: the vertices.
    motion: how far each of them moves.
    bones: how many at most.
    most: weights of a vertex; they fall to zero at the distance of the next bone, so that there are no steps.
    seed: of the clusters.
    """
    from sklearn.cluster import KMeans
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        found = KMeans(min(bones, len(rest)), n_init=1, random_state=seed).fit(
            rest, sample_weight=motion + motion.mean()
        )
    centres = found.cluster_centers_
    apart = np.linalg.norm(rest[:, None] - centres, axis=-1)
    reach = np.partition(apart, most, axis=1)[:, most] if most < len(centres) else 2 * apart.max(1) + 1e-6
    nearest = apart <= apart.min(1, keepdims=True)
    weights = np.maximum(1 - apart / np.maximum(reach, 1e-6)[:, None], 1e-6 * nearest) ** 2
    return (weights / weights.sum(1, keepdims=True)).astype(np.float32), centres.astype(np.float32)


def first_motions(z: Float[torch.Tensor, "n q"], shapes: Float[torch.Tensor, "n d"]) -> Float[torch.Tensor, "s p 6"]:
    """Return the least-squares motions of all shapes (n, 3s) for fixed weights, lightly penalised."""
    p, s = z.shape[1] // 4, shapes.shape[1] // 3
    z64, eye = z.double(), torch.eye(6, dtype=torch.float64)
    acts = matrices(eye[:, None]).squeeze(1)  # (6, 4, 3), each number's matrix
    gram = torch.einsum("paqb,iak,jbk->piqj", (z64.T @ z64).view(p, 4, p, 4), acts, acts).reshape(6 * p, 6 * p)
    products = torch.einsum("pask,iak->pis", (z64.T @ shapes.double()).view(p, 4, s, 3), acts).reshape(6 * p, s)
    penalty = STIFF * gram.diagonal().mean() * torch.eye(6 * p, dtype=torch.float64)
    return torch.linalg.solve(gram + penalty, products).T.reshape(s, p, 6).float().contiguous()


def compress(
    rest_mm: Float[np.ndarray, "n 3"],
    laplacian: csr_array,
    shapes_mm: Float[np.ndarray, "s n 3"],
    bones: int,
    limits: Limits,
    seed: int,
    bar: Callable[[int], object] = lambda steps: None,
    watch: Callable[[torch.Tensor, torch.Tensor], object] = lambda weights, motions: None,
) -> CompressedShapes:
    """Return shapes as motions of bones.

    rest_mm: the vertices at rest.
    laplacian: of the mesh, with valences on its diagonal.
    shapes_mm: the offsets of each shape.
    bones: how many.
    limits: on what is stored, and the schedule.
    seed: of the bones' first places.
    bar: called with 1 after each step.
    watch: called with weights and motions after each step.
    """
    rest = torch.from_numpy(np.asarray(rest_mm / MM, np.float32))
    goal = torch.from_numpy(np.ascontiguousarray(shapes_mm.transpose(1, 0, 2) / MM, np.float32)).flatten(1)  # (n, 3s)
    motion = np.sqrt(np.square(shapes_mm, dtype=np.float64).sum((0, 2)))
    start, middles = first_bones(rest.numpy(), motion, bones, limits.weights, seed)
    centres, weights = torch.from_numpy(middles), torch.from_numpy(start)
    project_weights(weights, limits.weights, normalised=True)
    motions = first_motions(weighted_rest(weights, rest, centres), goal)
    keep_largest(motions, limits.numbers)
    normalised = (diags_array(1 / np.maximum(laplacian.diagonal(), 1)) @ laplacian).tocoo().astype(np.float32)
    places, values = torch.from_numpy(np.stack([normalised.row, normalised.col])).long(), normalised.data
    umbrella = torch.sparse_coo_tensor(places, torch.from_numpy(values), normalised.shape, check_invariants=True)
    umbrella = umbrella.coalesce()
    # the squares of products without the products: |Z M − A|² = ⟨ZᵀZ, MMᵀ⟩ − 2 ⟨ZᵀA, M⟩ + |A|², and ⟨(UZ)ᵀ(UZ), MMᵀ⟩
    for parameter in (weights, motions):
        parameter.requires_grad_(True)
    optimiser = torch.optim.Adam([weights, motions], limits.rate, betas=(0.9, 0.9))
    for step in range(2 * limits.steps):
        optimiser.zero_grad()
        z = weighted_rest(weights, rest, centres)
        m = matrices(motions).flatten(1, 2).transpose(0, 1).flatten(1)  # (4p, 3s)
        curved = torch.sparse.mm(umbrella, z)
        squares = z.T @ z + limits.smoothness * (curved.T @ curved)
        loss = ((squares * (m @ m.T)).sum() - 2 * ((z.T @ goal) * m).sum()) / goal.numel()
        loss.backward()
        optimiser.step()
        with torch.no_grad():
            project_weights(weights, limits.weights, normalised=step >= limits.steps)
            keep_largest(motions, limits.numbers)
            watch(weights, motions)
        bar(1)
    with torch.no_grad():
        project_weights(weights, limits.weights, normalised=True)
    return CompressedShapes(weights.detach().numpy(), motions.detach().numpy(), middles)


class CompressedNetwork(nn.Module):
    """(b, m) scaled parameters → (b, n, 3) offsets in mm: coefficients of all shapes but the last, which is always 1.

    hidden: the widths of the layers, each followed by a leaky ReLU.
    slope: of the leaky ReLUs.
    shapes, bones, vertices: how many there are.

    Buffers, set by `skin`: spread (n, 4 · bones), and moves (shapes, 12 · bones), each bone's matrix in mm.
    """

    spread: torch.Tensor
    moves: torch.Tensor

    def __init__(self, inputs: int, hidden: Sequence[int], slope: float, shapes: int, bones: int, vertices: int):
        super().__init__()
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise((inputs, *hidden)))
        self.output = nn.Linear(hidden[-1], shapes - 1)
        self.slope = slope
        self.register_buffer("spread", torch.zeros(vertices, 4 * bones))
        self.register_buffer("moves", torch.zeros(shapes, 12 * bones))

    def skin(self, compressed: CompressedShapes, rest_mm: Float[np.ndarray, "n 3"]) -> None:
        """Set the skin and the shapes."""
        rest = torch.from_numpy(np.asarray(rest_mm / MM, np.float32))
        arrays = map(torch.from_numpy, (compressed.weights, compressed.centres, compressed.motions))
        weights, centres, motions = arrays
        self.spread.copy_(weighted_rest(weights, rest, centres))
        self.moves.copy_(MM * matrices(motions).flatten(1))

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b n 3"]:
        x = params
        for layer in self.hidden:
            x = functional.leaky_relu(layer(x), self.slope)
        moves = torch.addmm(self.moves[-1], self.output(x), self.moves[:-1]).unflatten(1, (-1, 3))
        return torch.matmul(self.spread, moves)

    def numbers(self) -> int:
        """Return how many numbers of the motions are not zero; of a rotation's two entries in a matrix one counts."""
        turns = self.moves.unflatten(1, (-1, 4, 3))
        return int(turns[:, :, 3].count_nonzero()) + int(turns[:, :, :3].count_nonzero()) // 2

    def weights(self) -> int:
        """Return how many weights are not zero."""
        return int(self.spread[:, 3::4].count_nonzero())


class CompressedModel(SegmentedModel):
    """One such network for all that deforms."""

    def size_mb(self) -> float:
        """Return the size of network and skin in MB of 10⁶ bytes: a value and an index for each weight and number."""
        (network,) = self.networks
        trained, bones = super().size_mb(), network.spread.shape[1] // 4
        return trained + BYTES * (2 * network.weights() + 2 * network.numbers() + 3 * bones) / 1e6

    def multiplications(self) -> int:
        """Return the multiplications of the network, the bones' motions and the blend."""
        (network,) = self.networks
        layers = sum(layer.weight.numel() for layer in (*network.hidden, network.output))
        return layers + network.numbers() + AFFINE * network.weights()


def save_compressed(model: CompressedModel, folder: Path, hidden: Sequence[int], slope: float) -> None:
    """Write a model to a folder."""
    (network,) = model.networks
    counts = {"shapes": len(network.moves), "bones": network.spread.shape[1] // 4}
    save_model(model, folder, {"hidden": list(hidden), "leaky_slope": slope, **counts})


def load_compressed(folder: Path) -> CompressedModel:
    """Read a model; its `.offsets(params)` predicts. Raises InputError when there is none."""

    def network(segment: Segment, facts: dict) -> CompressedNetwork:
        counts = facts["shapes"], facts["bones"], len(segment.vertices)
        return CompressedNetwork(len(segment.parameters), facts["hidden"], facts["leaky_slope"], *counts)

    read = load_model(folder, network)
    return CompressedModel(list(read.networks), read.segments, read.scale, read.lengths, read.vertex_count)
