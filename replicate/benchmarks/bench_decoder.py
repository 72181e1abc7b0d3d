"""What limits the paper's networks: the decoder from a few hundred numbers to a map, the numbers, or the steps.

`make bench-decoder` trains at one short schedule, and takes the networks apart in four ways:

- *few poses*: 8, 64 and 512 training poses alone, and the errors on these very poses. Networks with room for more than
  a pose has can learn them by heart; what they miss is beyond their layers, or their steps.
- *free codes*: in place of the dense layers each of 512 poses has numbers of its own, trained with the convolutions.
  Then the convolutions stay as they are, and numbers are fitted to validation poses: the decoder's floor, which dense
  layers can't go below with these convolutions.
- *widths*: the numbers that make a map ("start") and the channels of convolutions, on all samples.
- *steps*: the schedule once, twice, four and eight times as long, for the paper's networks, dense ones and ours; for
  wider networks once, twice and four times.

Beside the first two stands the maps' floor (Eq. 2) on the same poses. Other errors are those of the validation poses,
which are held out of the training animation; test poses are not used. Trainings are stages in the cache, so that a
stopped run goes on where it was. `--only "free codes"` runs a part.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.benchmarks.common import (
    add_count,
    add_only,
    answer,
    bench_folder,
    in_groups,
    make_parser,
    make_stages,
    publish,
    save_picture,
    selected,
    split_names,
)
from replicate.benchmarks.variants import COLUMNS, SIZE_PT, Variant, floor_deg, train_variants, variants_tables
from replicate.config import CoarseConfig, Config, resolve
from replicate.drawing.panels import DPI, WIDTH, Words, enlarge, tidy
from replicate.engine.stage import Stage, StageContext
from replicate.engine.store import artefact_folder, read_manifest
from replicate.methods import artefacts
from replicate.methods.method_registry import method_named, sections
from replicate.methods.plan import Plan, TrainingSettings
from replicate.methods.training_stage import LOG, inputs_of_networks
from replicate.report.results import Row, characters_of, read_results
from replicate.report.tables import Table, our_value

if TYPE_CHECKING:
    import matplotlib.figure

    import replicate.approximation.model
    import replicate.approximation.samples
    import replicate.approximation.segments

ABOUT = "what limits the paper's networks: their decoders, their widths or their steps"
WRITES = "results/runs/bench/bench_decoder.csv, bench_decoder_<character>.png"
TABLE = "bench_decoder"
STEPS = 4_000
POSES, CODED = (8, 64, 512), 512  # training poses that are learned by heart; those that have free codes
BY_HEART = ((512, 16), (512, 32), (2_048, 16), (2_048, 32), (2_048, 48))  # start and channels
FREE = ((512, 16), (2_048, 16), (2_048, 32))
STARTS, CHANNELS = (512, 1_024, 2_048), (16, 32, 48)
DEEPER = "start 512, 16 channels, one more dense layer"
TIMES, TIMES_WIDE = (1, 2, 4, 8), (2, 4)
WIDE = (2_048, 32)  # start and channels of what a chart calls wider
STEPPED = ("coarse", "dense", "regional")
MEASURED = 64  # of the few poses, spread over them: where a training is measured as it goes
METRICS = {  # metric → unit, header
    "few_vertex_error": ("mm", "mm"),
    "few_normal_error": ("deg", "degrees"),
    "few_floor": ("deg", "maps' floor, degrees"),
    "fitted_vertex_error": ("mm", "fitted: mm"),
    "fitted_normal_error": ("deg", "fitted: degrees"),
    "fitted_floor": ("deg", "maps' floor, degrees"),
}

FLOOR, WIDER = "The maps' floor", "CNN, wider"
STROKES = {  # colour and dashes of a chart's lines
    "CNN": ("#E69F00", "-"),
    WIDER: ("#E69F00", (0, (2, 1.5))),
    "CNN, free codes": ("#009E73", "-"),
    "Dense": ("#D55E00", "-"),
    "Regional (ours)": ("#0072B2", "-"),
    FLOOR: ("#777777", (0, (1, 2))),
}
CAPTION = (
    "Normal errors of {character}'s networks. Left: trained on a few poses alone, and measured on these very poses; "
    "with free codes each pose has numbers of its own in place of the dense layers. Right: trained on all samples, and "
    "measured on validation poses; the floor is of these. Wider: 2,048 numbers and 32 channels in place of 512 and 16."
)


def widths(start: int, channels: int) -> str:
    """Return what a decoder is called."""
    return f"start {start}, {channels} channels"


# The trainings on a few poses.


@dataclass(frozen=True)
class Few:
    """A training on a few poses: of which method, its name, its settings, how many poses, and if these have codes."""

    method: str
    change: str
    config: Config
    poses: int
    free: bool = False

    def __str__(self) -> str:
        """Return what the training is called."""
        return f"{self.method}, {self.change}"


@dataclass(frozen=True)
class FewSettings(TrainingSettings):
    """The settings of a training on a few poses. section: of CNNs or dense networks; free: whether poses have codes."""

    poses: int
    free: bool


def few_trainings(character: str, profile: str, steps: int) -> list[Few]:
    """Return the trainings on a few poses of one character, at a schedule of `steps`."""
    schedule, first = {"steps": steps}, resolve(character, profile).coarse.hidden[:-1]

    def of_maps(start: int, channels: int, hidden: Sequence[int]) -> Config:
        section = {"hidden": [*hidden, start], "channels": channels, "training": schedule}
        return resolve(character, profile, {"coarse": section})

    found = []
    for poses in POSES:
        for start, channels in BY_HEART:
            words = f"{poses} poses, {widths(start, channels)}"
            found.append(Few("coarse", words, of_maps(start, channels, first), poses))
        dense = resolve(character, profile, {"dense": {"training": schedule}})
        found.append(Few("dense", f"{poses} poses", dense, poses))
    free = (Few("coarse", f"free codes, {widths(*shape)}", of_maps(*shape, ()), CODED, True) for shape in FREE)
    return [*found, *free]


def few_stage(training: Few) -> Stage:
    """Return the stage of a training on a few poses."""
    plan, config = Plan(training.config), training.config
    section = config.coarse if training.method == "coarse" else config.dense
    settings = FewSettings(section, config.seed, config.device, training.poses, training.free)
    return plan.stage("few", train_few, settings, *inputs_of_networks(plan))


def train_few(context: StageContext) -> None:
    """Train networks on a few poses, and note their errors on these; with free codes, on validation poses too."""
    from replicate.approximation import cnn
    from replicate.approximation.conditioning import parameter_scale
    from replicate.approximation.losses import spread
    from replicate.approximation.training import train_segments, write_log
    from replicate.baselines import dense

    settings, section = context.config, context.config.section
    mesh, samples = artefacts.load_mesh(context.inputs), artefacts.load_samples(context.inputs)
    segments = artefacts.load_coarse_segments(context.inputs, mesh)
    # the poses, and what networks see of them
    rows = spread(len(samples), settings.poses)
    few = posed(samples, np.asarray(samples.params[rows]), samples.offsets(rows))
    scale = parameter_scale(samples.params)
    if settings.free:
        segments, codes = with_codes(segments, len(few))
        few, scale = posed(samples, codes, few.offsets(np.arange(len(few)))), np.ones(len(few), np.float32)
    # the training
    maker = cnn if isinstance(section, CoarseConfig) else dense
    networks = [maker.make_network(segment, maker.shape_facts(section)) for segment in segments]
    common = (section, context.scratch, context.progress, context.name, settings.seed, scale, settings.device)
    model, log = train_segments(mesh, segments, networks, few, *common)
    write_log(log, context.out / LOG)
    context.note(few_vertex_error=log[-1]["mm"], few_normal_error=log[-1]["degrees"])
    # what maps can hold, and what the convolutions can
    if isinstance(section, CoarseConfig):
        context.note(few_floor=floor_deg(mesh, few, segments, section.map_size))
    if settings.free:
        mm, degrees = fit_codes(context, model.to("cpu"), samples)
        context.note(fitted_vertex_error=mm, fitted_normal_error=degrees)
        context.note(fitted_floor=floor_deg(mesh, samples, segments, section.map_size))


def posed(
    samples: "replicate.approximation.samples.SampleSet",
    params: Float[np.ndarray, "b j"],
    offsets: Float[np.ndarray, "b n 3"],
) -> "replicate.approximation.samples.SampleSet":
    """Return samples of these poses alone, some of which are the validation poses too; test poses stay."""
    from replicate.approximation.losses import spread
    from replicate.approximation.samples import quantise

    quantised, steps = quantise(offsets)
    some, bins = spread(len(params), MEASURED), np.zeros(len(params), np.int16)
    training = {"params": params, "quantised": quantised, "steps_mm": steps, "bins": bins}
    return replace(samples, **training, validation_params=params[some], validation_offsets=offsets[some])


def with_codes(
    segments: "Sequence[replicate.approximation.segments.Segment]", poses: int
) -> "tuple[list[replicate.approximation.segments.Segment], np.ndarray]":
    """Return segments that see one control a pose, and the parameters (b, b) in which each pose has its own.

    Without hidden layers a network's dense layer then holds a code for each pose. The control's value, √b, has the
    length of b controls of the size 1, which first weights and peak rates are made for.
    """
    own = np.arange(poses, dtype=np.int32)
    coded = [replace(segment, parameters=own) for segment in segments]
    return coded, np.sqrt(poses).astype(np.float32) * np.eye(poses, dtype=np.float32)


def fit_codes(
    context: StageContext,
    model: "replicate.approximation.model.SegmentedModel",
    samples: "replicate.approximation.samples.SampleSet",
) -> tuple[float, float]:
    """Return the errors (mm, degrees) on validation poses whose codes are fitted to a trained model's convolutions."""
    import torch
    from torch import nn

    from replicate.approximation import cnn
    from replicate.approximation.losses import Supervision
    from replicate.approximation.model import SegmentedModel
    from replicate.approximation.training import train

    settings, section = context.config, context.config.section
    offsets = np.asarray(samples.validation_offsets)
    segments, codes = with_codes(model.segments, len(offsets))
    networks = [cnn.make_network(segment, cnn.shape_facts(section)) for segment in segments]
    for network, trained in zip(networks, model.networks, strict=True):
        weights = {name: value for name, value in trained.state_dict().items() if not name.startswith("dense.")}
        network.load_state_dict(weights, strict=False)
        network.requires_grad_(False)
        (layer,), (known,) = network.dense, trained.dense
        with torch.no_grad():  # all start with the mean of the known codes
            layer.weight.zero_()
            layer.bias.copy_(known.bias + known.weight.mean(1) * known.in_features**0.5)
        layer.weight.requires_grad_(True)
    scale = np.ones(len(offsets), np.float32)
    fitted = SegmentedModel(networks, segments, scale, model.lengths, model.vertex_count).to(settings.device)
    held_out, mesh = posed(samples, codes, offsets), artefacts.load_mesh(context.inputs)
    device = torch.device(settings.device)
    supervision = Supervision(mesh, held_out, model.vertices, section.normal_weight, device)
    weights = nn.ParameterList([layer.weight for network in fitted.networks for layer in network.dense])

    def loss_of_step(step: int) -> torch.Tensor:
        params, target = supervision.batch(settings.seed, "codes", step, section.training)
        return supervision.loss(fitted(params), target)

    validation, scratch, progress = supervision.validation(), context.scratch / "codes", context.progress
    scratch.mkdir(exist_ok=True)
    log = train(weights, loss_of_step, section.training, scratch, progress, "codes", lambda: validation(fitted.offsets))
    return log[-1]["mm"], log[-1]["degrees"]


