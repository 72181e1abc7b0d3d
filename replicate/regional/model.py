"""Our approximation: gated networks give the coefficients of regional bases, which are stored in few bits.

V = V⁰ + Σ_r (mean_r + c_r(p) B_r), over the regions r that move a vertex; regions overlap. At rest c_r is zero by
construction, but for the 16 bits of weights, which mean_r = −c_r(rest) B_r takes away. The networks are trained on
coefficients alone: a basis is orthonormal in the metric of the loss, so that the length of the coefficients' error is
the error that the loss sees, and training needs no mesh.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from safetensors.torch import load_file, save_file
from torch import nn

from replicate.base.exceptions import InputError
from replicate.regional.basis import RegionalBasis
from replicate.regional.networks import RegionalNetworks, fresh_networks

STORED = ("vertices", "weights", "mean", "fine", "rough", "steps")  # of a basis
WEIGHTS, DESCRIPTION = "weights.safetensors", "model.json"
LENGTH_FLOOR = 1e-5  # of the usual length of coefficients: below it an error's gradient fades


class StoredBasis(nn.Module):
    """A region's basis as it is stored: the first components in 16 bits, the others in 8, each with its step in mm.

    A vertex moves by the weighted sum of its offsets in all bases that have it.

    vertices: (k,) int32.
    weights: (k,) float32.
    mean: (k, 3) float16 in a file, mm.
    fine: (a, k, 3) int16.
    rough: (c − a, k, 3) int8.
    steps: (c,) float32, mm.
    """

    vertices: torch.Tensor
    weights: torch.Tensor
    mean: torch.Tensor
    fine: torch.Tensor
    rough: torch.Tensor
    steps: torch.Tensor

    def __init__(
        self,
        vertices: torch.Tensor,
        weights: torch.Tensor,
        mean: torch.Tensor,
        fine: torch.Tensor,
        rough: torch.Tensor,
        steps: torch.Tensor,
    ):
        super().__init__()
        for name, value in zip(STORED, (vertices, weights, mean, fine, rough, steps), strict=True):
            self.register_buffer(name, value)

    def components(self) -> Float[torch.Tensor, "c d"]:
        """Return the components times the vertices' weights, in mm, (c, 3k), as float32."""
        whole = torch.cat([self.fine.float(), self.rough.float()]) * self.weights[:, None]
        return (whole * self.steps[:, None, None]).flatten(1)

    def means(self) -> Float[torch.Tensor, "k 3"]:
        """Return the mean times the vertices' weights, in mm, as float32."""
        return self.mean.float() * self.weights[:, None]

    def size_bytes(self) -> int:
        """Return how many bytes the basis takes, without its vertices' indices, and without weights that are all 1."""
        counted = [self.mean.half(), self.fine, self.rough, self.steps]
        counted += [] if (self.weights == 1).all() else [self.weights]
        return sum(value.numel() * value.element_size() for value in counted)


def store(basis: RegionalBasis, fine: int) -> StoredBasis:
    """Return a basis in few bits: its first `fine` components in 16, the others in 8.

    A component's largest entry becomes the largest whole number. Coefficients are those of the stored components, not
    of the exact ones, and so undo most of the rounding.
    """
    parts, steps = [], []
    for components, kind in ((basis.components[:fine], np.int16), (basis.components[fine:], np.int8)):
        largest = np.abs(components).max(axis=(1, 2), initial=0.0)
        step = np.where(largest > 0, largest, 1.0) / np.iinfo(kind).max
        parts.append(torch.from_numpy(np.rint(components / step[:, None, None]).astype(kind)))
        steps.append(step)
    weights = np.ones(len(basis.vertices), np.float32)
    ends = (basis.vertices.astype(np.int32), weights, basis.mean.astype(np.float16))
    vertices, weights, mean = map(torch.from_numpy, ends)
    step = torch.from_numpy(np.concatenate(steps).astype(np.float32))
    return StoredBasis(vertices, weights, mean, parts[0], parts[1], step)


