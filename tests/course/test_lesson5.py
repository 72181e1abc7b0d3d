"""Lesson 5's checks: they accept the solutions, and say what is wrong with usual mistakes."""

import numpy as np
import pytest
import torch
from lesson_source import answers
from scipy.sparse.linalg import lsmr
from torch.nn.functional import interpolate, leaky_relu

from course.checks import Wrong
from course.checks.lesson5 import check_best_map, check_decode, check_sample, check_spread
from course.lesson5 import charts, fresh_dense, fresh_network, read_all, weights_of
from replicate.approximation.deformation_map import bilinear, sampling_matrix
from replicate.geometry.mesh import Mesh

SOLVED = answers("lesson5")
sample, spread, best_map, decode = (SOLVED[name] for name in ("sample", "spread", "best_map", "decode"))


@pytest.fixture(scope="module")
def parts():
    """Two charts: one with few vertices, one with more than a map of 16 pixels can hold."""
    generator = np.random.default_rng(1)
    return {"few": (np.arange(60), generator.uniform(0, 0.5, (60, 2))),
            "many": (np.arange(60, 660), generator.uniform(0, 1, (600, 2)))}  # fmt: skip


@pytest.fixture(scope="module")
def offsets():
    return np.random.default_rng(2).normal(0, 2, (660, 3))


def test_solutions_pass_and_say_how_near_they_are(parts, offsets, capsys):
    check_sample(sample, parts)
    check_spread(spread, sample, parts)
    check_best_map(best_map, sample, parts, offsets)
    check_decode(decode, sample, parts)
    assert capsys.readouterr().out.count("✓") == 4


def test_exercises_that_are_not_begun_say_so_themselves(parts, offsets):
    def stub(*arguments):
        raise NotImplementedError

    for check, others in (
        (check_sample, (parts,)),
        (check_spread, (sample, parts)),
        (check_best_map, (sample, parts, offsets)),
        (check_decode, (sample, parts)),
    ):
        with pytest.raises(NotImplementedError):
            check(stub, *others)


def nearest(image, uv):
    column, row = np.rint(uv * (len(image) - 1)).astype(int).T
    return image[row, column]


def by_size(image, uv):
    return sample(image, np.minimum(uv * len(image) / (len(image) - 1), 1))


def beyond_the_border(image, uv):
    place = uv * (len(image) - 1)
    column, row = np.floor(place).astype(int).T
    a, b = (place - np.floor(place)).T[..., None]
    upper = (1 - a) * image[row, column] + a * image[row, column + 1]
    lower = (1 - a) * image[row + 1, column] + a * image[row + 1, column + 1]
    return (1 - b) * upper + b * lower


def in_place(image, uv):
    uv *= 1.0 - 1e-3
    return sample(image, uv)


SAMPLES = {
    "sample is nothing": lambda image, uv: None,
    "expected an array of the shape": lambda image, uv: sample(image, uv)[..., 0],
    "changes its arguments": in_place,
    "u and v are swapped": lambda image, uv: sample(image, uv[:, ::-1]),
    "rows are flipped": lambda image, uv: sample(image[::-1], uv),
    "You take the nearest pixel": nearest,
    "multiply by size − 1": by_size,
    "you leave the map": beyond_the_border,
}


@pytest.mark.parametrize("sentence", SAMPLES)
def test_a_wrong_sample_is_told_what_is_wrong(sentence, parts):
    with pytest.raises(Wrong, match=sentence):
        check_sample(SAMPLES[sentence], parts)


def adds_once(values, uv, size):
    corner = np.clip(np.floor(uv * (size - 1)).astype(int), 0, size - 2)
    (c, r), (a, b) = corner.T, (uv * (size - 1) - corner).T[..., None]
    image = np.zeros((size, size, values.shape[1]))
    image[r, c] += (1 - a) * (1 - b) * values
    image[r, c + 1] += a * (1 - b) * values
    image[r + 1, c] += (1 - a) * b * values
    image[r + 1, c + 1] += a * b * values
    return image


def means(values, uv, size):
    return spread(values, uv, size) / np.maximum(spread(np.ones_like(values), uv, size), 1e-9)


SPREADS = {
    "spread is nothing": lambda values, uv, size: None,
    "Not all of a value arrives": means,
    "don't go where sample reads": lambda values, uv, size: spread(values, uv[:, ::-1], size)[::-1],
    "adds only once": adds_once,
    "one channel your image has the shape": lambda values, uv, size: spread(
        np.broadcast_to(values, (len(values), 3)), uv, size
    ),
}


@pytest.mark.parametrize("sentence", SPREADS)
def test_a_wrong_spread_is_told_what_is_wrong(sentence, parts):
    with pytest.raises(Wrong, match=sentence):
        check_spread(SPREADS[sentence], sample, parts)


