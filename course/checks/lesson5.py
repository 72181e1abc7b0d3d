"""What lesson 5 asks for: bilinear sampling, its adjoint, the best map, and a decoder."""

from collections.abc import Callable

import numpy as np
import torch
from torch.nn import functional

from course.checks import passed, require, require_kept
from course.lesson5 import Charts, fresh_network
from replicate.approximation import deformation_map
from replicate.approximation.cnn import START, MapNetwork
from replicate.approximation.deformation_map import RIDGE, Projection, bilinear, sampling_matrix

NEAR = 1e-5  # the suite's weights are in single precision
NEAR_FLOOR = 1.05  # of the suite's floor, plus this many mm:
NEAR_FLOOR_MM = 0.005
FLAT = 3e-5  # of the gradient at zero; lsmr as in the lesson leaves 1e-6 or less, 10 iterations leave 6e-3


def check_sample(sample: Callable, parts: Charts) -> None:
    """Require bilinear sampling: exact at pixels and for planes, up to the border, and equal to the suite's."""
    generator = np.random.default_rng(5)
    size = 6
    image, uv = generator.normal(0, 3, (size, size, 3)), generator.uniform(0, 1, (40, 2))
    before = [image.copy(), uv.copy()]
    found = _array(sample(image, uv), (40, 3), "sample")
    require_kept((image, uv), before)
    row, column = 1, 4
    pixel = np.array([[column, row]]) / (size - 1)
    at_pixel = _array(sample(image, pixel), (1, 3), "sample")[0]
    require(
        np.abs(at_pixel - image[column, row]).max() > NEAR,
        "Your u and v are swapped: u goes along a row, so it chooses the column; v chooses the row.",
    )
    require(
        np.abs(at_pixel - image[size - 1 - row, column]).max() > NEAR,
        "Your rows are flipped: row 0 is v = 0, the bottom of the pictures, and v grows with the row.",
    )
    ticks = np.linspace(0, 1, size)
    plane = (2 * ticks[None, :] - 3 * ticks[:, None] + 1)[..., None].repeat(3, 2)
    flat = _array(sample(plane, uv), (40, 3), "sample")
    exact = 2 * uv[:, :1] - 3 * uv[:, 1:] + 1
    corner = np.rint(uv * (size - 1)).astype(int)
    require(
        np.abs(flat - plane[corner[:, 1], corner[:, 0]]).max() > NEAR,
        "You take the nearest pixel: blend the four around, by how near the point is to each.",
    )
    require(
        np.abs(at_pixel - image[row, column]).max() < NEAR,
        f"At the place of pixel ({row}, {column}) you don't read that pixel: it sits at u = {column}/{size - 1}, so "
        "multiply by size − 1, not by size.",
    )
    off = float(np.abs(flat - exact).max())
    require(off < NEAR, f"A map that is a plane comes back {off:.2g} off: do your four weights sum to 1?")
    border = np.array([[1.0, 1.0], [1.0, 0.3], [0.0, 1.0]])
    try:
        at_border = _array(sample(image, border), (3, 3), "sample")
    except IndexError:
        at_border = None
    require(
        at_border is not None and np.abs(at_border[0] - image[-1, -1]).max() < NEAR,
        "At u = 1 or v = 1 you leave the map: the first of the four pixels is in row and column size − 2 at most.",
    )
    off = float(np.abs(found - _suites_sample(image, uv)).max())
    require(off < NEAR, f"Your values are {off:.2g} off the suite's: which weight belongs to which of the four pixels?")
    most = 0.0
    for _, places in parts.values():
        image = generator.normal(0, 3, (32, 32, 3))
        ours = _array(sample(image, places), (len(places), 3), "sample")
        most = max(most, float(np.abs(ours - _suites_sample(image, places)).max()))
    require(most < NEAR * 10, f"In the teen's charts your values are up to {most:.2g} off the suite's.")
    passed(f"your sampling keeps planes, and equals the suite's within {most:.0e} in {len(parts)} charts of the teen")


