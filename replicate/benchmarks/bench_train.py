"""How fast a training step is: ours beside the one that one would write first, and what each piece of ours brings.

`make bench-train` lets the ways take turns on the same batches, so that a busy machine slows all of them alike; the
median of the turns counts. All have the same networks, weights and batches; forward and backward pass, the loss and
Adam are timed, on one thread. The first way has a module a segment, maps in full, torch's normals; the others replace
the loss, or the maps, or both; `rewritten` has our exact rewrites of the maps with torch's own layers. The regional
method is trained on meshes first, and then on coefficients.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import nn

from replicate.approximation.cnn import make_network, shape_facts
from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.dense import make_network as make_dense
from replicate.approximation.dense import shape_facts as dense_facts
from replicate.approximation.model import SegmentedModel, fresh_model
from replicate.approximation.segments import segment_vertices
from replicate.approximation.supervision import Supervision
from replicate.approximation.training import prepare
from replicate.artefacts import built_rig, control_influence, drawn_samples, refinement_squares, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.benchmarks.common import PROFILE, add_count, answer, artefacts_of, make_parser, publish, split_names
from replicate.benchmarks.plain_networks import FullMaps, PlainLoss, Rewritten
from replicate.benchmarks.regional_steps import fresh_regional, regional_batches, regional_ways
from replicate.config import Config, resolve
from replicate.engine.progress import progress
from replicate.methods import regional
from replicate.methods.method_registry import method_named, sections
from replicate.methods.training_stage import inputs_of_networks
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off

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
    """Return each way to train a model: its module, and its loss; maps that are no maps have none of their own."""
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
    """Return each way's wall times in ms, one a batch; a first batch goes before them and isn't timed.

    All ways share weights; the rate is 0, so that all see the same ones.
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
    inputs = artefacts_of(TABLE, config, [*inputs_of_networks(plan), refinement_squares.stage(plan)])
    mesh, samples = built_rig.load_mesh(inputs), drawn_samples.load(inputs)
    coarse = rigid_segments.load_coarse_segments(inputs, mesh)
    squares = refinement_squares.load(inputs)
    device, scale, rows = prepare("cpu"), parameter_scale(samples.params), []
    movable = np.sort(segment_vertices(coarse))
    for method, segments, section, make, facts in (
        ("coarse", coarse, config.coarse, make_network, shape_facts),
        ("refined", squares, config.refinement, make_network, shape_facts),
        ("dense", coarse, config.dense, make_dense, dense_facts),
    ):
        own = segment_vertices(segments)
        supervision = Supervision(mesh, samples, own if method == "refined" else movable, section.normal_weight, device)
        networks = [make(segment, facts(section)) for segment in segments]
        model = fresh_model(networks, segments, scale, supervision.statistics()[1], section, config.seed)
        batches = [supervision.batch(config.seed, "bench", turn, section.training) for turn in range(rounds)]
        rows += _rows(plan.character, method, time_steps(ways_of(model, supervision), batches, f"{method} steps"))
    section, influence = regional.METHOD.section(config), control_influence.load(inputs)
    supervision = Supervision(mesh, samples, movable, section.normal_weight, device)
    model, coefficients = fresh_regional(supervision, influence, section, config.seed, progress)
    batches = regional_batches(supervision, coefficients, section, config.seed, rounds)
    ways = regional_ways(model, supervision, PLAIN, "loss", OURS)
    return rows + _rows(plan.character, regional.METHOD.name, time_steps(ways, batches, "regional steps"))


def _rows(character: str, method: str, times: dict[str, np.ndarray]) -> list[Row]:
    """Return the rows of a method's ways, whose times are in ms."""
    rows = []
    for name, milliseconds in times.items():
        median = float(np.median(milliseconds))
        facts = (None, 1, len(milliseconds), PROFILE, TABLE)
        ratio = float(np.median(times[PLAIN])) / median
        rows.append(Row(TABLE, character, method, f"step_ms[{name}]", "ms", median, *facts))
        rows.append(Row(TABLE, character, method, f"times_as_fast[{name}]", "ratio", ratio, *facts))
    return rows


def steps_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's steps, a group a method."""
    body: list[tuple[str, ...] | None] = []
    for method in dict.fromkeys(row.method for row in rows if row.character == character):
        body += [None] if body else []
        for name, label in LABELS.items():
            cells = [find(rows, TABLE, character, method, f"{m}[{name}]") for m in ("step_ms", "times_as_fast")]
            if all(cells):
                ends = (round_off(cell.value, cell.unit) for cell in cells)
                body.append((method_named(method).label, label, *ends))
    note = (
        "medians over turns, on one thread; batches of the profile's size; refined: the squares' networks alone; "
        "regional: on meshes, and ours on coefficients of its bases."
    )
    return Table(
        f"A training step: {character}", (("", "", "ms", "times as fast"),), tuple(body), (note,), text_columns=2
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time training steps.", profile="whose networks and batches")
    add_count(parser, "rounds", ROUNDS, "steps that each is timed on")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    for character in split_names(options.characters):
        rows = measure(resolve(character, options.profile, sections=sections(options.profile)), options.rounds)
        publish(TABLE, rows, [steps_table(rows, rows[0].character)], command_line)


if __name__ == "__main__":
    sys.exit(main())