def blended(
    basis: StoredBasis,
    vertices: Int[np.ndarray, " j"],
    weights: Float[np.ndarray, " j"],
    coefficients: Float[np.ndarray, "s c"],
    offsets: Float[np.ndarray, "s l 3"],
    through_rest: bool = False,
) -> StoredBasis:
    """Return a region's basis extended to vertices beyond the region, with weights.

    There, mean and components are the least squares fit of offsets in some samples by the samples' coefficients. Where
    they are too large for their bits, they are stored smaller and the vertex's weight is larger.

    basis: of the region alone.
    vertices: those of the basis, then l others.
    weights: of these vertices.
    coefficients: of the samples.
    offsets: of the l others in the samples, mm.
    through_rest: whether the mean is left at zero.
    """
    constant = np.zeros if through_rest else np.ones  # least squares give a column of zeros the weight zero
    known = np.column_stack([constant(len(coefficients)), coefficients]).astype(np.float64)
    fit = np.linalg.lstsq(known, offsets.reshape(len(offsets), -1).astype(np.float64))[0]
    beyond = fit.reshape(len(fit), -1, 3)
    steps, kept = basis.steps.numpy()[:, None, None], len(basis.fine)
    further = beyond[1:] / steps
    most = np.where(np.arange(len(steps)) < kept, np.iinfo(np.int16).max, np.iinfo(np.int8).max)[:, None, None]
    factor = np.minimum(1, 1 / np.maximum(np.abs(further / most).max(axis=(0, 2), initial=0), 1e-30))
    further, mean = (torch.from_numpy(part * factor[:, None]) for part in (further, beyond[0]))
    fine = torch.cat([basis.fine, further[:kept].round().to(torch.int16)], dim=1)
    rough = torch.cat([basis.rough, further[kept:].round().to(torch.int8)], dim=1)
    weights = weights / np.concatenate([np.ones(len(basis.vertices)), factor])
    ends = (torch.from_numpy(vertices.astype(np.int32)), torch.from_numpy(weights.astype(np.float32)))
    return StoredBasis(*ends, torch.cat([basis.mean, mean.half()]), fine, rough, basis.steps)


def coverings(
    members: Sequence[Int[np.ndarray, " _"]],
) -> tuple[Int[np.ndarray, " k"], list[Int[np.ndarray, " _"]]]:
    """Return the vertices of overlapping regions, each once, and in layers the places of their rows.

    The regions' rows are one after the other, and a vertex's offset is the sum of its rows. The first layer has a row
    for each vertex. The second has one for each vertex that lies in two regions or more, and these come first; and so
    on. Where no regions overlap, vertices keep their order.
    """
    rows = np.concatenate(members)
    vertices, first, times = np.unique(rows, return_index=True, return_counts=True)
    order = np.lexsort((first, -times))
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    row_places = place[np.searchsorted(vertices, rows)]
    by_place = np.argsort(row_places, kind="stable")
    times, starts = times[order], np.concatenate([[0], np.cumsum(times[order])[:-1]])
    layers = [by_place[starts[times > turn] + turn] for turn in range(times.max())]
    return vertices[order], layers


class RegionalModel:
    """Raw rig parameters → offsets of the whole mesh: networks, and the bases that they give coefficients for.

    network: (b, m) scaled parameters → (b, Σ c) coefficients over `length`; each of its parts gives those of whole
        regions.
    bases: of the regions.
    scale: (m,), what parameters are divided by.
    length: what coefficients are multiplied by.
    vertex_count: n.
    rest: (m,), the scaled parameters at which nothing moves; None for a model that moves a little there.
    vertices, layers: those that move, (k,), and where their rows are, as `coverings` returns them.
    """

    def __init__(
        self,
        network: RegionalNetworks,
        bases: Sequence[StoredBasis],
        scale: np.ndarray,
        length: float,
        vertex_count: int,
        rest: np.ndarray | None = None,
    ):
        self.network, self.length, self.vertex_count, self.rest = network, float(length), vertex_count, rest
        self.bases = tuple(bases if rest is None else _through_rest(network, bases, self.length, rest))
        self.scale = torch.from_numpy(np.array(scale, np.float32))
        self.vertices, self.layers = coverings([basis.vertices.numpy() for basis in bases])
        self._layers = [torch.from_numpy(layer) for layer in self.layers]
        self._components = [basis.components() for basis in bases]
        self._means = [basis.means().flatten() for basis in self.bases]

    def offsets(self, params: Float[np.ndarray, "b m"]) -> Float32[np.ndarray, "b n 3"]:
        """Return full-mesh offsets (mm) for raw rig parameters; zero on vertices of no region."""
        out = np.zeros((len(params), self.vertex_count, 3), np.float32)
        with torch.no_grad():
            scaled = torch.from_numpy(np.array(params, np.float32)) / self.scale
            out[:, self.vertices] = self.moved(self.network(scaled)).numpy()
        return out

    def moved(self, coefficients: Float[torch.Tensor, "b d"]) -> Float[torch.Tensor, "b k 3"]:
        """Return the offsets (mm) of `vertices` for coefficients over `length`, as the network gives them."""
        parts = (coefficients * self.length).split([len(components) for components in self._components], dim=1)
        regions = [
            torch.addmm(mean, part, components).unflatten(1, (-1, 3))
            for mean, part, components in zip(self._means, parts, self._components, strict=True)
        ]
        rows = torch.cat(regions, dim=1)
        if len(self._layers) == 1:
            return rows
        moved = rows[:, self._layers[0]]
        for layer in self._layers[1:]:
            moved[:, : len(layer)] += rows[:, layer]
        return moved

    def size_mb(self) -> float:
        """Return the size of network (float16) and bases as they are stored, in MB of 10⁶ bytes."""
        network = 2 * sum(value.numel() for value in self.network.state_dict().values())
        return (network + sum(basis.size_bytes() for basis in self.bases)) / 1e6

    def multiplications(self) -> int:
        """Return how many multiplications one pose takes."""
        weights = sum(3 * len(basis.weights) for basis in self.bases) if len(self.layers) > 1 else 0
        return self.network.multiplications() + weights + sum(shapes.numel() for shapes in self._components)


