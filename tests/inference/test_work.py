"""What the fast evaluation says that it does, counted by hand."""

import numpy as np
from untrained_models import MESH, MODELS, SEGMENTS

from replicate.inference.fast_evaluation import placing_of
from replicate.inference.products import Work, has_halves, of_layers

NOTHING, ALL = np.zeros(12, np.float32), np.ones(12, np.float32)
VERTICES = [len(segment.vertices) for segment in SEGMENTS]
SEEN = [len(segment.parameters) for segment in SEGMENTS]


def test_rows_of_zeros_cost_nothing_in_the_first_layer_alone():
    assert of_layers(np.array([1.0, 0.0, 2.0]), (10, 4), 2) == Work(20 + 40, 2 * (20 + 40))


def test_dense_networks_multiply_every_weight_once():
    placing = placing_of(MODELS["dense"](), MESH)
    hidden = sum(16 * 16 + 16 * 3 * count for count in VERTICES)
    first = sum(16 * count for count in SEEN)
    assert placing.work(ALL) == Work(first + hidden, 4 * (first + hidden))
    assert placing.work(NOTHING).multiplications == hidden


def test_lines_read_what_the_parameters_in_use_need():
    placing = placing_of(MODELS["linear"](), MESH, halves=True)
    one = np.zeros(12, np.float32)
    one[SEGMENTS[1].parameters[-1]] = 1
    assert placing.work(NOTHING) == Work(0, 0)
    assert placing.work(one) == Work(3 * VERTICES[1], (2 if has_halves() else 4) * 3 * VERTICES[1])


def test_bases_and_line_of_the_regional_model_count():
    model = MODELS["regional"]()
    work = placing_of(model, MESH).work(np.ones(len(model.scale), np.float32))
    assert work.multiplications == model.multiplications()
    assert work.read_bytes < 4 * work.multiplications


def test_maps_count_the_pixels_that_are_computed():
    model = MODELS["coarse"]()
    placing = placing_of(model, MESH)
    dense = sum(32 * count + 32 * 64 * 4 for count in SEEN)
    reading = sum(7 * 16 * count for count in VERTICES)
    convolutions = placing.work(ALL).multiplications - dense - reading
    most = 2 * (16**2 * 4 * 4 * 16 + 16**2 * 9 * 16 * 16)
    assert 0.3 * most < convolutions <= most
    assert placing.work(ALL).multiplications - placing.work(NOTHING).multiplications == 32 * sum(SEEN)
