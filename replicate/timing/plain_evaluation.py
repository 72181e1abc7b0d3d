"""The plain way to evaluate the paper's networks: a torch module a segment, maps in full, which the vertices then read.

It is what a first implementation does, Fig. 3 layer by layer in torch's operations; the suite's faster evaluation of
the same weights is compared with it.
"""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float

from replicate.approximation.cnn import MapNetwork
from replicate.approximation.deformation_map import sample
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.methods.method import Model


def plain_offsets(model: Model) -> Callable[[np.ndarray], np.ndarray] | None:
    """Return parameters (b, m) → offsets (b, n, 3) mm by the plain way; None for a model without deformation maps."""
    parts = [model.coarse, model.residual] if isinstance(model, RefinedModel) else [model]
    if not all(isinstance(part, SegmentedModel) and _has_maps(part) for part in parts):
        return None

    def offsets(params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        with torch.no_grad():
            return sum(_evaluate(part, torch.tensor(np.asarray(params, np.float32))) for part in parts).numpy()

    return offsets


def read_full_maps(network: MapNetwork, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
    """Return the offsets that vertices read from maps computed in full (Fig. 3), not yet in mm."""
    return sample(network.maps(params), network.pixels, network.shares)


def _has_maps(model: SegmentedModel) -> bool:
    return all(isinstance(network, MapNetwork) for network in model.networks)


def _evaluate(model: SegmentedModel, params: torch.Tensor) -> torch.Tensor:
    scaled = params / model.scale
    out = torch.zeros(len(params), model.vertex_count, 3)
    for network, segment, length in zip(model.networks, model.segments, model.lengths, strict=True):
        out[:, segment.vertices] = read_full_maps(network, scaled[:, segment.parameters]) * length
    return out
