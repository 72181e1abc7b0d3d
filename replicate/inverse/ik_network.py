"""The IK model: a feed-forward network a region turns control points into rig parameters (§4.1, Fig. 6)."""

import json
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32
from safetensors.torch import load_file, save_file
from torch import nn
from torch.nn import functional

from replicate.engine.exceptions import InputError
from replicate.inverse.control_points import Region

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
    neutral: (c, 3) control points of the neutral pose, mm. spread: (c, a) what their moves are divided by, mm. default:
    (m,) parameters of the neutral pose. reach: (m,) what the networks' outputs are multiplied by. a is 2 for points in
    the image plane, x and y (§5.3.1), 3 for points in space.
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
        """Return raw rig parameters for control points in mm; of points in the image plane z doesn't count."""
        moves = (points - self.neutral)[..., : self.axes] / self.spread
        total = torch.zeros(len(points), len(self.default), dtype=moves.dtype, device=moves.device)
        for j, network in enumerate(self.networks):
            own = network(moves[:, getattr(self, f"points_{j}")].flatten(1))
            total = total.index_add(1, getattr(self, f"parameters_{j}"), own)
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
