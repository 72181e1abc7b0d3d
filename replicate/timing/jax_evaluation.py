"""A trained model evaluated by JAX: its weights in functions that XLA compiles as one, the maps as Fig. 3 draws them.

XLA has no rigid step that float32 is enough for, so that this step is the suite's compiled one. How many threads XLA
has is fixed at start; `machine.one_core` keeps all of them on one core.
"""

from collections.abc import Callable, Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float
from torch import nn

from replicate.approximation.cnn import START, MapNetwork
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.rigid import Attachments
from replicate.baselines.dense import DenseNetwork
from replicate.baselines.line import Line, WithLine
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import Evaluate
from replicate.inference.rigid_step import place_rigid_segments, plan_rigid_step
from replicate.regional.model import RegionalModel
from replicate.regional.networks import SLOPE, GatedNetwork

if TYPE_CHECKING:
    import jax


class Traced(NamedTuple):
    """What JAX compiles. weights: nested lists of arrays. function: (weights, one pose's parameters) → an array."""

    weights: list
    function: "Callable[[list, jax.Array], jax.Array]"


def jax_evaluation(model: object, mesh: Mesh, attachments: Attachments | None) -> Evaluate | None:
    """Return parameters (1, m) → vertices (1, n, 3) float32 mm by JAX; None for a model of an unknown kind.

    attachments: None for no rigid step.
    """
    parts = traced_parts(model)
    if parts is None:
        return None
    import jax

    neutral = np.asarray(mesh.neutral, np.float32)

    def vertices(weights: list, params: "jax.Array") -> "jax.Array":
        neutral, *of_parts = weights
        return neutral + sum(part.function(w, params) for part, w in zip(parts, of_parts, strict=True))

    compiled = jax.jit(vertices)
    weights = jax.device_put([neutral, *(part.weights for part in parts)], jax.devices("cpu")[0])
    rigid = plan_rigid_step(mesh, attachments) if attachments else None

    def evaluate(params: Float[np.ndarray, "1 m"]) -> Float[np.ndarray, "1 n 3"]:
        out = np.array(compiled(weights, np.asarray(params[0], np.float32)))
        if rigid:
            place_rigid_segments(rigid, out)
        return out[None]

    return evaluate


@singledispatch
def traced_parts(model: object) -> list[Traced] | None:
    """Return the functions of a model, raw parameters (m,) → offsets (n, 3) mm, whose sum JAX compiles; or None."""
    return None


@traced_parts.register
def _(model: RefinedModel) -> list[Traced] | None:
    coarse, residual = traced_parts(model.coarse), traced_parts(model.residual)
    return coarse + residual if coarse and residual else None


@traced_parts.register
def _(model: SegmentedModel) -> list[Traced] | None:
    networks = [traced(network) for network in model.networks]
    if not all(networks):
        return None
    seen = [segment.parameters for segment in model.segments]
    lengths, place = model.lengths, _places(model.vertices, model.vertex_count)

    def offsets(weights: list, params: "jax.Array") -> "jax.Array":
        scale, *of_networks = weights
        scaled, parts = params / scale, zip(networks, of_networks, seen, lengths, strict=True)
        return _spread([network.function(w, scaled[j]) * length for network, w, j, length in parts], place)

    return [Traced([model.scale.cpu().numpy(), *(network.weights for network in networks)], offsets)]


@traced_parts.register
def _(model: RegionalModel) -> list[Traced]:
    networks = [traced(network) for network in model.network.networks]
    seen = [parameters.numpy() for parameters in model.network.seen]
    ends = np.cumsum([len(basis.steps) for basis in model.bases])[:-1]
    place, length = _places(model.vertices, model.vertex_count), model.length
    bases = [[basis.components().numpy(), basis.means().flatten().numpy()] for basis in model.bases]

    def offsets(weights: list, params: "jax.Array") -> "jax.Array":
        import jax.numpy as jnp

        scale, of_networks, stored = weights
        scaled, parts = params / scale, zip(networks, of_networks, seen, strict=True)
        coefficients = jnp.concatenate([network.function(w, scaled[j]) for network, w, j in parts])
        shares = jnp.split(coefficients * length, ends)
        rows = [(mean + c @ components).reshape(-1, 3) for c, (components, mean) in zip(shares, stored, strict=True)]
        return _spread([_summed(jnp.concatenate(rows), model.layers)], place)

    return [Traced([model.scale.numpy(), [network.weights for network in networks], bases], offsets)]


@singledispatch
def traced(network: nn.Module) -> Traced | None:
    """Return a network's function, scaled parameters (j,) → (k, 3) or (d,), for JAX; None for an unknown kind."""
    return None


@traced.register
def _(network: Line) -> Traced:
    return Traced(_arrays(network.weight, network.bias), lambda w, x: (x @ w[0] + w[1]).reshape(-1, 3))


