"""The artefacts "ranked" and "typical_…": the median and the worst test pose, as each method predicts them.

The rule is the same for all characters: test poses are ranked by the mean normal error (Eq. 11) of the refined method,
or else of the coarse one, or else of the first in the table. Poses that are known already can be taken instead.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts, measurement
from replicate.methods.measurement import MeasurementSettings, measured_poses, predictor, reading
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference

RANKED_BY = ("refined", "coarse")
MEDIAN, WORST = "median", "worst"
CHOICES = (MEDIAN, WORST)
PREFIX = "typical_"
CHOSEN, POSES = "poses.json", "poses.npy"


@dataclass(frozen=True)
class RankingSettings:
    """Which method ranks the test poses, and which of them it was measured on."""

    method: str
    test_poses: int
    seed: int


@dataclass(frozen=True)
class KnownPoses:
    """The indices of the median and the worst test pose, and the method that ranked them."""

    ranked_by: str
    median: int
    worst: int


def ranking_method(methods: Sequence[Method]) -> Method:
    """Return the method whose errors rank the test poses."""
    by_name = {method.name: method for method in methods}
    return next((by_name[name] for name in RANKED_BY if name in by_name), methods[0])


def ranking_stage(plan: Plan, methods: Sequence[Method]) -> Stage:
    """Return the stage that chooses the median and the worst test pose."""
    method = ranking_method(methods)
    settings = RankingSettings(method.name, method.poses(plan.config), plan.config.seed)
    return plan.stage("ranked", rank, settings, artefacts.samples_stage(plan), measurement.stage(plan, method))


def stages(plan: Plan, methods: Sequence[Method], known: KnownPoses | None = None) -> list[Stage]:
    """Return the stage that chooses the poses and, for each method that figures show, the stage that predicts them.

    known: poses to take if the method that ranked them is not among `methods`.
    """
    if not methods:
        return []
    if known and known.ranked_by not in {method.name for method in methods}:
        ranked = plan.stage("ranked", take, known, artefacts.samples_stage(plan))
    else:
        ranked = ranking_stage(plan, methods)
    return [ranked, *(_prediction(plan, method, ranked) for method in methods if method.in_figures)]


def _prediction(plan: Plan, method: Method, ranked: Stage) -> Stage:
    measured = measurement.stage(plan, method)
    functions = ", ".join(map(reference, (predict, *reading(method, plan.config).sources)))
    return plan.stage(f"{PREFIX}{method.name}", functions, measured.config, ranked, *measured.inputs)


def rank(context: StageContext) -> None:
    """Choose the median and the worst test pose."""
    settings, samples = context.config, artefacts.load_samples(context.inputs)
    poses = measured_poses(samples.test_params, settings.test_poses, settings.seed)
    errors = measurement.load_errors(measurement.error_folders(context.inputs)[settings.method]).pose_deg
    order = poses[np.argsort(errors, kind="stable")]
    chosen = KnownPoses(settings.method, int(order[(len(order) - 1) // 2]), int(order[-1]))
    _write_chosen(context.out, chosen)


def take(context: StageContext) -> None:
    """Take known poses."""
    _write_chosen(context.out, context.config)


def predict(context: StageContext) -> None:
    """Predict the median and the worst test pose with one method."""
    settings: MeasurementSettings = context.config
    mesh, samples = artefacts.load_mesh(context.inputs), artefacts.load_samples(context.inputs)
    rows = [load_chosen(context.inputs)[1][choice] for choice in CHOICES]
    truth = mesh.neutral + np.asarray(samples.test_offsets[rows], np.float32)
    predicted = predictor(settings, context.inputs)(samples.test_params[rows], truth)
    np.save(context.out / POSES, np.asarray(predicted, np.float32))


def _write_chosen(out: Path, chosen: KnownPoses) -> None:
    text = json.dumps({"ranked_by": chosen.ranked_by, "poses": {MEDIAN: chosen.median, WORST: chosen.worst}})
    (out / CHOSEN).write_text(text + "\n", encoding="utf-8")


def load_chosen(inputs: Mapping[str, Path]) -> tuple[str, dict[str, int]]:
    """Return the name of the method that ranked the test poses, and the index of each of `CHOICES`."""
    stored = json.loads((inputs["ranked"] / CHOSEN).read_text(encoding="utf-8"))
    return stored["ranked_by"], stored["poses"]


def load_predictions(inputs: Mapping[str, Path], choice: str) -> dict[str, Float32[np.ndarray, "n 3"]]:
    """Return one of `CHOICES` as each method predicts it, in mm, by the methods' names."""
    row = CHOICES.index(choice)
    names = [name for name in inputs if name.startswith(PREFIX) and "-" not in name]
    return {name.removeprefix(PREFIX): np.load(inputs[name] / POSES, allow_pickle=False)[row] for name in names}