def few_rows(trainings: Sequence[Few]) -> list[Row]:
    """Make what is missing of trainings on a few poses, and return their errors as rows."""
    stages, profile = [few_stage(training) for training in trainings], trainings[0].config.profile
    make_stages(TABLE, profile, stages)
    rows = []
    for training, stage in zip(trainings, stages, strict=True):
        notes = read_manifest(artefact_folder(stage.identifier))["notes"]
        for metric, (unit, _) in METRICS.items():
            if metric in notes:
                poses = training.config.samples.validation if metric.startswith("fitted") else training.poses
                key = (TABLE, stage.label, training.method, f"{metric}[{training.change}]")
                rows.append(Row(*key, unit, float(notes[metric]), None, 1, poses, profile, "bench-decoder"))
    return rows


# The trainings on all samples.


def variants(character: str, profile: str, steps: int) -> list[Variant]:
    """Return the trainings of all samples of one character, at a schedule of `steps` or a multiple of it."""
    more = sections(profile)

    def at(method: str, change: str, times: int = 1, **section: object) -> Variant:
        overrides = {method: {**section, "training": {"steps": times * steps}}}
        return Variant(method, change, resolve(character, profile, overrides, sections=more))

    first = list(resolve(character, profile).coarse.hidden[:-1])
    found = [
        at("coarse", widths(start, channels), hidden=[*first, start], channels=channels)
        for start in STARTS
        for channels in CHANNELS
    ]
    found.append(at("coarse", DEEPER, hidden=[*first, first[-1], STARTS[0]], channels=CHANNELS[0]))
    start, channels = WIDE
    found += [at("coarse", wide_words(k), k, hidden=[*first, start], channels=channels) for k in TIMES_WIDE]
    return found + [at(method, times_words(times), times) for method in STEPPED for times in TIMES]


