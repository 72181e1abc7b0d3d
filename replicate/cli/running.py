"""How a target makes its graph: the stages of all characters and seeds at once, with a forecast of their time."""

import argparse
import re
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from tqdm import tqdm

from data_recipes.catalogue import control_count
from data_recipes.recipe_paths import character_label, in_command
from replicate.base.exceptions import InputError, RunError
from replicate.base.paths import REFERENCE
from replicate.cli.options import SPLITS, configurations, methods, seeds, workers
from replicate.config import Config, resolve
from replicate.engine.provenance import provenance
from replicate.engine.scheduler import run, wall_s
from replicate.engine.stage import Stage, in_order
from replicate.engine.store import artefact_folder
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.method_registry import methods as all_methods
from replicate.methods.method_registry import sections
from replicate.methods.plan import Plan, TrainingSettings
from replicate.methods.trained import Taken, TrainedPlan, plan_for
from replicate.report import manifest
from replicate.report.publication import CharacterResult, check_results_folder

Rig = tuple[Plan, Sequence[Method]]  # a configuration's plan and the methods of its table


def make(
    options: argparse.Namespace, stages: Callable[[Plan], Sequence[Stage]], plan: Callable[[Config], Plan] = Plan
) -> list[CharacterResult]:
    """Make the stages of every character and seed that the command line names; return the result of each.

    stages: a plan → its stages, by urgency, but the one whose artefact is the result last.
    plan: a configuration → its plan.

    Before it starts it prints about how long the missing stages take, and which models come with the repository.
    """
    configs = configurations(options)
    plans = [plan(config) for config in configs]
    graphs = [list(stages(each)) for each in plans]
    for each in plans:
        if isinstance(each, TrainedPlan):
            print(each.in_words(), flush=True)
    _run(options, configs, graphs)
    return _results(configs, graphs)


def plan_with_trained(
    options: argparse.Namespace, config: Config, methods: Sequence[Method], stages: Collection[str]
) -> Plan:
    """Return the plan of one configuration, where it can be with the models that come with the repository.

    methods, stages: as for `plan_for`. Settings that the command line changes want models of their own.
    """
    if options.config or len(seeds(options)) > 1 or config.samples.split != SPLITS[0]:
        return Plan(config)
    return plan_for(config, methods, stages)


def make_rows(
    options: argparse.Namespace,
    graphs: Callable[[Sequence[Rig]], Sequence[Sequence[Stage]]],
    publish: Callable[[Sequence[CharacterResult]], object],
) -> None:
    """Make the stages of a table whose rows are methods, and publish it; a failing method loses only its own row.

    graphs: each configuration's plan and methods → the stages of each, as for `make`
    publish: writes and prints the result of each configuration

    Raises RunError with a sentence for each missing row after it has published the others, and the first error, with
    nothing published, if no method is left or it was none of theirs.
    """
    configs = configurations(options)
    methods_of = [list(methods(options, config)) for config in configs]
    missing: dict[tuple[str, str], str] = {}
    failures: dict[str, InputError | RunError] = {}
    while True:
        made = graphs([(Plan(config), chosen) for config, chosen in zip(configs, methods_of, strict=True)])
        failures.clear()
        _run(options, configs, made, failures)
        if not failures:
            break
        # which methods needed a failed stage; the others are tried again without them
        lost = {
            (character_label(config.character), method.name): str(failures[title])
            for config, chosen in zip(configs, methods_of, strict=True)
            for method in chosen
            for title in sorted(
                failures.keys() & {stage.title for stage in in_order(list(graphs([(Plan(config), [method])])[0]))}
            )
        }
        methods_of = [
            [method for method in chosen if (character_label(config.character), method.name) not in lost]
            for config, chosen in zip(configs, methods_of, strict=True)
        ]
        if not lost or not all(methods_of):
            raise next(iter(failures.values()))
        missing |= lost
    publish(_results(configs, made))
    if missing:
        rows = sorted(missing.items())
        raise RunError("; ".join(f"{character} has no row of {name}: {reason}" for (character, name), reason in rows))


def _run(
    options: argparse.Namespace,
    configs: Sequence[Config],
    graphs: Sequence[Sequence[Stage]],
    failures: dict[str, InputError | RunError] | None = None,
) -> None:
    side_by_side = workers(options)
    check_results_folder(options.profile)  # an error now is better than one after hours
    facts = provenance(options.command_line, options.profile, sorted({config.seed for config in configs}), side_by_side)
    # a cluster's workers and their speed are unknown
    forecast = None if options.cluster else partial(foresee, workers=side_by_side)
    stages = [stage for graph in graphs for stage in graph]
    run(stages, side_by_side, facts, options.cluster, forecast, failures, remarks_before_training(configs, graphs))


