"""One character's rows of Table 4, from its rig, its methods' models and its IK networks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from data_recipes.rig import Rig
from replicate.approximation.metrics import Errors, evaluate, summary, unique_poses
from replicate.base.exceptions import RunError
from replicate.engine.stage import stream_rng
from replicate.inverse import ik_stage
from replicate.inverse.configurations import configurations, scripted_drags, targets_of
from replicate.inverse.control_points import ControlPoints, InverseConfig, control_points
from replicate.inverse.ik_network import parameter_ranges
from replicate.inverse.posing import Posed, RigPoints, outside_share, point_errors_mm, pose
from replicate.inverse.solver import agreement_by_region, jacobians, solve
from replicate.methods import artefacts
from replicate.methods.measurement import MeasurementSettings, predictor
from replicate.report.results import Row, run_name, write_results

# The settings of Table 4's stage.


@dataclass(frozen=True)
class Source:
    """What IK networks are trained through: a method and "module:function" of its model, which is "" for the rig."""

    name: str
    model: str


@dataclass(frozen=True)
class PosingSettings:
    """The settings of Table 4's stage.

    character, profile, seed: for the columns of its rows
    section: the configuration of inverse kinematics
    methods: the methods that are measured
    sources: what IK networks are trained through
    own_gradients: whether the paper's protocol takes each method's parameters from networks trained through itself
    """

    character: str
    profile: str
    seed: int
    section: InverseConfig
    methods: tuple[MeasurementSettings, ...]
    sources: tuple[Source, ...]
    own_gradients: bool


ROWS = "table4.csv"
LIMITED = "_limited"  # the ending of errors at parameters that are clipped to their controls' limits
FED_BY = ("refined", "coarse")  # networks trained through the first of these pose all methods; the paper's is refined
RECOVERED, DERIVATIVES = 200, 25  # test poses whose points are solved for, and whose derivatives are compared
FRESH, RESAMPLES = 100, 2_000  # further drags, drawn by a script; resamples of them for an interval
FRESH_ENDING = "_fresh"  # of errors in these drags, at parameters that are clipped to their controls' limits
OWN = "own"  # in poses of networks that are trained through each method itself
COMPARED = ("refined", "dense")  # whose ratio of errors has an interval
INTERVAL = {"_low": 2.5, "_high": 97.5}  # percentiles
Metric = tuple[str, str, str, float, int]  # method, metric, unit, value, poses


def write_all(
    settings: PosingSettings, inputs: Mapping[str, Path], files: Sequence[Path], progress: Callable, out: Path
) -> None:
    """Write a character's rows to a folder.

    inputs: folders of artefacts by the names of their stages
    files: the file of its drags, or none: then they are drawn by a script
    progress: (total, label) → a context manager
    """
    rig = artefacts.load_rig(inputs)
    points = control_points(rig, artefacts.load_influence(inputs))
    targets = configurations(rig, points, files)
    metrics: list[Metric] = []
    with progress(2 * len(settings.sources), "posing") as bar:
        posed = {}
        for source in settings.sources:
            params = _answers(settings, inputs, source, targets)
            posed[source.name] = pose(rig, params)
            metrics += _approximations(settings, inputs, rig, source, posed[source.name])
            limited = pose(rig, np.clip(params, rig.lower, rig.upper))
            metrics += _approximations(settings, inputs, rig, source, limited, LIMITED)
            bar.update(1)
        for source in settings.sources:
            metrics += _points(settings, inputs, rig, points, source, posed[source.name], targets)
            bar.update(1)
    metrics += _fresh(settings, inputs, rig, points)
    metrics += _derivatives(settings, inputs, rig, points)
    run = run_name(inputs)
    facts = settings.profile, run
    rows = [
        Row("table4", settings.character, method, metric, unit, float(value), None, 1, poses, *facts)
        for method, metric, unit, value, poses in metrics
    ]
    write_results(out / ROWS, rows)


def _answers(settings: PosingSettings, inputs: Mapping[str, Path], source: Source, points: np.ndarray) -> np.ndarray:
    """Return rig parameters (b, m) by a source's IK networks for control points (b, c, 3), mm.

    Raises RunError where they are not finite: such a pose has no error, and the table would hide it in a mean.
    """
    params = ik_stage.load(inputs, source.name).solve(points)
    bad = int((~np.isfinite(params)).any(1).sum())
    if bad:
        advice = "" if source.name == ik_stage.RIG else f"; METHODS without {source.name} gives the other rows"
        raise RunError(
            f"{settings.character}: the IK networks trained through {source.name} answer {bad} of {len(params)} "
            f"configurations of control points with parameters that are not finite{advice}"
        )
    return params


def feeder(settings: PosingSettings, method: str) -> str:
    """Return the source of the IK networks whose poses a method is measured in under the paper's protocol."""
    names = [source.name for source in settings.sources]
    common = next((name for name in FED_BY if name in names), names[0])
    return method if settings.own_gradients and method in names else common