def times_words(times: int) -> str:
    """Return what a longer schedule is called."""
    return f"steps × {times}"


def wide_words(times: int) -> str:
    """Return what a longer schedule of wider networks is called."""
    return f"{widths(*WIDE)}, {times_words(times)}"


WIDTHS = (
    *(widths(start, channels) for start in STARTS for channels in CHANNELS),
    DEEPER,
    *map(wide_words, TIMES_WIDE),
)
CHANGES = {method: (*(WIDTHS if method == "coarse" else ()), *map(times_words, TIMES)) for method in STEPPED}


# What is printed, and the command line.


def decoder_tables(rows: Sequence[Row]) -> list[Table]:
    """Return two tables for each character in `bench_decoder.csv`: few poses, and all samples."""
    own = [row for row in rows if row.table == TABLE]
    few = [_few_table([row for row in own if row.character == name], name) for name in characters_of(own)]
    others = [row for row in own if row.metric.partition("[")[0] in COLUMNS]
    return [*(table for table in few if table.body), *variants_tables(others, TABLE, "Widths and steps", CHANGES)]


def _few_table(rows: Sequence[Row], character: str) -> Table:
    values = {(row.method, *row.metric.rstrip("]").split("[")): row for row in rows}
    lines = []
    for method, change in dict.fromkeys((key[0], key[2]) for key in values if key[1] in METRICS):
        found = (values.get((method, metric, change)) for metric in METRICS)
        cells = (our_value(row) if row else "" for row in found)
        lines.append((change.partition(",")[0], (method_named(method).label, change, *cells)))
    header = ("", "", *(words for _, words in METRICS.values()))
    note = (
        f"trained on the poses alone, and measured on {MEASURED} of them at most; fitted: on validation poses whose "
        "codes are fitted to the trained convolutions."
    )
    return Table(f"Few poses: {character}", (header,), in_groups(lines), (note,), text_columns=2)