BEFORE_TRAINING = ("rig", "samples", "influence", "rigid")  # the stages that a look at a face needs


def remarks_before_training(
    configs: Sequence[Config], graphs: Sequence[Sequence[Stage]]
) -> Callable[[Collection[str]], None]:
    """Return a function of the artefacts that are there, by their identifiers, that says what is amiss with a face.

    It does so once for each character whose networks are to be trained, on standard error in two lines at most, as soon
    as what training begins with is there.
    """
    waiting: dict[str, tuple[Config, dict[str, Stage]]] = {}
    for config, graph in zip(configs, graphs, strict=True):
        stages = in_order(list(graph))
        first = {stage.name: stage for stage in stages if stage.name in BEFORE_TRAINING}
        if len(first) == len(BEFORE_TRAINING) and any(isinstance(stage.config, TrainingSettings) for stage in stages):
            waiting.setdefault(config.character, (config, first))

    def arrived(there: Collection[str]) -> None:
        for character, (config, first) in list(waiting.items()):
            if all(stage.identifier in there for stage in first.values()):
                del waiting[character]
                with suppress(Exception):  # a remark must not end a run
                    for line in remarks(config, first):
                        tqdm.write(line, file=sys.stderr)

    return arrived


def remarks(config: Config, first: Mapping[str, Stage]) -> list[str]:
    """Return what is amiss with a character in two lines at most. first: the stages `BEFORE_TRAINING`, by name."""
    from replicate.rig_study.first_look import EXPECTED, load_face, look, unit_in_words, warnings

    inputs = {name: artefact_folder(stage.identifier) for name, stage in first.items()}
    face = load_face(inputs, unit_in_words(first["rig"].config.recipe), config.coarse.map_size)
    said = [each for each in warnings(look(face, tries=False)) if each.metric not in EXPECTED]
    label, command = character_label(config.character), f"`make check CHARACTERS={in_command(config.character)}`"
    lines = [f"{label}: {said[0].verdict}: {said[0].sentence}"] if said else []
    rest = f"{len(said) - 1} more of the kind, and pictures" if len(said) > 1 else "pictures of it"
    return [*lines, f"{label}: {command} shows {rest}"] if said else []


def _results(configs: Sequence[Config], graphs: Sequence[Sequence[Stage]]) -> list[CharacterResult]:
    return [CharacterResult(config, graph[-1]) for config, graph in zip(configs, graphs, strict=True)]


# About how long a run will take, from the times of the stages in the reference results' manifest.

# Stages that the reference results may lack: a stage that does about the same work, and how many times as much this one
# does. Other networks have the steps of `dense`. Wide decoders are trained without the compiled kernels; nothing is
# trained for weights in 16 bits. Three times
# the features make nine times the products of `linear`, but reading the samples takes longer than those. Derivatives
# are computed before the training and make its steps longer. Compressed skinning finds its shapes before the training;
# the differential subspace has larger batches.
KIN = {"pca": ("dense", 1), "pca_line": ("dense", 1), "driven": ("dense", 1), "squares": ("linear", 4),
       "dense_compact": ("linear", 1), "morph": ("dense", 1), "morph_best": ("dense", 1),
       "ridge_products": ("rig_fits", 1), "coarse_wide": ("coarse", 3), "refined_wide": ("refined", 3),
       "coarse_longer": ("coarse", 1.5), "coarse_half": ("linear", 0.1), "refined_half": ("linear", 0.1),
       "dense_half": ("linear", 0.1),
       "regional_derivatives": ("regional", 2), "differential": ("dense", 0.7), "differential_small": ("dense", 0.35),
       "compskin": ("dense", 3), "compskin_best": ("dense", 3)}  # fmt: skip
# The power of the number of controls with which a time grows: influence is found for each control, our networks have an
# input for each, and regressions need a product for each pair.
GROWTH = {"influence": 1, "regional": 1, "regional_derivatives": 1, "linear": 2, "squares": 2}
EXAMPLE = "teen"


@dataclass(frozen=True)
class Known:
    """The wall time of a stage in seconds, and the profile it was run with."""

    wall_s: float
    profile: str


def foresee(missing: Sequence[Stage], workers: int, folder: Path = REFERENCE) -> tuple[str, dict[str, float | None]]:
    """Return a sentence about how long missing stages will take, and the seconds of each by its identifier.

    workers: processes side by side.
    folder: results with a manifest of times; those of the teen are used if it lacks the character.

    The sentence is "" if nothing is known.
    """
    times = times_s(missing, known_times(folder))
    return sentence(missing, times, workers), times


