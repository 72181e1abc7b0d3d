"""Our approximation: gated networks give the coefficients of regional bases, stored in few bits.

V = V⁰ + mean_r + c_r(p) B_r on each region r. The networks are trained on coefficients alone: a basis is orthonormal in
the metric of the loss, so that the length of a coefficient's error is the error that the loss sees, and no mesh is
needed in training.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32
from safetensors.torch import load_file, save_file
from torch import nn

from replicate.approximation.regional_basis import RegionalBasis
from replicate.approximation.regional_networks import RegionalNetworks, fresh_networks
from replicate.engine.exceptions import InputError

WEIGHTS, DESCRIPTION = "weights.safetensors", "model.json"
LENGTH_FLOOR = 1e-5  # of the usual length of coefficients: below it an error's gradient fades


class StoredBasis(nn.Module):
    """A region's basis as it is stored: the first components in 16 bits, the others in 8, each with its step in mm.

    vertices (k,), mean (k, 3) float16 in mm, fine (a, k, 3) int16, rough (c − a, k, 3) int8, steps (c,) float32.
    """

    def __init__(
        self, vertices: torch.Tensor, mean: torch.Tensor, fine: torch.Tensor, rough: torch.Tensor, steps: torch.Tensor
    ):
        super().__init__()
        for name, value in (
            ("vertices", vertices),
            ("mean", mean),
            ("fine", fine),
            ("rough", rough),
            ("steps", steps),
        ):
            self.register_buffer(name, value)

    def components(self) -> Float[torch.Tensor, "c d"]:
        """Return the components in mm, (c, 3k), as float32."""
        whole = torch.cat([self.fine.float(), self.rough.float()])
        return (whole * self.steps[:, None, None]).flatten(1)

    def size_bytes(self) -> int:
        """Return how many bytes the basis takes, its vertices' indices left out."""
        return sum(value.numel() * value.element_size() for name, value in self.named_buffers() if name != "vertices")


def store(basis: RegionalBasis, fine: int) -> StoredBasis:
    """Return a basis in few bits: its first `fine` components in 16, the others in 8.

    A component's largest entry is its largest whole number. Coefficients for the stored components, and not the exact
    ones, take back most of what rounding does, so no entry needs to know its neighbours.
    """
    parts, steps = [], []
    for components, kind in ((basis.components[:fine], np.int16), (basis.components[fine:], np.int8)):
        largest = np.abs(components).max(axis=(1, 2), initial=0.0)
        step = np.where(largest > 0, largest, 1.0) / np.iinfo(kind).max
        parts.append(torch.from_numpy(np.rint(components / step[:, None, None]).astype(kind)))
        steps.append(step)
    ends = (basis.vertices.astype(np.int32), basis.mean.astype(np.float16))
    step = torch.from_numpy(np.concatenate(steps).astype(np.float32))
    return StoredBasis(*map(torch.from_numpy, ends), *parts, step)


class RegionalModel:
    """Raw rig parameters → offsets of the whole mesh: networks, and the bases that they give coefficients for.

    network: (b, m) scaled parameters → (b, Σ c) coefficients over `length`; each of its parts gives those of whole
    regions. scale: (m,), what parameters are divided by. vertex_count: n.
    """

    def __init__(
        self,
        network: RegionalNetworks,
        bases: Sequence[StoredBasis],
        scale: np.ndarray,
        length: float,
        vertex_count: int,
    ):
        self.network, self.bases, self.length, self.vertex_count = network, tuple(bases), float(length), vertex_count
        self.scale = torch.from_numpy(np.array(scale, np.float32))
        self.vertices = np.concatenate([basis.vertices.numpy() for basis in bases])
        self._components = [basis.components() for basis in bases]
        self._means = [basis.mean.float().flatten() for basis in bases]

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
        return torch.cat(regions, dim=1)

    def size_mb(self) -> float:
        """Return the size of network (float16) and bases as they are stored, in MB of 10⁶ bytes."""
        network = 2 * sum(value.numel() for value in self.network.state_dict().values())
        return (network + sum(basis.size_bytes() for basis in self.bases)) / 1e6

    def multiplications(self) -> int:
        """Return how many multiplications one pose takes."""
        return self.network.multiplications() + sum(components.numel() for components in self._components)


def regional_loss(error: Float[torch.Tensor, "b d"], membership: Float[torch.Tensor, "d r"]) -> Float[torch.Tensor, ""]:
    """Return the mean over poses of the summed lengths of the regions' coefficient errors.

    A region's length is the root of its squared error in the metric of the loss: an L1 norm over regions and poses, as
    Eq. 1 is one over vertices, so that a few wild poses don't rule the fit. membership: 1 where a coefficient is of a
    region.
    """
    return (error.square() @ membership + LENGTH_FLOOR**2).sqrt().sum(dim=1).mean()


def halve(network: nn.Module) -> None:
    """Round a network's weights to what 16 bits hold, in place."""
    with torch.no_grad():
        for weight in network.parameters():
            weight.copy_(weight.half().float())


def save(model: RegionalModel, folder: Path) -> None:
    """Write weights.safetensors (network in float16, bases as they are stored) and model.json."""
    arrays = {f"network.{name}": w.detach().cpu().half() for name, w in model.network.state_dict().items()}
    arrays |= {f"seen.{k}": seen.to(torch.int16) for k, seen in enumerate(model.network.seen)}
    for k, basis in enumerate(model.bases):
        arrays |= {f"basis.{k}.{name}": value.contiguous() for name, value in basis.named_buffers()}
    save_file(arrays | {"scale": model.scale}, Path(folder) / WEIGHTS)
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
        raise InputError(f"{folder}: found no readable model there ({error}).") from error
    names = ("vertices", "mean", "fine", "rough", "steps")
    bases = [StoredBasis(*(arrays[f"basis.{k}.{name}"] for name in names)) for k in range(facts["regions"])]
    seen = [arrays[f"seen.{k}"].numpy() for k in range(facts["networks"])]
    outputs = [len(basis.steps) for basis in bases]
    network = fresh_networks(seen, facts["hidden"], outputs, facts["gated"], facts["line"])
    prefix = "network."
    state = {name.removeprefix(prefix): w.float() for name, w in arrays.items() if name.startswith(prefix)}
    network.load_state_dict(state)
    return RegionalModel(network, bases, arrays["scale"].numpy(), facts["length_mm"], facts["vertex_count"])
