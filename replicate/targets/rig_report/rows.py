"""One character's rows of the rig report: held-out errors, components, controls a vertex, interaction, map sizes."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float64, Int

from data_recipes.rig import Rig, has_function
from replicate.approximation import metrics
from replicate.approximation.metrics import Errors, evaluate, normal_error, summary, unique_poses
from replicate.approximation.rigid import attach
from replicate.base.tables import Column, read_csv, write_csv
from replicate.config import ReportFitsConfig
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.methods.measurement import measured_poses
from replicate.methods.plan import Plan
from replicate.report.results import Row, error_rows, run_name
from replicate.rig_study.interaction import Interaction, acting_steps, draw_pairs, interaction, no_interaction

if TYPE_CHECKING:
    import pandas

    import replicate.approximation.samples
    import replicate.baselines.ridge


@dataclass(frozen=True)
class ReportSettings:
    """The settings of the stage that writes a character's report: the labels of its rows."""

    character: str
    profile: str
    seed: int


TABLE, SEGMENTS = "rig_report", "rig_report_segments"
LIMIT_MM = 0.1  # a pair whose mixed difference is larger somewhere interacts


@dataclass(frozen=True)
class Entry:
    """A value of a row, without the columns that all rows share. segment: "" for the whole mesh."""

    method: str
    metric: str
    unit: str
    value: float
    poses: int | None = None
    segment: str = ""


def rows_of(settings: ReportSettings, inputs: Mapping[str, Path]) -> list[Row]:
    """Return a character's rows.

    inputs: the folders of the stages "rig", "influence", "rigid", "rig_fits", "rig_pairs" and "rig_maps".
    """
    run = run_name(inputs)
    rows = [
        replace(row, table=row.table.replace("table2", TABLE))
        for row in error_rows(settings.character, load_errors(inputs), settings.profile, run)
    ]
    mesh, influence = artefacts.load_mesh(inputs), artefacts.load_influence(inputs)
    segments = artefacts.load_coarse_segments(inputs, mesh)
    entries = [
        *_fit_entries(load_facts(inputs)),
        *_control_entries(influence, {segment.name: segment.vertices for segment in segments}),
        *_pair_entries(load_pairs(inputs)),
        *_map_entries(load_map_floors(inputs), {segment.name: len(segment.vertices) for segment in segments}),
    ]
    return rows + [_row(entry, settings, run) for entry in entries]


def _row(entry: Entry, settings: ReportSettings, run: str) -> Row:
    table, metric = (SEGMENTS, f"{entry.metric}[{entry.segment}]") if entry.segment else (TABLE, entry.metric)
    facts = (entry.unit, float(entry.value), None, 1, entry.poses, settings.profile, run)
    return Row(table, settings.character, entry.method, metric, *facts)


def _fit_entries(facts: dict) -> Iterator[Entry]:
    """Yield the samples, strengths and features of the fits, and counts of components where enough exist."""
    for name, features in facts["features"].items():
        yield Entry(name, "features", "count", features)
        yield Entry(name, "samples", "count", facts["samples"])
        yield Entry(name, "strength", "ratio", facts["strengths"][name])
    yield Entry("basis", "components", "count", facts["components"])
    for share, count in facts["of_variance"].items():
        if count is not None:
            yield Entry("basis", f"components[{share} % of variance]", "count", count)
    for limit, count in facts["within_deg"].items():
        if count is not None:
            yield Entry("basis", f"components[{limit} degrees]", "count", count, facts["component_poses"])


def _control_entries(influence: np.ndarray, vertices: Mapping[str, np.ndarray]) -> Iterator[Entry]:
    """Yield how many controls move a vertex, over all vertices and over those of each segment."""
    counts = influence.sum(1)
    yield Entry("influence", "controls", "count", influence.shape[1])
    for name, members in {"": slice(None), **vertices}.items():
        for statistic in ("mean", "median", "max"):
            value = float(getattr(np, statistic)(counts[members]))
            yield Entry("influence", f"controls_per_vertex_{statistic}", "count", value, segment=name)


def _pair_entries(pairs: Interaction) -> Iterator[Entry]:
    poses = len(pairs.mixed_mm)
    if not poses:
        return  # the rig has no function to try
    yield Entry("pairs", "pairs", "count", len(pairs.pairs))
    kinds = {"": slice(None), "[default]": slice(0, 1), "[animation]": slice(1, None)}
    for kind, rows in kinds.items():
        count = len(range(poses)[rows])
        if count:
            yield Entry("pairs", f"interacting_share{kind}", "ratio", pairs.share_above(LIMIT_MM, rows), count)
            yield Entry("pairs", f"mixed_over_single{kind}", "ratio", pairs.ratio(rows), count)
    if len(pairs.pairs):
        yield Entry("pairs", "mixed_difference_max", "mm", pairs.mixed_mm.max(), poses)