def _suites_sample(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    grid = bilinear(uv, len(image))
    arguments = (torch.from_numpy(a) for a in (image[None].astype(np.float32), grid.pixels, grid.weights))
    return deformation_map.sample(*arguments)[0].numpy()


def check_spread(spread: Callable, sample: Callable, parts: Charts) -> None:
    """Require the adjoint of sampling: ⟨G I, y⟩ = ⟨I, Gᵀ y⟩."""
    generator = np.random.default_rng(6)
    size = 5
    alone = np.array([[0.05, 0.05], [0.55, 0.55]])  # no pixel is read by both
    crowd = generator.uniform(0, 1, (60, 2))
    values = generator.normal(0, 2, (60, 3))
    before = [values.copy(), crowd.copy()]
    found = _array(spread(values, crowd, size), (size, size, 3), "spread")
    require_kept((values, crowd), before)
    one = spread(values[:, :1], crowd, size)
    require(
        np.shape(one) == (size, size, 1),
        f"With values of one channel your image has the shape {np.shape(one)}: make as many channels as values has.",
    )

    def gap(uv: np.ndarray, y: np.ndarray) -> float:
        image = generator.normal(0, 2, (size, size, 3))
        read, back = np.vdot(sample(image, uv), y), np.vdot(image, spread(y, uv, size))
        return float(abs(read - back) / np.abs(y).sum())

    require(
        np.abs(spread(values[:2], alone, size).sum((0, 1)) - values[:2].sum(0)).max() < NEAR,
        "Not all of a value arrives: a vertex gives to its four pixels by the weights it reads with, whose sum is 1.",
    )
    require(
        gap(alone, values[:2]) < NEAR,
        "Your shares don't go where sample reads: use the same four pixels with the same weights.",
    )
    require(
        np.abs(found.sum((0, 1)) - values.sum(0)).max() < NEAR * 100,
        "Where several vertices share a pixel, something is lost: `image[r, c] += y` adds only once for each pixel; "
        "use np.add.at.",
    )
    off = gap(crowd, values)
    require(off < NEAR, f"⟨G I, y⟩ and ⟨I, Gᵀ y⟩ differ by {off:.2g}: spread is not the adjoint of your sample.")
    most = 0.0
    for _, uv in parts.values():
        y = generator.normal(0, 2, (len(uv), 3))
        theirs = (sampling_matrix(bilinear(uv, 16)).T @ y).reshape(16, 16, 3)
        most = max(most, float(np.abs(spread(y, uv, 16) - theirs).max() / np.abs(theirs).max()))
    require(most < NEAR, f"In the teen's charts yours is {most:.2g} off the suite's transposed matrix.")
    passed(f"your spread is the adjoint of your sample: ⟨G I, y⟩ = ⟨I, Gᵀ y⟩ within {max(off, 1e-16):.0e}")


def check_best_map(best_map: Callable, sample: Callable, parts: Charts, offsets: np.ndarray) -> None:
    """Require maps that lose as little as the suite's by least squares; offsets: (n, 3) mm of one pose."""
    size, lost, floors, means, steepest = 16, 0.0, 0.0, 0.0, 0.0
    for name, (vertices, uv) in parts.items():
        truth = offsets[vertices].astype(float)
        before = [truth.copy(), uv.copy()]
        image = _array(best_map(truth, uv, size), (size, size, 3), "best_map")
        require_kept((truth, uv), before)
        grid = bilinear(uv, size)
        matrix = sampling_matrix(grid)
        mixed = image.reshape(3, size, size).transpose(1, 2, 0)
        require(
            _miss(sample(mixed, uv), truth) >= 0.5 * _miss(sample(image, uv), truth),
            "Your map holds x, y and z one after the other: stack the three solutions along the last axis, and then "
            "reshape.",
        )
        unread = np.setdiff1d(np.arange(size**2), grid.pixels)
        require(
            np.abs(image.reshape(-1, 3)[unread]).sum() < 1e-3,
            f"In {name} pixels that no vertex reads are not zero: start from zeros and give lsmr its damp.",
        )
        lost += _miss(sample(image, uv), truth)
        floors += _miss(Projection(uv, size)(truth[None])[0], truth)
        slope = matrix.T @ (matrix @ image.reshape(-1, 3) - truth) + RIDGE * image.reshape(-1, 3)
        steepest = max(steepest, float(np.linalg.norm(slope) / np.linalg.norm(matrix.T @ truth)))
        mean = (matrix.T @ truth) / np.maximum(matrix.T @ np.ones((len(uv), 1)), RIDGE)
        means += _miss(matrix @ mean, truth)
        swapped = sample(image.swapaxes(0, 1), uv)
        require(
            _miss(swapped, truth) > 0.5 * _miss(sample(image, uv), truth),
            "Your map holds the face with rows and columns exchanged: rows come first, as reshape has it.",
        )
    count = sum(len(vertices) for vertices, _ in parts.values())
    lost, floors, means = lost / count, floors / count, means / count
    require(
        abs(lost - means) > 0.02 * means,
        f"You give each pixel the mean of what lands on it and lose {lost:.3f} mm, the best maps lose {floors:.3f} mm: "
        "means blur, because vertices read four pixels at once. Let lsmr solve.",
    )
    require(
        lost < NEAR_FLOOR * floors + NEAR_FLOOR_MM,
        f"Your maps lose {lost:.3f} mm, the best ones {floors:.3f} mm: one solve for each of x, y and z, with "
        "the damp and the iterations above, and then is everything back in its place?",
    )
    require(
        steepest < FLAT,
        f"Your maps are near the best ones, but the gradient is not zero there ({steepest:.0e} of its size at zero): "
        "give lsmr damp=1e-3, which is √λ, the small tolerances, and 400 iterations.",
    )
    passed(f"your {size}×{size} maps lose {lost:.3f} mm on average, the suite's floor is {floors:.3f} mm")


def _miss(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.linalg.norm(found - truth, axis=1).sum())


# Usual mistakes in a decoder, and what to say of each.
FAULTS = {
    "last dense": "You bend the last dense layer's output, too: there is no leaky ReLU between it and the reshaping.",
    "channels first": "You reshape to channels first: the 512 numbers are 8 rows, 8 columns, 8 channels; permute then.",
    "output": "You bend the offsets: nothing follows the last 1×1 convolution, for offsets may be negative.",
    "smooth": 'You upsample smoothly; Fig. 3 repeats each pixel (mode="nearest") and lets the convolution smooth.',
    "slope": "Your leaky ReLU has PyTorch's slope of 0.01; the network's is net.slope.",
    "no activation": "Your convolutions are not followed by a leaky ReLU: so they are one linear function.",
    "hidden": "Your first dense layer is not followed by a leaky ReLU.",
}


def check_decode(decode: Callable, sample: Callable, parts: Charts) -> None:
    """Require the maps of the suite's network, layer by layer as in Fig. 3."""
    uv = next(iter(parts.values()))[1]
    network = fresh_network(12, uv.astype(np.float32))
    params = torch.from_numpy(np.random.default_rng(5).normal(0, 3, (4, 12)).astype(np.float32))
    before = params.clone()
    with torch.no_grad():
        found, theirs = decode(network, params), network.maps(params)
        require(found is not None, "decode is nothing: is there a return at its end?")
        require(isinstance(found, torch.Tensor), f"decode: expected a tensor of PyTorch, got {type(found).__name__}.")
        require(bool((params == before).all()), "Your function changes its arguments; make new tensors.")
        require(
            found.shape != theirs.permute(0, 3, 1, 2).shape,
            "Your maps have their channels first, as convolutions want them: permute them at the end.",
        )
        require(
            found.shape == theirs.shape,
            f"decode: expected maps of the shape {tuple(theirs.shape)}, got {tuple(found.shape)}.",
        )
        scale = float(theirs.abs().max())
        for fault, sentence in FAULTS.items():
            require(float((found - _decoded(network, params, fault)).abs().max()) > NEAR * scale, sentence)
        off = float((found - theirs).abs().max()) / scale
        require(off < NEAR, f"Your maps are {off:.2g} off the network's: follow the list layer by layer.")
        read = np.stack([sample(image, uv) for image in found.numpy()])
        most = float(np.abs(read - network(params).numpy()).max()) / scale
    require(most < NEAR * 10, f"Your sample of your maps is {most:.2g} off what the suite's network says.")
    passed(
        f"your maps equal the network's; read by your sample, they are what the suite trains, within {most:.0e}: it "
        "computes the same in another order"
    )


def _decoded(network: MapNetwork, params: torch.Tensor, fault: str) -> torch.Tensor:
    """Return the network's maps with one mistake in them."""

    def bend(x: torch.Tensor, where: str = "") -> torch.Tensor:
        return x if fault == where else functional.leaky_relu(x, 0.01 if fault == "slope" else network.slope)

    x = params
    for layer in network.dense[:-1]:
        x = bend(layer(x), "hidden")
    x = network.dense[-1](x)
    x = bend(x) if fault == "last dense" else x
    first = fault == "channels first"
    x = x.view(len(x), -1, START, START) if first else x.view(len(x), START, START, -1).permute(0, 3, 1, 2)
    for layer in network.upsampled:
        x = functional.interpolate(x, scale_factor=2, mode="bilinear" if fault == "smooth" else "nearest")
        x = bend(layer(x), "no activation")
    x = network.output(bend(network.last(x), "no activation"))
    return (bend(x) if fault == "output" else x).permute(0, 2, 3, 1)


def _array(found: object, shape: tuple[int, ...], name: str) -> np.ndarray:
    require(found is not None, f"{name} is nothing: is there a return at the function's end?")
    array = np.asarray(found)
    require(
        array.shape == shape and array.dtype.kind == "f",
        f"{name}: expected an array of the shape {shape}, got {array.shape} of {array.dtype}.",
    )
    require(np.isfinite(array).all(), f"{name} has a value that is no finite number.")
    return array