def decoder_chart(rows: Sequence[Row], character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): normal errors against poses learned by heart, and against the steps of a training."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    values = {(r.method, r.metric): r.value for r in rows if r.table == TABLE and r.character == character}
    narrow, wide = widths(STARTS[0], CHANNELS[0]), widths(*WIDE)

    def found(method: str, metric: str, changes: dict[int, str]) -> dict[int, float]:
        keys = {x: (method, f"{metric}[{change}]") for x, change in changes.items()}
        return {x: values[key] for x, key in keys.items() if key in values}

    def poses(decoder: str = "") -> dict[int, str]:
        return {count: ", ".join(filter(None, (f"{count} poses", decoder))) for count in POSES}

    steps, few, validation = {k: times_words(k) for k in TIMES}, "few_normal_error", "validation_normal_error"
    by_heart = {
        "CNN": found("coarse", few, poses(narrow)),
        WIDER: found("coarse", few, poses(wide)),
        "CNN, free codes": found("coarse", few, {CODED: f"free codes, {narrow}"}),
        "Dense": found("dense", few, poses()),
        FLOOR: found("coarse", "few_floor", poses(narrow)),
    }
    longer = {
        "CNN": found("coarse", validation, steps),
        WIDER: found("coarse", validation, {1: wide} | {k: wide_words(k) for k in TIMES_WIDE}),
        "Dense": found("dense", validation, steps),
        "Regional (ours)": found("regional", validation, steps),
    }
    shown = sorted({k for line in longer.values() for k in line})
    longer[FLOOR] = found("coarse", "fitted_floor", dict.fromkeys(shown, f"free codes, {narrow}"))
    # the chart
    figure = Figure((WIDTH, 0.54 * WIDTH), dpi=DPI, layout="constrained")
    axes_labels = ("training poses, learned by heart", "steps, as many times the short schedule")
    for axes, lines, words in zip(figure.subplots(1, 2), (by_heart, longer), axes_labels, strict=True):
        for name, line in lines.items():
            colour, dashes = STROKES[name]
            marker = {"marker": "o"} if name != WIDER else {"marker": "s", "markerfacecolor": "white"}
            axes.plot([*line], [*line.values()], linestyle=dashes, color=colour, label=name, **marker)
        axes.set_xscale("log")
        ticks = sorted({x for line in lines.values() for x in line})
        if ticks:  # no axis without a number can be logarithmic
            axes.set_yscale("log")
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.set_xticks(ticks, [f"{x}" for x in ticks])
        axes.minorticks_off()
        axes.set_xlabel(words)
        tidy(axes)
        enlarge(axes, SIZE_PT)
    handles = {name: h for axes in figure.axes for h, name in zip(*axes.get_legend_handles_labels(), strict=True)}
    there = [name for name in STROKES if by_heart.get(name) or longer.get(name)]
    where = {"loc": "outside lower center", "ncols": 3}
    figure.legend([handles[name] for name in there], there, frameon=False, fontsize=SIZE_PT - 2, **where)
    figure.axes[0].set_ylabel("normal error on these poses, degrees")
    figure.axes[1].set_ylabel("normal error on unseen poses, degrees")
    return figure, Words(_in_words(character, by_heart, longer), CAPTION.format(character=character))


