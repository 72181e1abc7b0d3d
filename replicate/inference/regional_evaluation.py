"""Our regional model for one pose at a time on one thread: weights and bases are read once, in the bytes stored."""

from collections.abc import Callable
from typing import NamedTuple, no_type_check

import numpy as np
import torch
from jaxtyping import Float32
from llvmlite import ir
from numba import njit, types
from numba.core.typing.templates import Signature

from replicate.base.jit_cache import kept
from replicate.inference.products import (
    BLOCK,
    NOTHING,
    Work,
    add_pairs,
    add_products,
    in_pairs,
    of_layers,
    total,
    without_loss,
)
from replicate.kernels.vector_code import twin_of
from replicate.regional.model import RegionalModel
from replicate.regional.networks import SLOPE


class RegionalPlan(NamedTuple):
    """A regional model in flat arrays: m parameters, g networks of l hidden layers, r regions with k vertices in all.

    scale: (m,), what parameters are divided by.
    widths: (g, l + 2), of each network's input, hidden layers and output.
    seen: the parameters that each network sees, one network after the other.
    lowest, highest: the bounds of these for the layers.
    least, most: the bounds of what the hidden layers give.
    weights: each network's layers, [in, out], and its line.
    biases: of the layers.
    gated, line: whether layers are gated, and whether there are lines.
    steps: (Σ c,), the mm of a component's whole number 1, with the coefficients' length folded in.
    fine: the components in 16 bits, [component, coordinate], region by region.
    rough: those in 8 bits, as `in_pairs` stores them.
    regions: (r, 5), counts of vertices, of those that no earlier region has, of components in 16 and in 8 bits; and the
        region's first coefficient.
    vertices: (k,), region by region, in each first those that no earlier region has.
    vertex_weights: (k,), their weights in the region.
    places: (u, 3), where each moved vertex is at rest, with its regions' means, mm.
    """

    scale: np.ndarray
    widths: np.ndarray
    seen: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    least: np.ndarray
    most: np.ndarray
    weights: np.ndarray
    biases: np.ndarray
    gated: bool
    line: bool
    steps: np.ndarray
    fine: np.ndarray
    rough: np.ndarray
    regions: np.ndarray
    vertices: np.ndarray
    vertex_weights: np.ndarray
    places: np.ndarray


def plan_regions(model: RegionalModel, neutral: Float32[np.ndarray, "n 3"]) -> RegionalPlan:
    """Return the plan of a model on a mesh."""
    networks, widths, matrices, biases = model.network.networks, [], [], []
    for network in networks:
        layers = [*network.layers, network.output]
        widths.append([*(layer.in_features for layer in layers), network.output.out_features])
        biases += [layer.bias.detach().numpy() for layer in layers]
        lines = [] if network.line is None else [network.line]
        matrices += [layer.weight.detach().numpy().T for layer in (*layers, *lines)]
    places, known = neutral.astype(np.float64), np.zeros(len(neutral), bool)
    regions, orders, first = [], [], 0
    for basis in model.bases:
        vertices = basis.vertices.numpy()
        again = known[vertices]
        regions.append((len(vertices), int((~again).sum()), len(basis.fine), len(basis.rough), first))
        orders.append(np.argsort(again, kind="stable"))
        places[vertices] += basis.means().numpy()
        known[vertices] = True
        first += len(basis.steps)
    ordered = list(zip(model.bases, orders, strict=True))
    vertices = [basis.vertices.numpy()[order] for basis, order in ordered]
    moving = np.concatenate([indices[:new] for indices, (_, new, *_) in zip(vertices, regions, strict=True)])
    return RegionalPlan(
        model.scale.numpy(),
        np.array(widths, np.int64),
        np.concatenate([seen.numpy() for seen in model.network.seen]),
        np.concatenate([network.lowest.numpy() for network in networks]),
        np.concatenate([network.highest.numpy() for network in networks]),
        np.concatenate([least.numpy() for network in networks for least, _ in network.limits]),
        np.concatenate([most.numpy() for network in networks for _, most in network.limits]),
        without_loss(np.concatenate([matrix.ravel() for matrix in matrices])),
        np.concatenate(biases),
        networks[0].is_gated,
        networks[0].line is not None,
        np.concatenate([basis.steps.numpy() for basis in model.bases]) * np.float32(model.length),
        np.concatenate([_in_order(basis.fine, order).ravel() for basis, order in ordered]),
        np.concatenate([in_pairs(_in_order(basis.rough, order)) for basis, order in ordered]),
        np.array(regions, np.int64),
        np.concatenate(vertices).astype(np.int64),
        np.concatenate([basis.weights.numpy()[order] for basis, order in ordered]),
        places[moving].astype(np.float32),
    )