def _errors(settings: PosingSettings, inputs: Mapping[str, Path], rig: Rig, posed: Posed) -> dict[str, Errors]:
    """Return each method's errors against the rig, both at the parameters of `posed`; equal poses count once."""
    predictors = {entry.method: predictor(entry, inputs) for entry in settings.methods}
    return evaluate(rig.mesh, posed.params, posed.vertices - rig.mesh.neutral, predictors)


def _approximations(
    settings: PosingSettings, inputs: Mapping[str, Path], rig: Rig, source: Source, posed: Posed, ending: str = ""
) -> list[Metric]:
    """Return every method's errors in the poses of a source's IK networks. ending: of the metrics' names."""
    metrics = []
    for method, errors in _errors(settings, inputs, rig, posed).items():
        for kind, unit, tally in (("vertex", "mm", errors.vertex), ("normal", "deg", errors.normal)):
            mean, count = summary(tally).mean, len(errors.pose_mm)
            metrics.append((method, f"{kind}_error_mean{ending}[{source.name}]", unit, mean, count))
            if feeder(settings, method) == source.name:
                metrics.append((method, f"{kind}_error_mean{ending}", unit, mean, count))
    return metrics


def _fresh(settings: PosingSettings, inputs: Mapping[str, Path], rig: Rig, points: ControlPoints) -> list[Metric]:
    """Return the methods' errors in drags that a script draws, the same for all seeds, within the controls' limits.

    Each method is measured in poses of its own IK networks, of those that the paper's protocol shares, and of those
    that are trained through the rig, which favour none. The ratio of the CNN's errors to those of dense networks has a
    95 % interval by the bootstrap over drags.
    """
    drags = scripted_drags(points.names, stream_rng(0, "table4", "fresh"), FRESH)
    targets = targets_of(rig.mesh.neutral[points.vertices], points.names, drags)
    sources = [source.name for source in settings.sources]
    errors: dict[tuple[str, str, str], np.ndarray] = {}  # method, kind, source → of each drag
    for source in settings.sources:
        posed = pose(rig, np.clip(_answers(settings, inputs, source, targets), rig.lower, rig.upper))
        of_drag = _first_alike(posed.params)
        for method, found in _errors(settings, inputs, rig, posed).items():
            errors[method, "vertex", source.name] = found.pose_mm[of_drag]
            errors[method, "normal", source.name] = found.pose_deg[of_drag]
    metrics, shared = [], next((name for name in FED_BY if name in sources), sources[0])
    for way in dict.fromkeys((OWN, shared, ik_stage.RIG)):
        for kind, unit in (("vertex", "mm"), ("normal", "deg")):
            by_method = {
                entry.method: errors[entry.method, kind, entry.method if way == OWN else way]
                for entry in settings.methods
                if way != OWN or entry.method in sources
            }
            name = f"{kind}_error_mean{FRESH_ENDING}[{way}]"
            metrics += [(method, name, unit, values.mean(), FRESH) for method, values in by_method.items()]
            if all(method in by_method for method in COMPARED):
                pair = [by_method[method] for method in COMPARED]
                metrics += [
                    (COMPARED[0], f"{kind}_error_ratio{FRESH_ENDING}{ending}[{way}]", "ratio", value, FRESH)
                    for ending, value in resampled_ratio(*pair).items()
                ]
    return metrics