def _in_words(character: str, *panels: dict[str, dict[int, float]]) -> str:
    """Return the numbers of a chart, for those who can't see it."""
    told = []
    for lines in panels:
        shown = (
            f"{name} {', '.join(f'{y:.2g}° at {x}' for x, y in line.items())}" for name, line in lines.items() if line
        )
        told.append("; ".join(shown))
    return f"Two line charts of normal errors of {character}. By heart: {told[0]}. On unseen poses: {told[1]}."


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose samples and settings")
    add_count(parser, "steps", STEPS, "of the short schedule")
    add_only(parser)
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    for character in split_names(options.characters):
        rows = compare(character, options)
        publish(TABLE, rows, decoder_tables(rows), command_line, in_part=bool(options.only))
        rows = read_results(bench_folder() / f"{TABLE}.csv")  # those of earlier calls too
        save_picture(f"{TABLE}_{character}", decoder_chart(rows, character))


def compare(character: str, options: argparse.Namespace) -> list[Row]:
    """Train what is chosen for one character; return its errors as rows."""
    at = (character, options.profile, options.steps)
    chosen = selected([*few_trainings(*at), *variants(*at)], options.only)
    kinds: tuple[tuple[type, Callable], ...] = ((Few, few_rows), (Variant, lambda own: train_variants(TABLE, own)))
    rows = []
    for kind, make in kinds:
        if own := [training for training in chosen if isinstance(training, kind)]:
            rows += make(own)
    return rows


if __name__ == "__main__":
    from replicate.benchmarks import bench_decoder  # other processes find the stages of a module, not of __main__

    sys.exit(bench_decoder.main())