def _in_order(components: torch.Tensor, order: np.ndarray) -> np.ndarray:
    """Return the components (k, v, 3) of a region as (k, 3 v), its vertices reordered."""
    return components.numpy()[:, order].reshape(len(components), 3 * len(order))


@njit(inline="always")
@no_type_check
def _within(value, least, most):
    """Return a value clipped to two bounds; NaN stays NaN."""
    return least if value < least else most if value > most else value


@kept
@njit(error_model="numpy", nogil=True, fastmath={"afn", "contract"})
@no_type_check
def _activate(values, gated):
    """Write a layer's outputs over the sums in `values`, from the front; return how many there are."""
    if not gated:
        for k in range(len(values)):
            values[k] = max(values[k], np.float32(SLOPE) * values[k])
        return len(values)
    half = len(values) // 2
    gates, inner = values[:half], values[half:]
    for k in range(half):
        gate = gates[k]
        gates[k] = gate / (np.float32(1) + exponential(-gate)) * inner[k]
    return half


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def _keep_within(values, least, most):
    """Clip values to bounds; the compiler does several at once."""
    for k in range(len(values)):
        values[k] = _within(values[k], least[k], most[k])


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def place_regions(
    plan: RegionalPlan, params: np.ndarray, sums: np.ndarray, moved: np.ndarray, rows: np.ndarray, pairs: np.ndarray,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Write the vertices of all regions (mm) for raw rig parameters (m,) to `out` (n, 3).

    plan: of the model.
    params: (m,), raw rig parameters.
    sums: scratch, (5, widest): two rows for layers, one for a network's inputs, one for these within their bounds, and
        one for all coefficients.
    moved: scratch for the largest region.
    rows: scratch for the indices of the widest input.
    pairs: scratch of `add_pairs`.
    out: (n, 3), mm, where the vertices are written to.
    """
    coefficients = sums[4, : len(plan.steps)]
    first, bias, sees, limit, done = NOTHING, NOTHING, NOTHING, NOTHING, NOTHING
    layers = plan.widths.shape[1] - 1
    # the networks, each of which gives the coefficients of whole regions
    for network in range(len(plan.widths)):
        widths = plan.widths[network]
        scaled, x = sums[2, : widths[0]], sums[3, : widths[0]]
        for k in range(widths[0]):
            j = plan.seen[sees + k]
            scaled[k] = params[j] / plan.scale[j]
            x[k] = _within(scaled[k], plan.lowest[sees + k], plan.highest[sees + k])
        for layer in range(layers):
            inputs = widths[layer]
            last = layer + 1 == layers
            width = widths[layer + 1] * (2 if plan.gated and not last else 1)
            y = coefficients[done : done + width] if last else sums[layer % 2, :width]
            y[:] = plan.biases[bias : bias + width]
            add_products(x[:inputs], plan.weights, first, width, y, rows)
            first, bias = first + inputs * width, bias + width
            if last and plan.line:
                add_products(scaled, plan.weights, first, width, y, rows)
                first += widths[0] * width
            if not last:
                x = y[: _activate(y, plan.gated)]
                _keep_within(x, plan.least[limit : limit + len(x)], plan.most[limit : limit + len(x)])
                limit = limit + len(x)
        sees, done = sees + widths[0], done + widths[layers]
    for k in range(len(coefficients)):
        coefficients[k] *= plan.steps[k]
    # the regions: a vertex is placed by the first that has it, and moved by the others
    start, place, fine, rough = NOTHING, NOTHING, NOTHING, NOTHING
    for count, new, fines, roughs, c in plan.regions:
        y = moved[: 3 * count]
        y[:] = 0
        add_products(coefficients[c : c + fines], plan.fine, fine, 3 * count, y, rows)
        rough = add_pairs(coefficients[c + fines : c + fines + roughs], plan.rough, rough, 3 * count, y, pairs)
        for k in range(new):
            vertex, weight = plan.vertices[start + k], plan.vertex_weights[start + k]
            for axis in range(3):
                out[vertex, axis] = plan.places[place + k, axis] + weight * y[3 * k + axis]
        for k in range(new, count):
            vertex, weight = plan.vertices[start + k], plan.vertex_weights[start + k]
            for axis in range(3):
                out[vertex, axis] += weight * y[3 * k + axis]
        start, place = start + count, place + new
        fine += 3 * count * fines


class FastRegions:
    """A regional model on a mesh, one pose at a time."""

    def __init__(self, model: RegionalModel, neutral: Float32[np.ndarray, "n 3"]):
        self.plan = plan_regions(model, neutral)
        widest = int(max(len(self.plan.steps), 2 * self.plan.widths.max()))
        self._sums = np.zeros((5, widest), np.float32)
        self._moved = np.zeros(3 * int(self.plan.regions[:, 0].max()), np.float32)
        self._rows = np.zeros(widest, np.int64)
        self._pairs = np.zeros(BLOCK + (int(self.plan.regions[:, 3].max()) + 1) // 2, np.int32)

    def place(self, params: Float32[np.ndarray, " m"], out: Float32[np.ndarray, "n 3"]) -> None:
        """Write the vertices of all regions, mm, for raw rig parameters to `out`."""
        place_regions(self.plan, params, self._sums, self._moved, self._rows, self._pairs, out)

    def work(self, params: Float32[np.ndarray, " m"]) -> Work:
        """Return what a pose, given as raw rig parameters, costs."""
        plan, size, first = self.plan, self.plan.weights.itemsize, 0
        counts, _, fines, roughs, _ = plan.regions.T
        parts = [Work(int((3 * counts * (fines + roughs)).sum()), plan.fine.nbytes + plan.rough.nbytes)]
        parts.append(Work(3 * len(plan.vertices), plan.vertex_weights.nbytes))
        for inputs, *hidden, outputs in plan.widths.tolist():
            seen, first = params[plan.seen[first : first + inputs]], first + inputs
            made = [(1 + plan.gated) * width for width in hidden]  # gates and values
            products = sum(a * b for a, b in zip(hidden, (*made[1:], outputs), strict=True))
            parts += [of_layers(seen, made[:1], size), Work(products, size * products)]
            parts += [of_layers(seen, (outputs,), size)] if plan.line else []
        return total(parts)


# e to the power of a float32 in plain arithmetic, which the compiler turns into vector instructions.

LOG2_E = np.float32(np.log2(np.e))
LARGEST = np.float32(126)  # powers of 2 beyond ± this are taken for it, near the ends of float32
BIAS, MANTISSA = np.int32(127), np.int32(23)  # of float32's exponent, and the number of bits below it
# 2^f for f within ± 1/2, by powers of f: Chebyshev's fit of degree 5, off by 8e-8 of the value at most.
C0, C1, C2, C3, C4, C5 = (
    np.float32(c) for c in (1.00000007, 0.69314695, 0.24022122, 0.05550743, 0.00967546, 0.00132670)
)


@no_type_check
def from_bits_plain(value: int) -> np.float32:
    """Return the float32 whose bits an int32 has, if it is a power of two."""
    return np.float32(2.0 ** ((value >> MANTISSA) - BIAS))


@twin_of(from_bits_plain)
def _from_bits(typing: object, value: types.Type) -> tuple[Signature, Callable]:
    """Return the float32 whose bits an int32 has."""

    def generate(context, builder, signature, args):
        return builder.bitcast(args[0], ir.FloatType())

    return types.float32(types.int32), generate


@njit(inline="always")
@no_type_check
def exponential(x: np.float32) -> np.float32:
    """Return e^x of a float32, to 4e-6 of its value, near zero to 4e-7; beyond ± 87 it is e^± 87."""
    power = min(max(x * LOG2_E, -LARGEST), LARGEST)
    whole = np.floor(power + np.float32(0.5))
    f = power - whole
    fraction = C0 + f * (C1 + f * (C2 + f * (C3 + f * (C4 + f * C5))))
    return fraction * _from_bits((np.int32(whole) + BIAS) << MANTISSA)