MAPS = {
    "best_map is nothing": lambda offsets, uv, size: None,
    "pixels that no vertex reads are not zero": lambda offsets, uv, size: best_map(offsets, uv, size) + (
        spread(np.ones_like(offsets), uv, size) == 0
    ),
    "rows and columns exchanged": lambda offsets, uv, size: best_map(offsets, uv[:, ::-1], size),
    "the mean of what lands on it": means,
    "one solve for each of x, y and z": lambda offsets, uv, size: best_map(offsets, uv, size)[..., ::-1].copy(),
}  # fmt: skip


@pytest.mark.parametrize("sentence", MAPS)
def test_a_wrong_map_is_told_what_is_wrong(sentence, parts, offsets):
    if "exchanged" in sentence:  # such a map reads other pixels than it should, so all of them must be read
        parts = {"many": parts["many"]}
    with pytest.raises(Wrong, match=sentence):
        check_best_map(MAPS[sentence], sample, parts, offsets)


def solved_by(reshape=False, **changed):
    """Return a best map that calls lsmr with other options, or reshapes its solutions as they come."""

    def run(offsets, uv, size):
        matrix = sampling_matrix(bilinear(uv, size))
        options = {"damp": 1e-3, "atol": 1e-8, "btol": 1e-8, "maxiter": 400} | changed
        channels = [lsmr(matrix, one, **options)[0] for one in offsets.T]
        return np.stack(channels, axis=0 if reshape else 1).reshape(size, size, 3)

    return run


@pytest.mark.parametrize("changed", [{"maxiter": 30}, {"damp": 0.01}])
def test_a_map_that_is_not_solved_to_the_end_is_told_so(changed, parts, offsets):
    check_best_map(solved_by(), sample, parts, offsets)
    with pytest.raises(Wrong, match="the gradient is not zero there"):
        check_best_map(solved_by(**changed), sample, parts, offsets)


def test_channels_one_after_the_other_are_told_apart_from_a_missing_damp(parts, offsets):
    with pytest.raises(Wrong, match="one after the other"):
        check_best_map(solved_by(reshape=True), sample, parts, offsets)


def planted(fault):
    """Return a decoder with one mistake."""

    def run(net, params):
        slope = 0.01 if fault == "slope" else net.slope
        x = params
        for layer in net.dense[:-1]:
            x = leaky_relu(layer(x), slope)
        x = net.dense[-1](x)
        if fault == "bends the last dense layer":
            x = leaky_relu(x, slope)
        if fault == "reshapes to channels first":
            x = x.reshape(len(params), -1, 8, 8)
        else:
            x = x.reshape(len(params), 8, 8, -1).permute(0, 3, 1, 2)
        mode = "bilinear" if fault == "smooth" else "nearest"
        for layer in net.upsampled:
            x = layer(interpolate(x, scale_factor=2, mode=mode))
            x = x if fault == "linear" else leaky_relu(x, slope)
        x = net.last(x)
        x = net.output(x if fault == "linear" else leaky_relu(x, slope))
        x = leaky_relu(x, slope) if fault == "bends the output" else x
        return x if fault == "stays channels first" else x.permute(0, 2, 3, 1)

    return run


DECODERS = {
    "bends the last dense layer": "You bend the last dense layer",
    "reshapes to channels first": "You reshape to channels first",
    "bends the output": "You bend the offsets",
    "slope": "slope of 0.01",
    "smooth": "You upsample smoothly",
    "linear": "one linear function",
    "stays channels first": "permute them at the end",
}


@pytest.mark.parametrize("fault", DECODERS)
def test_a_wrong_decoder_is_told_what_is_wrong(fault, parts):
    with pytest.raises(Wrong, match=DECODERS[fault]):
        check_decode(planted(fault), sample, parts)


def test_a_decoder_that_returns_numpy_is_told_so(parts):
    with pytest.raises(Wrong, match="expected a tensor"):
        check_decode(lambda net, params: decode(net, params).numpy(), sample, parts)


def test_parts_are_all_that_deforms_and_other_vertices_keep_their_offsets():
    neutral = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9], [9, 0, 9], [0, 9, 9]], np.float32)
    uv = np.array([[0, 0], [1, 0], [0, 1]] * 2, np.float32)
    mesh = Mesh(neutral, np.array([[0, 1, 2], [3, 4, 5]]), uv, np.array([0, 0, 0, 1, 1, 1]), ("face", "tooth_upper_01"))
    parts = charts(mesh)
    assert list(parts) == ["face"] and parts["face"][0].tolist() == [0, 1, 2]
    offsets = np.arange(18.0).reshape(6, 3)
    held = read_all(lambda values, uv, size: np.zeros((size, size, 3)), sample, parts, offsets, 4)
    assert not held[:3].any() and (held[3:] == offsets[3:]).all()


def test_untrained_networks_share_their_hidden_layers_and_not_their_last():
    network = fresh_network(7, np.zeros((2, 2), np.float32))
    dense = fresh_dense(network)
    assert torch.equal(dense[0].weight, network.dense[0].weight)
    assert dense[-1].out_features == 3 * 32 * 32
    assert weights_of(network.output) == 16 * 3 + 3
