"""How fast a training step is: ours beside a plain one, and what each piece of ours gains.

`make bench-train` lets the ways take turns on the same batches, so that a busy machine slows all of them alike; the
median of the turns counts. All have the same networks, weights and batches; forward and backward pass, the loss and
Adam are timed, on one thread. The plain way has a module a segment, maps in full and torch's normals; the others
replace the loss, or the maps, or both; `rewritten` has our exact rewrites of the maps with torch's layers. The regional
method is trained on meshes, and on coefficients.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import nn
from torch.nn import functional

from replicate.approximation.cnn import MapNetwork, make_network, shape_facts
from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.deformation_map import sample
from replicate.approximation.losses import FacialLoss, Supervision, reference_loss
from replicate.approximation.model import SegmentedModel, fresh_model
from replicate.approximation.segments import segment_vertices
from replicate.approximation.training import prepare
from replicate.base.progress import progress
from replicate.baselines.dense import make_network as make_dense
from replicate.baselines.dense import shape_facts as dense_facts
from replicate.benchmarks.common import (
    add_count,
    answer,
    artefacts_of,
    bench_characters,
    bench_row,
    in_groups,
    make_parser,
)
from replicate.config import Config
from replicate.methods import artefacts, regional
from replicate.methods.method_registry import method_named
from replicate.methods.plan import Plan
from replicate.methods.training_stage import inputs_of_networks
from replicate.regional.model import RegionalModel, regional_loss
from replicate.report.results import Row, find
from replicate.report.tables import Table, our_value
from replicate.timing.backends import read_full_maps

ABOUT = "milliseconds of a training step, ours beside a plain one, and what each piece of ours brings"
WRITES = "results/runs/bench/bench_train.csv"
TABLE = "bench_train"
ROUNDS = 20
PLAIN, OURS = "plain", "ours"
LABELS = {
    PLAIN: "Plain torch",
    "loss": "Our loss alone",
    "maps": "Our maps alone",
    "rewritten": "Our loss, maps rewritten in torch",
    OURS: "Ours",
}


def ways_of(model: SegmentedModel, supervision: Supervision) -> dict[str, tuple[nn.Module, Callable]]:
    """Return each way to train a model by name: its module and its loss. Only networks of maps have all the ways."""
    ours, plain = supervision.loss, PlainLoss(supervision.loss)
    if not hasattr(model.networks[0], "maps"):
        return {PLAIN: (model, plain), OURS: (model, ours)}
    full, rewritten = (_with(model, kind) for kind in (FullMaps, Rewritten))
    return {
        PLAIN: (full, plain),
        "loss": (full, ours),
        "maps": (model, plain),
        "rewritten": (rewritten, ours),
        OURS: (model, ours),
    }


def _with(model: SegmentedModel, kind: type[nn.Module]) -> SegmentedModel:
    """Return the model with each network evaluated in another way; the weights are shared."""
    networks = [kind(network) for network in model.networks]
    return SegmentedModel(networks, model.segments, model.scale, model.lengths, model.vertex_count)


def time_steps(
    ways: dict[str, tuple[nn.Module, Callable]], batches: Sequence[tuple[torch.Tensor, torch.Tensor]], label: str
) -> dict[str, np.ndarray]:
    """Return each way's wall times in ms, one a batch, after a batch that isn't timed.

    All ways share weights; the rate is 0, so that the weights stay the same.
    """
    optimisers = {
        name: torch.optim.Adam(module.parameters(), lr=0.0, fused=name != PLAIN) for name, (module, _) in ways.items()
    }
    times = {name: np.zeros(len(batches)) for name in ways}
    with progress(len(batches), label) as bar:
        for turn in range(-1, len(batches)):
            params, target = batches[max(turn, 0)]
            for name, (module, loss) in ways.items():
                start = time.perf_counter()
                optimisers[name].zero_grad(set_to_none=True)
                loss(module(params), target).backward()
                optimisers[name].step()
                times[name][max(turn, 0)] = 1e3 * (time.perf_counter() - start)
            bar.update(1)
    return times


def measure(config: Config, rounds: int) -> list[Row]:
    """Time every network's step on one character, and return the rows."""
    plan = Plan(config)
    inputs = artefacts_of(TABLE, config, [*inputs_of_networks(plan), artefacts.squares_stage(plan)])
    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
    coarse = artefacts.load_coarse_segments(inputs, mesh)
    squares = artefacts.load_squares(inputs)
    device, scale, rows = prepare("cpu"), parameter_scale(samples.params), []
    movable = np.sort(segment_vertices(coarse))
    for method, segments, section, make, facts in (
        ("coarse", coarse, config.coarse, make_network, shape_facts),
        ("refined", squares, config.refinement, make_network, shape_facts),
        ("dense", coarse, config.dense, make_dense, dense_facts),
    ):
        vertices = segment_vertices(squares) if method == "refined" else movable
        supervision = Supervision(mesh, samples, vertices, section.normal_weight, device)
        networks = [make(segment, facts(section)) for segment in segments]
        model = fresh_model(networks, segments, scale, supervision.statistics()[1], section, config.seed)
        batches = [supervision.batch(config.seed, "bench", turn, section.training) for turn in range(rounds)]
        rows += _rows(plan.character, method, time_steps(ways_of(model, supervision), batches, f"{method} steps"))
    section, influence = regional.METHOD.section(config), artefacts.load_influence(inputs)
    supervision = Supervision(mesh, samples, movable, section.normal_weight, device)
    model, coefficients = fresh_regional(supervision, influence, section, config.seed)
    batches = regional_batches(supervision, coefficients, section, config.seed, rounds)
    ways = regional_ways(model, supervision)
    return rows + _rows(plan.character, regional.METHOD.name, time_steps(ways, batches, "regional steps"))