@traced.register
def _(network: WithLine) -> Traced | None:
    parts = [traced(network.network), traced(network.line)]
    if not all(parts):
        return None
    return Traced(
        [part.weights for part in parts],
        lambda weights, x: sum(part.function(w, x) for part, w in zip(parts, weights, strict=True)),
    )


@traced.register
def _(network: DenseNetwork) -> Traced:
    layers = [*network.hidden, network.output]
    slopes = network.slopes
    return Traced(list(map(_transposed, layers)), lambda w, x: _layers(w, x, slopes).reshape(-1, 3))


@traced.register
def _(network: GatedNetwork) -> Traced:
    layers, gated = [_transposed(layer) for layer in (*network.layers, network.output)], network.is_gated
    line = [] if network.line is None else [network.line.weight.detach().numpy().T.copy()]
    lowest, highest = network.lowest.numpy(), network.highest.numpy()
    limits = [(least.numpy(), most.numpy()) for least, most in network.limits]

    def outputs(weights: list, params: "jax.Array") -> "jax.Array":
        import jax

        *hidden, (last, constant), lines = weights
        x = jax.numpy.clip(params, lowest, highest)
        for (weight, bias), (least, most) in zip(hidden, limits, strict=True):
            x = x @ weight + bias
            if gated:
                gate, value = x.reshape(2, -1)
                x = jax.nn.silu(gate) * value
            else:
                x = jax.nn.leaky_relu(x, SLOPE)
            x = jax.numpy.clip(x, least, most)
        return x @ last + constant + sum(params @ skip for skip in lines)

    return Traced([*layers, line], outputs)


@traced.register
def _(network: MapNetwork) -> Traced:
    dense = [_transposed(layer) for layer in network.dense]
    kernels = [
        [layer.weight.detach().numpy().transpose(2, 3, 1, 0).copy(), layer.bias.detach().numpy()]  # HWIO
        for layer in (*network.upsampled, network.last)
    ]
    output = [network.output.weight.detach().numpy()[:, :, 0, 0].T.copy(), network.output.bias.detach().numpy()]
    pixels, shares, slope = network.pixels.numpy(), network.shares.numpy(), network.slope
    slopes = (slope,) * (len(dense) - 1)

    def offsets(weights: list, params: "jax.Array") -> "jax.Array":
        import jax

        dense, kernels, (weight, bias), shares = weights
        x = _layers(dense, params, slopes).reshape(1, START, START, -1)
        for k, (kernel, constant) in enumerate(kernels):
            if k + 1 < len(kernels):  # the last convolution keeps the map's size
                x = x.repeat(2, axis=1).repeat(2, axis=2)
            x = jax.lax.conv_general_dilated(x, kernel, (1, 1), "SAME", dimension_numbers=("NHWC", "HWIO", "NHWC"))
            x = jax.nn.leaky_relu(x + constant, slope)
        maps = x.reshape(-1, x.shape[-1]) @ weight + bias  # (size², 3)
        return (maps[pixels] * shares[:, :, None]).sum(1)

    return Traced([dense, kernels, output, shares], offsets)


def _layers(weights: list, x: "jax.Array", slopes: Sequence[float]) -> "jax.Array":
    """Return the output of dense layers, of which all but the last are followed by a leaky ReLU of these slopes."""
    import jax

    for (weight, bias), slope in zip(weights[:-1], slopes, strict=True):
        x = jax.nn.leaky_relu(x @ weight + bias, slope)
    return x @ weights[-1][0] + weights[-1][1]


def _summed(rows: "jax.Array", layers: Sequence[np.ndarray]) -> "jax.Array":
    """Return the vertices' sums of the regions' rows (r, 3); layers: as `regional.model.coverings` returns them."""
    import jax.numpy as jnp

    total, *others = (rows[layer] for layer in layers)
    for more in others:
        total = jnp.concatenate([total[: len(more)] + more, total[len(more) :]])
    return total


def _spread(parts: "Sequence[jax.Array]", place: np.ndarray) -> "jax.Array":
    """Return the mesh's offsets (n, 3) from those of the segments, one after the other; place: as `_places` gives."""
    import jax.numpy as jnp

    return jnp.concatenate([*parts, jnp.zeros((1, 3), jnp.float32)])[place]


def _places(vertices: np.ndarray, count: int) -> np.ndarray:
    """Return each vertex's place among those of the segments; `len(vertices)` for a vertex of no segment."""
    place = np.full(count, len(vertices))
    place[vertices] = np.arange(len(vertices))
    return place


def _transposed(layer: nn.Linear) -> list[np.ndarray]:
    """Return a layer's weight [in, out] and bias."""
    weight, bias = _arrays(layer.weight, layer.bias)
    return [np.ascontiguousarray(weight.T), bias]


def _arrays(*tensors: "nn.Parameter") -> list[np.ndarray]:
    return [tensor.detach().cpu().numpy() for tensor in tensors]