def sentence(missing: Sequence[Stage], times: Mapping[str, float | None], workers: int) -> str:
    """Return a sentence about how long stages with these times take; "" if no time is known."""
    if not any(times.values()):
        return ""
    seconds = wall_s(missing, times, workers)
    cores = f"{workers} core{'s' * (workers > 1)}"
    many = f"{len(missing)} artefact{'s' * (len(missing) > 1)} to make"
    text = (
        f"{many}: about {duration(seconds)} on {cores}, if they are as fast as those of the reference results and idle"
    )
    unknown = sorted({stage.name for stage in missing if times[stage.identifier] is None})
    return text + (f"; without {', '.join(unknown)}, whose times are unknown" if unknown else "")


def duration(seconds: float) -> str:
    """Return a rough length of time in words."""
    if seconds < 90:
        return "a minute"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def known_times(folder: Path) -> dict[str, Known]:
    """Return the times of all stages in a folder's manifest by name-character; none without a manifest.

    Of several seeds the shortest time is taken: the others ran beside other work or were interrupted.
    """
    known = {}
    for target in reversed(manifest.targets(folder)):  # so that Table 2's times win
        for facts in manifest.entries(folder, target).values():
            times: dict[str, list[tuple[bool, float]]] = {}
            for title, stage in (facts.get("stages") or {}).items():
                uninterrupted_first = (bool(stage.get("resumed")), float(stage["wall_s"]))
                times.setdefault(title.partition("-seed")[0], []).append(uninterrupted_first)
            known |= {title: Known(min(runs)[1], str(facts.get("profile"))) for title, runs in times.items()}
    return known


def times_s(stages: Sequence[Stage], known: dict[str, Known]) -> dict[str, float | None]:
    """Return the seconds of some stages by their identifiers, as `stage_s` does of each."""
    return {stage.identifier: stage_s(stage, known) for stage in stages}


def stage_s(stage: Stage, known: dict[str, Known]) -> float | None:
    """Return about how many seconds a stage takes, None if neither it nor a similar stage is known.

    The time of the same character is taken, else that of the teen, multiplied by the ratio of controls and by that of
    steps, samples or iterations. Rigs that are timed together take time in proportion to their number.
    """
    if isinstance(stage.config, Taken):
        return 1.0
    if rigs := getattr(stage.config, "rigs", ()):
        together = ((re.fullmatch(rf"{stage.name}-(\d+)_rigs", title), entry) for title, entry in known.items())
        return min((len(rigs) * entry.wall_s / int(match[1]) for match, entry in together if match), default=None)
    for name, factor in _candidates(stage):
        label = stage.label.partition("-seed")[0]
        for character in (label, EXAMPLE):
            if entry := known.get(f"{name}-{character}"):
                plan = _example_plan(entry.profile)
                timed = plan[name] if name in plan else None
                growth = 1.0 if character == label else _growth(stage)
                return entry.wall_s * factor * growth * (work(stage) / work(timed) if timed else 1.0)
    return None


def work(stage: Stage) -> float:
    """Return what a stage's time is proportional to: steps times batch, samples, or iterations times poses; else 1."""
    section, config = getattr(stage.config, "section", None), stage.config
    if training := getattr(section, "training", None):
        return float(training.steps * training.batch)
    if stage.name == "samples":
        return float(section.count)
    if hasattr(config, "iterations"):
        return float(config.samples * (config.iterations + config.relaxed))
    return 1.0


def _growth(stage: Stage) -> float:
    """Return how many times as long as the teen's a stage takes because of more controls; 1 for fewer controls."""
    rig = next((source for source in in_order([stage]) if source.name == "rig"), None)
    if rig is None or stage.name not in GROWTH:
        return 1.0
    rigs = (rig, artefacts.rig_stage(Plan(resolve(EXAMPLE))))
    controls, example_controls = (control_count(rig.config.recipe, rig.files) for rig in rigs)
    return max(1.0, controls / example_controls) ** GROWTH[stage.name]


def _candidates(stage: Stage) -> list[tuple[str, float]]:
    """Return the names of stages to estimate a stage's time by, with a factor for each; its name comes first."""
    names = [(stage.name, 1.0), *([KIN[stage.name]] if stage.name in KIN else [])]
    base = stage.name.split("_")[0]
    if base == "errors":
        names.append(("errors_coarse", 1.0))
    elif base in ("typical", "ranked"):
        names.append(("wrinkled", 1.0))
    elif base != stage.name and stage.name not in KIN and hasattr(getattr(stage.config, "section", None), "training"):
        names.append((base, 1.0))  # coarse_line, dense_released, …
    return names


@cache
def _example_plan(profile: str) -> Plan:
    """Return the plan of the teen with all methods' stages in a profile."""
    config = resolve(EXAMPLE, profile, sections=sections(profile))
    plan = Plan(config)
    for method in all_methods(config).values():
        method.stages(plan)
    return plan