def _rows(character: str, method: str, times: dict[str, np.ndarray]) -> list[Row]:
    """Return the rows of a method's ways. times: of each way's steps, ms."""
    rows = []
    for name, milliseconds in times.items():
        median, count = float(np.median(milliseconds)), len(milliseconds)
        ratio = float(np.median(times[PLAIN])) / median
        rows.append(bench_row(TABLE, character, method, f"step_ms[{name}]", "ms", median, count, TABLE))
        rows.append(bench_row(TABLE, character, method, f"times_as_fast[{name}]", "ratio", ratio, count, TABLE))
    return rows


def steps_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's steps, a group a method."""
    lines = []
    for method in dict.fromkeys(row.method for row in rows if row.character == character):
        for name, label in LABELS.items():
            found = [find(rows, TABLE, character, method, f"{m}[{name}]") for m in ("step_ms", "times_as_fast")]
            if all(found):
                lines.append((method, (method_named(method).label, label, *map(our_value, found))))
    note = (
        "medians over turns, on one thread; batches of the profile's size; refined: the squares' networks alone; "
        "regional: on meshes, and ours on coefficients of its bases."
    )
    header = ("", "", "ms", "times as fast")
    return Table(f"A training step: {character}", (header,), in_groups(lines), (note,), text_columns=2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time training steps.", profile="whose networks and batches")
    add_count(parser, "rounds", ROUNDS, "steps that each is timed on")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    bench_characters(TABLE, partial(measure, rounds=options.rounds), steps_table, options, command_line)


# The plain training step, in torch alone, with which ours is compared.


class FullMaps(nn.Module):
    """A `MapNetwork` as in Fig. 3, layer by layer: maps in full, which the vertices then read."""

    def __init__(self, network: MapNetwork):
        super().__init__()
        self.network = network

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return read_full_maps(self.network, params)


class Rewritten(nn.Module):
    """The same with our exact rewrites (DEVIATIONS D14) and torch's own layers: no compiled kernel.

    Upsampling and the 3×3 convolution after it are one transposed convolution of stride 2, and the vertices read the
    features before the last 1×1 convolution.
    """

    def __init__(self, network: MapNetwork):
        super().__init__()
        self.network = network
        spread = torch.tensor([[1.0, 0, 0], [1, 1, 0], [0, 1, 1], [0, 0, 1]])  # 4×4 taps of 3×3 ones, along an axis
        self.register_buffer("spread", spread, persistent=False)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        network = self.network
        x = network._start(params).permute(0, 3, 1, 2)
        for layer in network.upsampled:
            taps = torch.einsum("pr,qs,oirs->iopq", self.spread, self.spread, layer.weight.flip(2, 3))
            x = functional.conv_transpose2d(x, taps, layer.bias, stride=2, padding=1)
            x = functional.leaky_relu(x, network.slope)
        features = functional.leaky_relu(network.last(x), network.slope).permute(0, 2, 3, 1)
        read = sample(features, network.pixels, network.shares)
        return functional.linear(read, network.output.weight[:, :, 0, 0], network.output.bias)


class PlainLoss:
    """Eq. 1 in plain torch, with the weight and counts of a `FacialLoss`."""

    def __init__(self, loss: FacialLoss):
        self.neutral, self.faces = torch.from_numpy(loss.neutral), torch.from_numpy(loss.faces).long()
        self.settings = (loss.normal_weight, loss.vertex_count, loss.face_count)

    def __call__(self, offsets: Float[torch.Tensor, "b n 3"], target: Float[torch.Tensor, "b n 3"]) -> torch.Tensor:
        return reference_loss(self.neutral + offsets, self.neutral + target, self.faces, *self.settings)


# The regional method's training step: on coefficients, as ours, and on meshes, as a plain one.

STREAM = "bench"  # of the batches that are drawn


class OnMeshes(nn.Module):
    """Raw rig parameters (b, m) → offsets (b, v, 3), mm, of some vertices: what a loss of meshes needs."""

    def __init__(self, model: RegionalModel, vertices: Int[np.ndarray, " v"]):
        super().__init__()
        self.network, self.scale, self.moved = model.network, model.scale, model.moved
        order = np.argsort(model.vertices)
        self.order = torch.from_numpy(order[np.searchsorted(model.vertices, vertices, sorter=order)])

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b v 3"]:
        return self.moved(self.network(params / self.scale))[:, self.order]


class OnCoefficients(nn.Module):
    """Raw rig parameters (b, m) → coefficients (b, d) over the network's unit of length."""

    def __init__(self, model: RegionalModel):
        super().__init__()
        self.network, self.scale = model.network, model.scale

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b d"]:
        return self.network(params / self.scale)


def fresh_regional(
    supervision: Supervision,
    influence: Bool[np.ndarray, "n m"],
    section: regional.RegionalConfig,
    seed: int,
) -> tuple[RegionalModel, Float[np.ndarray, "s d"]]:
    """Return the method's model with random weights, and the coefficients of all training samples over its length.

    supervision: of the vertices that the regions share out. influence: which control moves which vertex. section: the
    method's settings.
    """
    samples = supervision.samples
    bases, _, coefficients = regional.stored_bases(supervision, section, progress)
    length = float(np.sqrt(np.mean(np.square(coefficients), dtype=np.float64))) or 1.0
    network = regional.untrained_networks(bases, influence, section)
    generator = torch.Generator().manual_seed(seed)
    for part in network.networks:
        part.start(np.zeros((part.layers[0].in_features + 1, part.output.out_features)), generator)
    model = RegionalModel(network, bases, parameter_scale(samples.params), length, len(supervision.mesh.neutral))
    return model, coefficients / np.float32(length)


def regional_ways(model: RegionalModel, supervision: Supervision) -> dict[str, tuple[nn.Module, Callable]]:
    """Return the ways to train a regional model, each a module and its loss: on meshes by either loss, and ours.

    A target is a pair: true offsets (b, v, 3) in mm, and coefficients (b, d).
    """
    counts = [len(basis.steps) for basis in model.bases]
    membership = torch.from_numpy(np.eye(len(counts), dtype=np.float32)[np.repeat(np.arange(len(counts)), counts)])
    on_meshes, of_meshes = OnMeshes(model, supervision.vertices), PlainLoss(supervision.loss)
    return {
        PLAIN: (on_meshes, lambda offsets, target: of_meshes(offsets, target[0])),
        "loss": (on_meshes, lambda offsets, target: supervision.loss(offsets, target[0])),
        OURS: (OnCoefficients(model), lambda found, target: regional_loss(found - target[1], membership)),
    }


def regional_batches(
    supervision: Supervision,
    coefficients: Float[np.ndarray, "s d"],
    section: regional.RegionalConfig,
    seed: int,
    rounds: int,
) -> list[tuple[torch.Tensor, tuple[torch.Tensor, torch.Tensor]]]:
    """Return batches of raw rig parameters (b, m) and targets, as `regional_ways` needs them.

    supervision: of the vertices that the regions share out.
    coefficients: of all training samples.
    section: the method's settings.
    seed: of the draws.
    rounds: how many batches.
    """
    batches = []
    for turn in range(rounds):
        rows = supervision.samples.draw_for_step(seed, STREAM, turn, section.training.batch, section.training.draws)
        params, offsets = supervision.batch(seed, STREAM, turn, section.training)
        batches.append((params, (offsets, torch.from_numpy(np.ascontiguousarray(coefficients[rows])))))
    return batches


if __name__ == "__main__":
    sys.exit(main())
