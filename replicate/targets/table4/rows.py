"""One character's numbers of Table 4, from its rig, its methods' models and its IK networks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_recipes.rig import Rig
from replicate.approximation.metrics import summary, unique_poses
from replicate.inverse import ik_stage
from replicate.inverse.configurations import configurations
from replicate.inverse.control_points import ControlPoints, InverseConfig, control_points
from replicate.inverse.ik_network import parameter_ranges
from replicate.inverse.posing import Posed, RigPoints, approximation_errors, outside_share, point_errors_mm, pose
from replicate.inverse.solver import agreement_by_region, jacobians, solve
from replicate.methods import artefacts
from replicate.methods.measurement import MeasurementNumbers, predictor
from replicate.report.results import Row, run_name, write_results

# The settings of Table 4's stage.


@dataclass(frozen=True)
class Source:
    """What IK networks are trained through: a method's name and "module:function" of its model; "" for the rig."""

    name: str
    model: str


@dataclass(frozen=True)
class PosingNumbers:
    """Whose table it is, what is measured, and through what inverse kinematics sees the rig.

    own_gradients: whether the paper's protocol feeds each method by networks trained through itself.
    """

    character: str
    profile: str
    seed: int
    section: InverseConfig
    methods: tuple[MeasurementNumbers, ...]
    sources: tuple[Source, ...]
    own_gradients: bool


ROWS = "table4.csv"
LIMITED = "_limited"  # the ending of errors at parameters that are brought within their controls' limits
FED_BY = ("refined", "coarse")  # whose networks feed all methods: the full CNN's, as in the paper, or what there is
RECOVERED, DERIVATIVES = 200, 25  # test poses whose points are found again, and whose derivatives are compared
Number = tuple[str, str, str, float, int]  # method, metric, unit, value, poses


def write_all(
    settings: PosingNumbers, inputs: Mapping[str, Path], files: Sequence[Path], progress: Callable, out: Path
) -> None:
    """Write a character's rows to a folder.

    files: that of its drags, or none: then a script draws them. progress: (total, label) → a context manager.
    """
    rig = artefacts.load_rig(inputs)
    points = control_points(rig, artefacts.load_influence(inputs))
    targets = configurations(rig, points, files)
    numbers: list[Number] = []
    with progress(2 * len(settings.sources), "posing") as bar:
        posed = {}
        for source in settings.sources:
            params = ik_stage.load(inputs, source.name).solve(targets)
            posed[source.name] = pose(rig, params)
            numbers += _approximations(settings, inputs, rig, source, posed[source.name])
            limited = pose(rig, np.clip(params, rig.lower, rig.upper))
            numbers += _approximations(settings, inputs, rig, source, limited, LIMITED)
            bar.update(1)
        for source in settings.sources:
            numbers += _points(settings, inputs, rig, points, source, posed[source.name], targets)
            bar.update(1)
    numbers += _derivatives(settings, inputs, rig, points)
    run = run_name(inputs)
    facts = settings.profile, run
    rows = [
        Row("table4", settings.character, method, metric, unit, float(value), None, 1, poses, *facts)
        for method, metric, unit, value, poses in numbers
    ]
    write_results(out / ROWS, rows)


def feeder(settings: PosingNumbers, method: str) -> str:
    """Return through what the networks are trained that feed a method under the paper's protocol."""
    names = [source.name for source in settings.sources]
    common = next((name for name in FED_BY if name in names), names[0])
    return method if settings.own_gradients and method in names else common


def _approximations(
    settings: PosingNumbers, inputs: Mapping[str, Path], rig: Rig, source: Source, posed: Posed, ending: str = ""
) -> list[Number]:
    """Return every method's errors in the poses that a source leads to. ending: of the metrics' names."""
    rigid = artefacts.load_attachments(inputs).segment.tolist()
    predictors = {numbers.method: predictor(numbers, inputs) for numbers in settings.methods}
    numbers = []
    for method, errors in approximation_errors(rig, posed, predictors, rigid, 32).items():
        for kind, unit, tally in (("vertex", "mm", errors.vertex), ("normal", "deg", errors.normal)):
            mean, count = summary(tally).mean, len(errors.pose_mm)
            numbers.append((method, f"{kind}_error_mean{ending}[{source.name}]", unit, mean, count))
            if feeder(settings, method) == source.name:
                numbers.append((method, f"{kind}_error_mean{ending}", unit, mean, count))
    return numbers


def _points(
    settings: PosingNumbers,
    inputs: Mapping[str, Path],
    rig: Rig,
    points: ControlPoints,
    source: Source,
    posed: Posed,
    targets: np.ndarray,
) -> list[Number]:
    """Return how well the networks trained through a source bring the rig's points where they shall go."""
    section, name, count = settings.section, source.name, len(targets)
    axes = section.coordinates
    samples = artefacts.load_samples(inputs)
    rows = unique_poses(samples.test_params)
    rows = rows[np.linspace(0, len(rows) - 1, min(RECOVERED, len(rows))).astype(int)]
    truth = rig.mesh.neutral[points.vertices] + np.asarray(samples.test_offsets[rows][:, points.vertices], np.float32)
    again = pose(rig, ik_stage.load(inputs, name).solve(truth))
    ranges, positions = parameter_ranges(rig), ik_stage.positions(inputs, source.model, points.vertices)
    limits = rig.default, rig.lower, rig.upper, ranges, points.driven(), axes, section.regularisation
    solved = pose(rig, solve(positions, targets, *limits).params)
    return [
        (name, "point_error_mean", "mm", point_errors_mm(posed, targets, points, axes).mean(), count),
        (name, "point_error_mean[solver]", "mm", point_errors_mm(solved, targets, points, axes).mean(), count),
        (name, "recovered_error_mean", "mm", point_errors_mm(again, truth, points, axes).mean(), len(rows)),
        (name, "outside_limits", "ratio", outside_share(rig, posed, points), count),
    ]


def _derivatives(settings: PosingNumbers, inputs: Mapping[str, Path], rig: Rig, points: ControlPoints) -> list[Number]:
    """Return how well each approximation's derivative agrees with the rig's, region by region, over test poses."""
    samples = artefacts.load_samples(inputs)
    rows = unique_poses(samples.test_params)
    params = samples.test_params[rows[np.linspace(0, len(rows) - 1, min(DERIVATIVES, len(rows))).astype(int)]]
    exact, ranges = jacobians(RigPoints(rig, points.vertices), params), parameter_ranges(rig)
    numbers = []
    for source in settings.sources:
        if not source.model:
            continue
        own = jacobians(ik_stage.positions(inputs, source.model, points.vertices), params)
        for region, agreement in agreement_by_region(own, exact, ranges, points.regions).items():
            suffix = f"[{region}]" if region else ""
            numbers.append((source.name, f"derivative_cosine{suffix}", "ratio", agreement.cosine, len(params)))
            numbers.append((source.name, f"derivative_size{suffix}", "ratio", agreement.size, len(params)))
    return numbers