def _through_rest(
    network: RegionalNetworks, bases: Sequence[StoredBasis], length: float, rest: np.ndarray
) -> list[StoredBasis]:
    """Return bases whose means undo what the network says at rest."""
    with torch.no_grad():
        said = network(torch.from_numpy(np.array(rest, np.float32))[None])[0] * length
    parts = said.split([len(basis.steps) for basis in bases])
    return [
        StoredBasis(b.vertices, b.weights, -_plain_mean(b, part), b.fine, b.rough, b.steps)
        for b, part in zip(bases, parts, strict=True)
    ]


def _plain_mean(basis: StoredBasis, coefficients: Float[torch.Tensor, " c"]) -> Float[torch.Tensor, "k 3"]:
    whole = torch.cat([basis.fine.float(), basis.rough.float()])
    return torch.tensordot(coefficients * basis.steps, whole, 1)


def regional_loss(error: Float[torch.Tensor, "b d"], membership: Float[torch.Tensor, "d r"]) -> Float[torch.Tensor, ""]:
    """Return the mean over poses of the summed lengths of the regions' coefficient errors.

    A length is the root of the squared error in the metric of the loss. Their sum is an L1 norm over regions and poses,
    as Eq. 1 is one over vertices, so that a few wild poses don't rule the fit. membership: 1 where a coefficient
    belongs to a region.
    """
    return (error.square() @ membership + LENGTH_FLOOR**2).sqrt().sum(dim=1).mean()


def halve(network: nn.Module) -> None:
    """Round a network's weights to 16 bits, in place."""
    with torch.no_grad():
        for weight in network.parameters():
            weight.copy_(weight.half().float())


def save(model: RegionalModel, folder: Path) -> None:
    """Write weights.safetensors (network in float16, bases as they are stored) and model.json."""
    arrays = {f"network.{name}": w.detach().cpu().half() for name, w in model.network.state_dict().items()}
    arrays |= {f"seen.{k}": seen.to(torch.int16) for k, seen in enumerate(model.network.seen)}
    for k, basis in enumerate(model.bases):
        arrays |= {f"basis.{k}.{name}": value.contiguous() for name, value in basis.named_buffers()}
        arrays[f"basis.{k}.mean"] = basis.mean.half()
    arrays |= {"scale": model.scale}
    if model.rest is not None:
        arrays["rest"] = torch.from_numpy(np.array(model.rest, np.float32))
    save_file(arrays, Path(folder) / WEIGHTS)
    first = model.network.networks[0]
    facts = {
        "networks": len(model.network.networks),
        "hidden": [layer.out_features // (1 + first.is_gated) for layer in first.layers],
        "gated": first.is_gated,
        "line": first.line is not None,
        "regions": len(model.bases),
        "length_mm": model.length,
        "vertex_count": model.vertex_count,
    }
    (Path(folder) / DESCRIPTION).write_text(json.dumps(facts, indent=1) + "\n")


def load(folder: Path) -> RegionalModel:
    """Read what `save` wrote. Raises InputError, naming the folder, when it holds no such model."""
    try:
        facts = json.loads((Path(folder) / DESCRIPTION).read_text())
        arrays = load_file(Path(folder) / WEIGHTS)
    except Exception as error:  # safetensors raises its own class for a damaged file, Python others for a missing one
        raise InputError(f"{folder}: there is no readable model in this folder ({error}).") from error
    bases = [StoredBasis(*(arrays[f"basis.{k}.{name}"] for name in STORED)) for k in range(facts["regions"])]
    seen = [arrays[f"seen.{k}"].numpy() for k in range(facts["networks"])]
    outputs = [len(basis.steps) for basis in bases]
    network = fresh_networks(seen, facts["hidden"], outputs, facts["gated"], facts["line"])
    prefix = "network."
    state = {name.removeprefix(prefix): w.float() for name, w in arrays.items() if name.startswith(prefix)}
    network.load_state_dict(state)
    for part in network.networks:
        part.is_limited = True
    rest = arrays["rest"].numpy() if "rest" in arrays else None
    return RegionalModel(network, bases, arrays["scale"].numpy(), facts["length_mm"], facts["vertex_count"], rest)