def _map_entries(floors: Mapping[int, Errors], vertices: Mapping[str, int]) -> Iterator[Entry]:
    """Yield the mean errors of each map size and the vertices per texel, over the whole mesh and by segment."""
    for size, errors in floors.items():
        poses, groups = len(errors.pose_mm), {"": None, **{n: k for k, n in enumerate(errors.group_names)}}
        for name, group in groups.items():
            for kind, unit, tally in (("vertex", "mm", errors.vertex), ("normal", "deg", errors.normal)):
                statistics = summary(tally, group)
                if statistics.count:
                    yield Entry("maps", f"{kind}_error_mean[{size}]", unit, statistics.mean, poses, name)
        for name, count in vertices.items():
            yield Entry("maps", f"vertices_per_texel[{size}]", "ratio", count / size**2, segment=name)
        texels = len(vertices) * size**2
        yield Entry("maps", f"vertices_per_texel[{size}]", "ratio", sum(vertices.values()) / texels)


# The stage "rig_pairs": how much two controls change each other's effect, and the pairs that do it most.

FILE = "interaction.npz"
STRONGEST = 10
LENGTHS = ("mixed_mm", "first_mm", "second_mm")
PAIR_COLUMNS = (
    *map(Column, ("first", "second", "segment", "pose")),
    *(Column(name, "finite number") for name in LENGTHS),
)


def pairs_stage(plan: Plan) -> Stage:
    """Return the stage that tries pairs of controls."""
    modules = (artefacts.rig_stage, artefacts.samples_stage, artefacts.influence_stage, artefacts.rigid_stage)
    inputs = (stage(plan) for stage in modules)
    return plan.stage("rig_pairs", measure_pairs, plan.settings(plan.config.rig_report.pairs), *inputs)


def measure_pairs(context: StageContext) -> None:
    """Measure how pairs of controls that move the same segment interact, in the default pose and in some test poses.

    A rig that is known by its samples alone can't be tried and gets no pairs.
    """
    section, inputs = context.config.section, context.inputs
    rig, samples, influence = (
        artefacts.load_rig(inputs),
        artefacts.load_samples(inputs),
        artefacts.load_influence(inputs),
    )
    frames = samples.test_params[unique_poses(samples.test_params)]
    some = context.rng("poses").choice(len(frames), min(section.poses, len(frames)), replace=False)
    if not has_function(rig):
        differences = no_interaction(len(rig.mesh.neutral), len(rig.controls))
        np.savez(context.out / FILE, **{entry.name: getattr(differences, entry.name) for entry in fields(differences)})
        context.note(pairs=0, poses=0)
        return
    segments = artefacts.load_coarse_segments(inputs, rig.mesh)
    pairs = draw_pairs([segment.parameters for segment in segments], section.count, context.rng("pairs"))
    poses = np.concatenate([rig.default[None], frames[np.sort(some)]])
    differences = interaction(rig, poses, acting_steps(rig, frames), pairs, influence, context.progress)
    np.savez(context.out / FILE, **{entry.name: getattr(differences, entry.name) for entry in fields(differences)})
    context.note(pairs=len(pairs), poses=len(poses), ratio=differences.ratio())


def load_pairs(inputs: Mapping[str, Path]) -> Interaction:
    """Return the differences of all pairs; the first pose is the default one."""
    with np.load(inputs["rig_pairs"] / FILE, allow_pickle=False) as stored:
        return Interaction(**{entry.name: stored[entry.name] for entry in fields(Interaction)})


def strongest_pairs(rig: Rig, pairs: Interaction) -> list[tuple]:
    """Return a line of `PAIR_COLUMNS` for each of the strongest pairs: two controls, segment, pose and lengths in mm.

    The lengths are the largest of any vertex: of the mixed difference, and of either control alone in that pose.
    """
    if not len(pairs.mixed_mm):
        return []
    row = pairs.mixed_mm.argmax(0)  # (q,), the pose
    largest = pairs.mixed_mm.max(0)
    lines = []
    for k in np.argsort(-largest, kind="stable")[:STRONGEST]:
        pose, (i, j) = row[k], pairs.pairs[k]
        segment = rig.mesh.segment_names[rig.mesh.segment[pairs.place[pose, k]]]
        lengths = (largest[k], pairs.single_mm[pose, i], pairs.single_mm[pose, j])
        names = (rig.controls[i].name, rig.controls[j].name, segment, "animation" if pose else "default")
        lines.append((*names, *map(float, lengths)))
    return lines


