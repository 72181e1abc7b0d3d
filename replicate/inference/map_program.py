"""Plans of map networks in few flat arrays, read from front to back: what a compiled function is handed costs time.

Each array that crosses from Python takes Numba as long as a thousand multiplications, and a character's networks have
hundreds. Here they stand one behind the other, and `facts` says how much of each belongs to which.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from replicate.inference.map_plan import MapPlan
from replicate.inference.row_products import without_loss


class MapProgram(NamedTuple):
    """All networks' numbers in the order in which the evaluation uses them.

    facts: for each network how many parameters and dense layers, the layers' widths, the depth of the first image and
    its place in the scratch memory, how many convolutions; for each of these its image's place, how many parities and
    taps, and the ends of the parities' pixels; then how many vertices, and how far below a pixel its neighbour lies.
    weights: of dense layers, float32 or the bits of float16. numbers: for each network the dense layers' biases; of
    each convolution the taps and the bias; weight, bias and shares of the reading. places: for each network its
    parameters and starts; of each convolution offsets, sources and targets; pixels and vertices of the reading.
    slopes: of the networks. memory: how many numbers all images take, sums: the widest dense layer.
    """

    facts: np.ndarray
    weights: np.ndarray
    numbers: np.ndarray
    places: np.ndarray
    slopes: np.ndarray
    memory: int
    widest: int


def program_of(plans: Sequence[MapPlan], halves: bool = False) -> MapProgram:
    """Return the program of some networks. halves: dense layers are stored as float16, whatever that loses.

    Networks share images of the same size: a network reads no pixel that it has not written, but for the borders, and
    nobody writes those.
    """
    images: dict[tuple[int, int], int] = {}
    memory = 0
    for plan in plans:
        for image in enumerate(plan.sizes.tolist()):
            if image not in images:
                images[image], memory = memory, memory + image[1]
    weights = without_loss(np.concatenate([w.ravel() for plan in plans for w in plan.weights]), halves)
    return MapProgram(
        np.array([fact for plan in plans for fact in _facts(plan, images)], np.int64),
        weights,
        np.concatenate([part.ravel() for plan in plans for part in _numbers(plan)]).astype(np.float32),
        np.concatenate([part.ravel() for plan in plans for part in _places(plan)]).astype(np.int32),
        np.array([plan.slope for plan in plans], np.float32),
        memory,
        max(len(bias) for plan in plans for bias in plan.weight_biases),
    )


def _facts(plan: MapPlan, images: dict[tuple[int, int], int]) -> Iterator[int]:
    at = [images[image] for image in enumerate(plan.sizes.tolist())]
    yield from (len(plan.parameters), len(plan.weights), *(len(bias) for bias in plan.weight_biases))
    yield from (plan.depth, at[0], len(plan.taps))
    for place, offsets, ends in zip(at[1:], plan.offsets, plan.ends, strict=True):
        yield from (place, *offsets.shape, *ends.tolist())
    yield from (len(plan.vertices), plan.below)


def _numbers(plan: MapPlan) -> Iterator[np.ndarray]:
    yield from plan.weight_biases
    for taps, bias in zip(plan.taps, plan.biases, strict=True):
        yield from (taps, bias)
    yield from (plan.weight, plan.bias, plan.shares)


def _places(plan: MapPlan) -> Iterator[np.ndarray]:
    yield from (plan.parameters, plan.starts)
    for offsets, sources, targets in zip(plan.offsets, plan.sources, plan.targets, strict=True):
        yield from (offsets, sources, targets)
    yield from (plan.pixels, plan.vertices)
