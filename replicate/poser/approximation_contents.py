"""What a page carries of an approximation: our regional method's network and bases, or the paper's CNN."""

import copy
from functools import singledispatch

import numpy as np
import torch
from torch import nn

from replicate.approximation.cnn import START
from replicate.approximation.gated_network import SLOPE
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.regional_model import RegionalModel
from replicate.poser.pack import Parts, indices

OURS = "our regional method"
Approximation = RegionalModel | SegmentedModel | RefinedModel  # of those by segment, the ones with maps


def halved(network: nn.Module) -> nn.Module:
    """Return a network with its weights rounded to what 16 bits hold, as a page has them."""
    twin = copy.deepcopy(network)
    with torch.no_grad():
        for weight in twin.parameters():
            weight.copy_(weight.half().float())
    return twin


@singledispatch
def as_on_page(model: Approximation) -> Approximation:
    """Return a model with the weights that a page has of it."""
    raise TypeError(f"no page evaluates a {type(model).__name__}")


@as_on_page.register
def _(model: RegionalModel) -> RegionalModel:
    return model  # its weights are stored in 16 bits


@as_on_page.register
def _(model: SegmentedModel) -> SegmentedModel:
    return halved(model)


@as_on_page.register
def _(model: RefinedModel) -> RefinedModel:
    return RefinedModel(as_on_page(model.coarse), as_on_page(model.residual))


@singledispatch
def approximation_contents(model: Approximation) -> Parts:
    """Return what a page needs to evaluate a model that `as_on_page` returned."""
    raise TypeError(f"no page evaluates a {type(model).__name__}")


@approximation_contents.register
def _(model: RegionalModel) -> Parts:
    arrays, networks = {"regional.scale": model.scale.numpy()}, model.network.networks
    for k, (network, seen) in enumerate(zip(networks, model.network.seen, strict=True)):
        arrays |= layers(f"regional.{k}", [*network.layers, network.output])
        arrays[f"regional.{k}.seen"] = indices(seen.numpy(), len(model.scale))
        arrays |= {f"regional.{k}.{name}": half(getattr(network, name)) for name in ("lowest", "highest")}
        for i, ends in enumerate(network.limits):
            arrays |= {f"regional.{k}.{i}.{name}": half(end) for name, end in zip(("least", "most"), ends, strict=True)}
        if network.line is not None:
            arrays[f"regional.{k}.line"] = half(network.line.weight)
    for k, basis in enumerate(model.bases):
        arrays[f"basis.{k}.vertices"] = indices(basis.vertices.numpy(), model.vertex_count)
        for name in ("weights", "mean", "fine", "rough", "steps"):
            arrays[f"basis.{k}.{name}"] = getattr(basis, name).numpy()
    shape = {"layers": len(networks[0].layers) + 1, "gated": networks[0].is_gated, "slope": SLOPE}
    counts = {"networks": len(networks), "regions": len(model.bases)}
    words = {**shape, **counts, "length_mm": model.length}
    return {"approximation": OURS, "regional": words}, arrays


@approximation_contents.register
def _(model: SegmentedModel) -> Parts:
    return _maps("the coarse CNN of the paper", [model])


@approximation_contents.register
def _(model: RefinedModel) -> Parts:
    return _maps("the refined CNN of the paper", [model.coarse, model.residual])


def _maps(title: str, models: list[SegmentedModel]) -> Parts:
    """Return the networks of some models with maps, whose offsets are added."""
    words, arrays = [], {"maps.scale": models[0].scale.numpy()}
    for model in models:
        for network, segment, length in zip(model.networks, model.segments, model.lengths, strict=True):
            prefix = f"maps.{len(words)}"
            convolutions = [*network.upsampled, network.last]
            arrays |= layers(f"{prefix}.dense", network.dense) | layers(f"{prefix}.convolution", convolutions)
            arrays |= {
                f"{prefix}.output.weight": half(network.output.weight[:, :, 0, 0]),
                f"{prefix}.output.bias": half(network.output.bias),
                f"{prefix}.uv": np.asarray(segment.uv, np.float32),
                f"{prefix}.vertices": indices(segment.vertices, model.vertex_count),
                f"{prefix}.parameters": indices(segment.parameters, len(model.scale)),
            }
            sizes = {"size": network.map_size, "start": START, "channels": network.last.out_channels}
            depths = {"dense": len(network.dense), "convolutions": len(convolutions)}
            words.append({**sizes, **depths, "slope": network.slope, "length_mm": length})
    return {"approximation": title, "maps": words}, arrays


def layers(prefix: str, modules: "nn.ModuleList | list[nn.Module]") -> dict[str, np.ndarray]:
    """Return weights (outputs, inputs, …) and biases of layers in 16 bits."""
    arrays = {}
    for i, layer in enumerate(modules):
        arrays[f"{prefix}.{i}.weight"] = half(layer.weight)
        arrays[f"{prefix}.{i}.bias"] = half(layer.bias)
    return arrays


def half(weight: torch.Tensor) -> np.ndarray:
    """Return weights as float16."""
    return weight.detach().cpu().numpy().astype(np.float16)