def _first_alike(params: np.ndarray) -> np.ndarray:
    """Return, for each pose, its place among the unique ones in the order of their first appearance."""
    _, first, which = np.unique(params, axis=0, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[which.ravel()]


def resampled_ratio(errors: Float[np.ndarray, " k"], others: Float[np.ndarray, " k"]) -> dict[str, float]:
    """Return the ratio of two means over the same drags, "", and its 95 % interval by the bootstrap over drags."""
    chosen = stream_rng(0, "table4", "bootstrap").integers(len(errors), size=(RESAMPLES, len(errors)))
    ratios = errors[chosen].mean(1) / others[chosen].mean(1)
    ends = {ending: float(np.percentile(ratios, percentile)) for ending, percentile in INTERVAL.items()}
    return {"": float(errors.mean() / others.mean())} | ends


def _points(
    settings: PosingSettings,
    inputs: Mapping[str, Path],
    rig: Rig,
    points: ControlPoints,
    source: Source,
    posed: Posed,
    targets: np.ndarray,
) -> list[Metric]:
    """Return how well the IK networks of a source bring the rig's points to their targets."""
    section, name, count = settings.section, source.name, len(targets)
    axes = section.coordinates
    samples = artefacts.load_samples(inputs)
    rows = unique_poses(samples.test_params)
    rows = rows[np.linspace(0, len(rows) - 1, min(RECOVERED, len(rows))).astype(int)]
    truth = rig.mesh.neutral[points.vertices] + np.asarray(samples.test_offsets[rows][:, points.vertices], np.float32)
    again = pose(rig, _answers(settings, inputs, source, truth))
    ranges, positions = parameter_ranges(rig), ik_stage.positions(inputs, source.model, points.vertices)
    limits = rig.default, rig.lower, rig.upper, ranges, points.driven(), axes, section.regularisation
    solved = pose(rig, solve(positions, targets, *limits).params)
    return [
        (name, "point_error_mean", "mm", point_errors_mm(posed, targets, points, axes).mean(), count),
        (name, "point_error_mean[solver]", "mm", point_errors_mm(solved, targets, points, axes).mean(), count),
        (name, "recovered_error_mean", "mm", point_errors_mm(again, truth, points, axes).mean(), len(rows)),
        (name, "outside_limits", "ratio", outside_share(rig, posed, points), count),
    ]


def _derivatives(settings: PosingSettings, inputs: Mapping[str, Path], rig: Rig, points: ControlPoints) -> list[Metric]:
    """Return how well each approximation's derivative agrees with the rig's over test poses, region by region."""
    samples = artefacts.load_samples(inputs)
    rows = unique_poses(samples.test_params)
    params = samples.test_params[rows[np.linspace(0, len(rows) - 1, min(DERIVATIVES, len(rows))).astype(int)]]
    exact, ranges = jacobians(RigPoints(rig, points.vertices), params), parameter_ranges(rig)
    metrics = []
    for source in settings.sources:
        if not source.model:
            continue
        approximated = jacobians(ik_stage.positions(inputs, source.model, points.vertices), params)
        for region, agreement in agreement_by_region(approximated, exact, ranges, points.regions).items():
            suffix = f"[{region}]" if region else ""
            metrics.append((source.name, f"derivative_cosine{suffix}", "ratio", agreement.cosine, len(params)))
            metrics.append((source.name, f"derivative_size{suffix}", "ratio", agreement.size, len(params)))
    return metrics
