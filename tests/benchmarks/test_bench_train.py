"""The ways to take a training step: all give the same loss and gradients, and each is timed on the same batches."""

import numpy as np
import pytest
import torch
from small_face import small_influence, small_mesh, small_samples

from replicate.approximation import cnn
from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.losses import Supervision
from replicate.approximation.model import fresh_model
from replicate.approximation.segments import coarse_segments, segment_vertices
from replicate.baselines import dense
from replicate.benchmarks.bench_train import LABELS, OURS, PLAIN, steps_table, time_steps, ways_of
from replicate.config import CoarseConfig, DenseConfig
from replicate.report.results import Row


def model_and_supervision(module, section):
    mesh, samples = small_mesh(), small_samples(small_mesh(), 60)
    segments = coarse_segments(mesh, {2}, small_influence(mesh))
    networks = [module.make_network(segment, module.shape_facts(section)) for segment in segments]
    supervision = Supervision(mesh, samples, segment_vertices(segments), 5.0, torch.device("cpu"))
    model = fresh_model(networks, segments, parameter_scale(samples.params), supervision.statistics()[1], section, 0)
    with torch.no_grad():
        for name, weight in model.named_parameters():
            if name.endswith("bias"):
                weight.uniform_(-0.1, 0.1)
    return model, supervision


@pytest.mark.parametrize("module, section", [(cnn, CoarseConfig()), (dense, DenseConfig(hidden=(16,)))])
def test_all_ways_have_the_same_loss_and_gradients(module, section):
    model, supervision = model_and_supervision(module, section)
    params, target = supervision.batch(0, "bench", 0, section.training)
    losses, gradients = {}, {}
    for name, (way, loss) in ways_of(model, supervision).items():
        model.zero_grad()
        value = loss(way(params), target)
        value.backward()
        losses[name] = value.item()
        gradients[name] = [weight.grad.clone() for weight in model.parameters()]
    assert set(losses) == (set(LABELS) if module is cnn else {PLAIN, OURS})
    for name in losses:
        assert losses[name] == pytest.approx(losses[PLAIN], rel=1e-5), name
        for here, there in zip(gradients[name], gradients[PLAIN], strict=True):
            torch.testing.assert_close(here, there, rtol=1e-3, atol=1e-5 * float(there.abs().max() + 1))


def test_a_turn_is_timed_for_each_way_and_leaves_the_weights_alone():
    model, supervision = model_and_supervision(dense, DenseConfig(hidden=(16,)))
    before = [weight.detach().clone() for weight in model.parameters()]
    batches = [supervision.batch(0, "bench", turn, DenseConfig().training) for turn in range(3)]
    times = time_steps(ways_of(model, supervision), batches, "steps")
    assert {name: len(each) for name, each in times.items()} == {PLAIN: 3, OURS: 3}
    assert all((each > 0).all() for each in times.values())
    assert all(torch.equal(a, b) for a, b in zip(before, model.parameters(), strict=True))


def test_the_table_has_a_line_a_way_and_a_group_a_method():
    def rows(method, name, milliseconds, times):
        facts = (None, 1, 20, "bench", "bench_train")
        return [
            Row("bench_train", "teen", method, f"step_ms[{name}]", "ms", milliseconds, *facts),
            Row("bench_train", "teen", method, f"times_as_fast[{name}]", "ratio", times, *facts),
        ]

    given = [*rows("coarse", OURS, 20.0, 2.5), *rows("coarse", PLAIN, 50.0, 1.0), *rows("dense", OURS, 7.0, 2.0)]
    body = steps_table(given, "teen").body
    assert [line and line[:2] for line in body] == [
        ("Coarse", "Plain torch"),
        ("Coarse", "Ours"),
        None,
        ("Dense", "Ours"),
    ]
    assert np.isclose(float(body[1][3]), 2.5)
