"""A trained approximation: a network for each segment, from raw rig parameters to vertex offsets in millimetres.

Coarse, refinement and dense models differ only in their networks. What they share is here: which parameters each
network sees and how they are scaled (`conditioning.py`), which vertices it moves, and how the model is saved.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32
from safetensors.torch import load_file, save_file
from torch import nn

from replicate.approximation.conditioning import initialise, output_lengths
from replicate.approximation.segments import Segment, segment_vertices
from replicate.base.exceptions import InputError
from replicate.config import CoarseConfig, DenseConfig, RefinementConfig


class SegmentedModel(nn.Module):
    """Networks side by side, each (b, j) scaled parameters → (b, k, 3) offsets of its segment.

    scale: (m,), what rig parameters are divided by.
    lengths: the unit of each network's output, in mm.
    vertex_count: n of the whole mesh.
    """

    networks: Any  # an nn.ModuleList of the method's networks
    scale: torch.Tensor

    def __init__(
        self,
        networks: Sequence[nn.Module],
        segments: Sequence[Segment],
        scale: np.ndarray | torch.Tensor,
        lengths: Sequence[float],
        vertex_count: int,
    ):
        super().__init__()
        self.networks, self.segments, self.vertex_count = nn.ModuleList(networks), tuple(segments), vertex_count
        self.lengths = [float(length) for length in lengths]
        self.vertices = segment_vertices(segments)
        self.register_buffer("scale", torch.as_tensor(np.asarray(scale), dtype=torch.float32))
        for k, segment in enumerate(segments):
            self.register_buffer(f"parameters_{k}", torch.from_numpy(segment.parameters).long(), persistent=False)

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b v 3"]:
        """Return the offsets (mm) of `self.vertices` for raw rig parameters, differentiable in both."""
        scaled = params / self.scale
        inputs = (scaled[:, getattr(self, f"parameters_{k}")] for k in range(len(self.segments)))
        return torch.cat([n(p) * s for n, p, s in zip(self.networks, inputs, self.lengths, strict=True)], dim=1)

    def offsets(self, params: Float[np.ndarray, "b m"], batch: int = 32) -> Float32[np.ndarray, "b n 3"]:
        """Return full-mesh offsets for raw rig parameters; zero on vertices of no segment."""
        params = np.asarray(params, np.float32)
        out = np.zeros((len(params), self.vertex_count, 3), np.float32)
        with torch.no_grad():
            for start in range(0, len(params), batch):
                part = torch.tensor(params[start : start + batch]).to(self.scale.device)
                out[start : start + batch, self.vertices] = self(part).cpu().numpy()
        return out

    def part(self, indices: Sequence[int]) -> "SegmentedModel":
        """Return the model of some segments, with the same networks."""
        networks, segments, lengths = zip(
            *[(self.networks[k], self.segments[k], self.lengths[k]) for k in indices], strict=True
        )
        scale = self.scale.cpu()
        return SegmentedModel(networks, segments, scale, lengths, self.vertex_count).to(self.scale.device)

    def size_mb(self) -> float:
        """Return the size of all trained weights as float32, in MB of 10⁶ bytes (Table 1)."""
        return sum(weight.numel() for weight in self.networks.parameters()) * 4 / 1e6


def fresh_model(
    networks: Sequence[nn.Module],
    segments: Sequence[Segment],
    scale: Float[np.ndarray, " m"],
    targets: Float[np.ndarray, "b n 3"],
    config: CoarseConfig | RefinementConfig | DenseConfig,
    seed: int,
) -> SegmentedModel:
    """Return an untrained model.

    networks: their weights are drawn from `seed`.
    segments: one for each network.
    scale: what rig parameters are divided by.
    targets: the offsets that the model should predict at some training poses.
    config: has the networks' conditioning and slope.
    """
    initialise(config.conditioning, networks, config.leaky_slope, torch.Generator().manual_seed(seed))
    lengths = output_lengths(config.conditioning, segments, targets)
    return SegmentedModel(networks, segments, scale, lengths, targets.shape[1])


def save_model(model: SegmentedModel, folder: Path, facts: dict) -> None:
    """Write weights.safetensors and model.json; facts: what is needed to make the networks again, JSON-ready."""
    arrays = {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}
    for k, segment in enumerate(model.segments):
        for field in ("vertices", "uv", "parameters"):
            arrays[f"segment.{k}.{field}"] = torch.from_numpy(getattr(segment, field))
    save_file(arrays, Path(folder) / "weights.safetensors")
    names = [segment.name for segment in model.segments]
    description = {"segments": names, "lengths_mm": model.lengths, "vertex_count": model.vertex_count, **facts}
    (Path(folder) / "model.json").write_text(json.dumps(description, indent=1) + "\n")


def load_model(folder: Path, make_network: Callable[[Segment, dict], nn.Module]) -> SegmentedModel:
    """Read what `save_model` wrote; raise InputError, naming the folder, if there is no such model.

    make_network: (segment, facts) → a network of the saved shape.
    """
    try:
        facts = json.loads((Path(folder) / "model.json").read_text())
        arrays = load_file(Path(folder) / "weights.safetensors")
    except Exception as error:  # safetensors has an error class for damaged files, Python others for missing ones
        raise InputError(f"{folder}: the model can't be read ({error})") from error
    segments = [
        Segment(name, *(arrays.pop(f"segment.{k}.{field}").numpy() for field in ("vertices", "uv", "parameters")))
        for k, name in enumerate(facts["segments"])
    ]
    networks = [make_network(segment, facts) for segment in segments]
    model = SegmentedModel(networks, segments, arrays["scale"], facts["lengths_mm"], facts["vertex_count"])
    model.load_state_dict(arrays)
    return model