def write_pairs(file: Path, lines: list[tuple]) -> None:
    """Write the strongest pairs as CSV."""
    write_csv(file, PAIR_COLUMNS, lines)


def read_pairs(file: Path) -> "pandas.DataFrame":
    """Read what `write_pairs` wrote. Raises InputError, naming the file, for anything else."""
    return read_csv(file, PAIR_COLUMNS, (), "there is no such file; `make rig-report` writes it.")


# The stage "rig_maps": what deformation maps of several sizes can hold of held-out poses, by least squares.


def maps_stage(plan: Plan) -> Stage:
    """Return the stage that projects test poses onto maps of several sizes."""
    modules = (artefacts.rig_stage, artefacts.samples_stage, artefacts.influence_stage, artefacts.rigid_stage)
    inputs = (stage(plan) for stage in modules)
    return plan.stage("rig_maps", measure_maps, plan.settings(plan.config.rig_report.maps), *inputs)


def measure_maps(context: StageContext) -> None:
    """Measure the floor of each map size on test poses; rigid segments follow their attachments, as in Table 2."""
    from replicate.approximation.deformation_map import Floor

    section, inputs = context.config.section, context.inputs
    mesh, samples, attachments = (
        artefacts.load_mesh(inputs),
        artefacts.load_samples(inputs),
        artefacts.load_attachments(inputs),
    )
    segments = artefacts.load_coarse_segments(inputs, mesh)
    poses = unique_poses(samples.test_params)
    poses = poses[:: -(-len(poses) // section.poses)]
    truth, rigid = (samples.test_params[poses], samples.test_offsets[poses]), attachments.segment.tolist()
    with context.progress(len(section.sizes) * len(poses), "rig report, maps") as bar:
        for size in section.sizes:
            floor = Floor(segments, size)

            def on_maps(params: np.ndarray, vertices: np.ndarray, floor: Floor = floor) -> np.ndarray:
                return attach(mesh, attachments, mesh.neutral + floor(vertices - mesh.neutral))

            evaluate(mesh, *truth, {"maps": on_maps}, rigid, progress=bar)["maps"].save(context.out / f"{size}.npz")


def load_map_floors(inputs: Mapping[str, Path]) -> dict[int, Errors]:
    """Return the errors of each map size, in pixels."""
    files = sorted(inputs["rig_maps"].glob("*.npz"), key=lambda file: int(file.stem))
    return {int(file.stem): metrics.load_errors(file) for file in files}


# The stage "rig_fits": what regressions from rig parameters to PCA coefficients miss of held-out poses.

METHODS = ("neutral", "linear", "squares", "products", "basis")
SHARES = (0.99, 0.999, 0.9999)  # of the variance, for which components are counted
LIMITS_DEG = (0.5, 0.25)  # of the mean normal error, for which components are counted
FACTS, SPECTRUM = "facts.json", "spectrum.npy"
CHUNK = 512  # samples at a time
TIMES = {"linear": 1, "squares": 1, "products": 8}  # steps of progress; the basis has 2, all errors 4


@dataclass(frozen=True)
class FitSettings:
    """The settings of the fits; with the last three they are measured on the same test poses as Table 2."""

    section: ReportFitsConfig
    test_poses: int
    batch: int
    seed: int


def fits_stage(plan: Plan) -> Stage:
    """Return the stage that fits and measures the regressions."""
    evaluation, modules = plan.config.evaluation, (artefacts.rig_stage, artefacts.samples_stage, artefacts.rigid_stage)
    settings = FitSettings(plan.config.rig_report.fits, evaluation.test_poses, evaluation.batch, plan.config.seed)
    return plan.stage("rig_fits", fit_regressions, settings, *(stage(plan) for stage in modules))


def fit_regressions(context: StageContext) -> None:
    """Fit the regressions, measure them on the test poses, and count the components that the poses need."""
    from replicate.baselines.ridge import principal_components

    settings, section = context.config, context.config.section
    mesh, samples = artefacts.load_mesh(context.inputs), artefacts.load_samples(context.inputs)
    rigid = artefacts.load_attachments(context.inputs).segment.tolist()
    poses = measured_poses(samples.test_params, settings.test_poses, settings.seed)
    with context.progress(6 + sum(TIMES.values()), "rig report, fits") as bar:
        some = _choose(context.rng("basis"), len(samples), section.basis_samples)
        basis = principal_components(samples.offsets(some), section.components)
        bar.update(2)
        some = _choose(context.rng("fits"), len(samples), section.samples)
        predictors, facts = fit_all(mesh, samples, basis, some, section.strengths, bar.update)
        truth = samples.test_params[poses], samples.test_offsets[poses]
        errors = evaluate(mesh, *truth, predictors, rigid, settings.batch)
        bar.update(4)
    for name, error in errors.items():
        error.save(context.out / f"{name}.npz")
    few = poses[:: -(-len(poses) // section.poses)]
    facts |= component_counts(basis, mesh, samples.test_offsets[few])
    (context.out / FACTS).write_text(json.dumps(facts) + "\n", encoding="utf-8")
    np.save(context.out / SPECTRUM, basis.variances / basis.total)
    context.note(**facts)


def fit_all(
    mesh: Mesh,
    samples: "replicate.approximation.samples.SampleSet",
    basis: "replicate.baselines.ridge.OffsetBasis",
    rows: Int[np.ndarray, " s"],
    strengths: tuple[float, ...],
    done: Callable[[int], None],
) -> tuple[dict[str, Callable], dict]:
    """Fit all regressions; return a predictor (parameters, truth) → vertices for each method, and facts of the fits.

    Each fit has the strength with the smallest error of the coefficients on the validation poses.

    basis: the principal components of offsets
    rows: indices of the training samples, (s,)
    strengths: the penalties to try
    done: called with a number of `TIMES` after each fit
    """
    from replicate.approximation.conditioning import parameter_scale
    from replicate.baselines.ridge import FITS, closest, feature_count, ridges

    scale, neutral = parameter_scale(samples.params), mesh.neutral
    inputs, held_out = samples.params[rows] / scale, samples.validation_params / scale
    parts = (rows[start : start + CHUNK] for start in range(0, len(rows), CHUNK))
    targets = np.concatenate([basis.project(samples.offsets(part)) for part in parts])
    goal = basis.project(samples.validation_offsets)
    predictors: dict[str, Callable] = {
        "neutral": lambda params, truth: np.repeat(neutral[None], len(params), axis=0),
        "basis": lambda params, truth: neutral + basis.restore(basis.project(truth - neutral)),
    }
    facts: dict = {"samples": len(rows), "strengths": {}, "features": {}}
    for name in FITS:
        fits = zip(strengths, ridges(name, inputs, targets, strengths), strict=True)
        facts["strengths"][name], fit = closest(fits, held_out, goal)
        facts["features"][name] = feature_count(name, inputs.shape[1])
        predictors[name] = lambda params, truth, fit=fit: neutral + basis.restore(fit(params / scale))
        done(TIMES[name])
    return {name: predictors[name] for name in METHODS}, facts


def component_counts(
    basis: "replicate.baselines.ridge.OffsetBasis", mesh: Mesh, offsets: Float[np.ndarray, "b n 3"]
) -> dict:
    """Return how many components reach a share of the variance, and a mean normal error on the poses of `offsets`.

    Counts are by share in percent ("of_variance") and by limit in degrees ("within_deg"), None if all components
    don't suffice; "curve" has the errors of 1, 2, 4, … components, in degrees.
    """
    from replicate.baselines.ridge import components_of_variance, components_within

    coefficients, truth = basis.project(offsets), mesh.neutral + np.asarray(offsets, np.float32)
    most = len(basis.variances)

    @cache
    def error(count: int) -> float:
        posed = mesh.neutral + basis.restore(coefficients[:, :count])
        return float(np.nanmean(normal_error(posed, truth, mesh.faces), dtype=np.float64))

    ladder = sorted({min(2**k, most) for k in range(most.bit_length() + 1)})
    return {
        "components": most,
        "component_poses": len(truth),
        "of_variance": {f"{100 * s:g}": components_of_variance(basis.variances, basis.total, s) for s in SHARES},
        "within_deg": {f"{limit:g}": components_within(error, most, limit) for limit in LIMITS_DEG},
        "curve": [(count, error(count)) for count in ladder],
    }


def load_errors(inputs: Mapping[str, Path]) -> dict[str, Errors]:
    """Return the errors of each of `METHODS`."""
    return {name: metrics.load_errors(inputs["rig_fits"] / f"{name}.npz") for name in METHODS}


def load_facts(inputs: Mapping[str, Path]) -> dict:
    """Return the samples, strengths and features of the fits, and the counts of components."""
    return json.loads((inputs["rig_fits"] / FACTS).read_text(encoding="utf-8"))


def load_spectrum(inputs: Mapping[str, Path]) -> Float64[np.ndarray, " c"]:
    """Return each component's share of the variance."""
    return np.load(inputs["rig_fits"] / SPECTRUM, allow_pickle=False)


def _choose(generator: np.random.Generator, count: int, most: int) -> Int[np.ndarray, " k"]:
    return np.sort(generator.choice(count, min(count, most), replace=False))
