"""Move new meshes and other characters' faces, and measure every way to move them on test poses (Fig. 13)."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32, Int

from data_recipes.rig import Rig
from replicate.approximation.segments import faces_within
from replicate.capture import landmark_rig
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts, coarse, measurement, refined
from replicate.methods.plan import Plan
from replicate.report.results import Row, run_name

if TYPE_CHECKING:
    import replicate.transfer.remeshing
    from replicate.approximation.model import SegmentedModel
    from replicate.transfer.landmark_alignment import AlignedFace
    from replicate.transfer.new_mesh_poses import SourcePoses


MEANS = "means.json"
ORIGINAL = "original"


@dataclass(frozen=True)
class MovedSettings:
    """The settings of the stage "moved_meshes".

    test_poses: the number of poses to measure on, 0 for all
    batch: poses at a time
    shifts: how far charts are shifted, in pixels of the coarse maps
    turns_deg: how far charts are turned about their middles
    draws: the number of random directions for each shift and turn
    moved_poses: the number of poses to measure shifted and turned charts on
    """

    test_poses: int
    batch: int
    seed: int
    shifts: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0, 4.0)
    turns_deg: tuple[float, ...] = (1.0, 2.0, 5.0)
    draws: int = 3
    moved_poses: int = 40


@dataclass(frozen=True)
class Mean:
    """A method's two mean errors on one mesh. charts: how far its charts are off, "shift 2 px", or ""."""

    mesh: str
    method: str
    charts: str
    distance_mm: float
    normal_deg: float
    poses: int


def moved_stage(plan: Plan) -> Stage:
    """Return the stage that moves the new meshes; its inputs include the stages of the networks."""
    settings = MovedSettings(plan.config.evaluation.test_poses, plan.config.evaluation.batch, plan.config.seed)
    modules = (
        artefacts.rig_stage,
        artefacts.samples_stage,
        artefacts.rigid_stage,
        artefacts.shown_pose_stage,
        meshes_stage,
    )
    networks = (coarse.stage(plan), refined.stage(plan))
    return plan.stage("moved_meshes", move_meshes, settings, *networks, *(stage(plan) for stage in modules))


def move_meshes(context: StageContext) -> None:
    """Measure how far the moved new meshes are from the truth, with charts that are aligned and that are off (§6)."""
    from replicate.approximation.training import prepare

    prepare("cpu")
    settings, inputs = context.config, context.inputs
    rows = measurement.measured_poses(artefacts.load_samples(inputs).test_params, settings.test_poses, settings.seed)
    few = rows[:: -(-len(rows) // settings.moved_poses)]
    passes = len(SHARES) * (len(rows) + len(few) * (len(settings.shifts) + len(settings.turns_deg)))
    with context.progress(passes + len(rows), "moved meshes") as bar:
        means = [*_on_the_original(inputs, rows, settings.batch, bar)]
        for name in SHARES:
            means += _aligned(inputs, name, rows, settings.batch, context.out, bar)
            means += _misaligned(inputs, name, few, settings, context.rng, bar)
    text = json.dumps([vars(mean) for mean in means], indent=1)
    (context.out / MEANS).write_text(text + "\n", encoding="utf-8")


def source_poses(inputs: Mapping[str, Path], rows: np.ndarray, batch: int) -> Iterator:
    """Yield test poses of the original mesh as `SourcePoses`, a batch at a time."""
    from replicate.transfer.new_mesh_poses import SourcePoses

    mesh, samples, model = artefacts.load_mesh(inputs), artefacts.load_samples(inputs), coarse.load_model(inputs)
    for start in range(0, len(rows), batch):
        chosen = rows[start : start + batch]
        params, truth = samples.test_params[chosen], mesh.neutral + np.asarray(samples.test_offsets[chosen], np.float32)
        yield SourcePoses(params, truth, mesh.neutral + model.offsets(params))


def _on_the_original(inputs: Mapping[str, Path], rows: np.ndarray, batch: int, bar) -> Iterator[Mean]:
    """Yield the models' errors on the mesh that they were trained on, over the same segments."""
    from replicate.transfer.new_mesh_poses import pose_means

    mesh, model = artefacts.load_mesh(inputs), refined.load_model(inputs)
    vertices = np.flatnonzero(np.isin(mesh.segment, deforming(inputs, mesh)))
    faces, errors = faces_within(mesh.faces, vertices, len(mesh.neutral)), {}
    for poses in source_poses(inputs, rows, batch):
        predicted = {"coarse": poses.predicted, "refined": mesh.neutral + model.offsets(poses.params)}
        predicted["neutral"] = np.broadcast_to(mesh.neutral, poses.truth.shape)
        for method, moved in predicted.items():
            batch_errors = pose_means(moved[:, vertices], poses.truth[:, vertices], faces)
            errors.setdefault(method, []).append(batch_errors)
        bar.update(len(poses.params))
    yield from (_mean(ORIGINAL, method, "", batches) for method, batches in errors.items())


def _aligned(inputs: Mapping[str, Path], name: str, rows: np.ndarray, batch: int, out: Path, bar) -> Iterator[Mean]:
    """Yield the errors of every way to move a new mesh, and write the pose that the figure shows."""
    from replicate.transfer.new_mesh_poses import errors_of_ways, ways_to_move

    mesh, new = artefacts.load_mesh(inputs), load_meshes(inputs)[name]
    faces = faces_of(mesh, deforming(inputs, mesh))
    counterpart = load_counterparts(inputs, name)
    ways = ways_to_move(mesh, faces, new, counterpart, coarse.load_model(inputs), refined.load_model(inputs))
    errors = {method: [] for method in ways}
    for poses in source_poses(inputs, rows, batch):
        for method, batch_errors in errors_of_ways(ways, new, poses).items():
            errors[method].append(batch_errors)
        bar.update(len(poses.params))
    (shown,) = source_poses(inputs, np.array([artefacts.load_shown_pose(inputs)]), 1)
    posed = {method: np.asarray(move(shown)[0], np.float32) for method, move in ways.items()}
    np.savez(_pose_file(out, name), allow_pickle=False, truth=new.places.mix(shown.truth)[0], **posed)
    np.savez(_pose_file(out, ORIGINAL), truth=shown.truth[0], coarse=shown.predicted[0])
    yield from (_mean(name, method, "", batches) for method, batches in errors.items())


def _misaligned(
    inputs: Mapping[str, Path], name: str, rows: np.ndarray, settings: MovedSettings, stream: Callable, bar
) -> Iterator[Mean]:
    """Yield the errors of the coarse model on charts that are shifted and turned.

    stream: name → random generator. All shifts have the same directions.
    """
    from replicate.transfer.new_mesh_poses import pose_means
    from replicate.transfer.transferred_model import shifted, transferred, turned

    model, new = coarse.load_model(inputs), load_meshes(inputs)[name]
    pixel = 1 / (model.networks[0].map_size - 1)
    moves = {f"shift {shift:g} px": partial(shifted, shift=shift * pixel) for shift in settings.shifts}
    moves |= {f"turn {angle:g} deg": partial(turned, angle_deg=angle) for angle in settings.turns_deg}
    batches = [(p.params, new.places.mix(p.truth)) for p in source_poses(inputs, rows, settings.batch)]
    for charts, move in moves.items():
        errors = []
        for draw in range(settings.draws):
            moved = transferred(model, move(new.mesh, rng=stream(f"charts {draw}")))
            for params, truth in batches:
                errors.append(pose_means(new.mesh.neutral + moved.offsets(params), truth, new.mesh.faces))
        bar.update(len(rows))
        yield _mean(name, "coarse", charts, errors, len(rows))


def _mean(mesh: str, method: str, charts: str, errors: list[np.ndarray], poses: int | None = None) -> Mean:
    every = np.concatenate(errors)
    distance_mm, normal_deg = every.mean(0).tolist()
    return Mean(mesh, method, charts, distance_mm, normal_deg, poses or len(every))


def load_means(inputs: Mapping[str, Path]) -> list[Mean]:
    """Return all mean errors."""
    return [Mean(**entry) for entry in json.loads((inputs["moved_meshes"] / MEANS).read_text(encoding="utf-8"))]


def load_moved_pose(inputs: Mapping[str, Path], name: str) -> dict[str, Float32[np.ndarray, "k 3"]]:
    """Return a mesh in the pose that figures show, by "truth" and the ways to move it, mm.

    name: a new mesh, or `ORIGINAL`, which has the truth and the coarse model's prediction.
    """
    with np.load(_pose_file(inputs["moved_meshes"], name), allow_pickle=False) as stored:
        return {method: stored[method] for method in stored.files}


def _pose_file(folder: Path, name: str) -> Path:
    return folder / f"{name}_pose.npz"


# The stage "new_meshes": the surface of the coarse networks' segments with half and a quarter of its vertices.

SHARES = {"half": 0.5, "quarter": 0.25}
POSES = 256  # training poses whose mean is the pose that is decimated


@dataclass(frozen=True)
class NewMeshSettings:
    """The new meshes' shares of the vertices, and the number of training poses whose mean is decimated."""

    shares: tuple[float, ...]
    poses: int = POSES


def meshes_stage(plan: Plan) -> Stage:
    """Return the stage that makes the new meshes."""
    inputs = (artefacts.rig_stage(plan), artefacts.samples_stage(plan), artefacts.rigid_stage(plan))
    return plan.stage("new_meshes", make_meshes, NewMeshSettings(tuple(SHARES.values())), *inputs)


def make_meshes(context: StageContext) -> None:
    """Make the new meshes, and find the face of the original that each of their faces follows."""
    from replicate.transfer.deformation_transfer import counterparts
    from replicate.transfer.remeshing import reach_of, remeshed
    from replicate.transfer.surface_places import Nearby, surface_ways

    mesh, sizes = artefacts.load_mesh(context.inputs), {}
    segments = deforming(context.inputs, mesh)
    faces = faces_of(mesh, segments)
    samples = artefacts.load_samples(context.inputs)
    some = np.linspace(0, len(samples) - 1, min(context.config.poses, len(samples))).astype(int)
    shape = mesh.neutral + samples.offsets(some).mean(0)
    ways, reach = surface_ways(mesh.neutral, faces), reach_of(mesh.neutral, faces)
    with context.progress(len(SHARES), "new meshes") as bar:
        for name, share in zip(SHARES, context.config.shares, strict=True):
            new = remeshed(mesh, segments, share, shape)
            new.save(context.out / f"{name}.npz")
            nearby = Nearby(new.places.mix(ways), ways, reach)
            followed = counterparts(new.mesh.neutral, new.mesh.faces, mesh.neutral, faces, nearby)
            np.save(context.out / f"{name}_counterparts.npy", followed.astype(np.int32))
            sizes[name] = len(new.mesh.neutral)
            bar.update(1)
    context.note(vertices=sizes)


def deforming(inputs: Mapping[str, Path], mesh: Mesh) -> list[int]:
    """Return the indices of the segments that coarse networks deform."""
    rigid = set(artefacts.load_attachments(inputs).segment.tolist())
    return [k for k in range(len(mesh.segment_names)) if k not in rigid]


def faces_of(mesh: Mesh, segments: list[int]) -> Int[np.ndarray, "f 3"]:
    """Return the mesh's faces that have all corners in the given segments."""
    return mesh.faces[np.isin(mesh.segment[mesh.faces], segments).all(1)]


def load_meshes(inputs: Mapping[str, Path]) -> "dict[str, replicate.transfer.remeshing.NewMesh]":
    """Return the new meshes by the names of `SHARES`."""
    from replicate.transfer.remeshing import NewMesh

    return {name: NewMesh.load(inputs["new_meshes"] / f"{name}.npz") for name in SHARES}


def load_counterparts(inputs: Mapping[str, Path], name: str) -> Int[np.ndarray, " g"]:
    """Return the face that each face of a new mesh follows, as an index into `faces_of`."""
    return np.load(inputs["new_meshes"] / f"{name}_counterparts.npy", allow_pickle=False)


# The stages "onto_…": every way to move another character's face with the networks of ours, and one pose to show.

ALIGNMENT, POSE = "alignment.json", "pose.npz"


@dataclass(frozen=True)
class OtherSettings:
    """The settings of a stage "onto_…": networks of `source` move the face of `other`; test_poses: 0 for all."""

    source: str
    other: str
    test_poses: int
    batch: int
    seed: int


def other_stages(plan: Plan, others: Sequence[str]) -> dict[str, Stage]:
    """Return the stages that move other characters' faces, by those characters' names."""
    modules = (coarse.stage, refined.stage, artefacts.rig_stage, artefacts.samples_stage, artefacts.shown_pose_stage)
    evaluation, made = plan.config.evaluation, {}
    for name in others:
        other = Plan(replace(plan.config, character=name))
        inputs = [*(stage(plan) for stage in modules), landmark_rig.stage(plan), landmark_rig.stage(other)]
        settings = OtherSettings(
            plan.character, other.character, evaluation.test_poses, evaluation.batch, plan.config.seed
        )
        made[other.character] = plan.stage(f"onto_{other.character}", move_others, settings, *inputs)
    return made


def move_others(context: StageContext) -> None:
    """Align the two faces, measure every way to move the other one, and write the pose that the figure shows."""
    from replicate.approximation.training import prepare
    from replicate.transfer.landmark_alignment import aligned, shared_marks
    from replicate.transfer.new_mesh_poses import ways_onto

    prepare("cpu")
    settings, inputs = context.config, context.inputs
    rig, other = (_rig(inputs, name) for name in (settings.source, settings.other))
    marks = shared_marks(rig, other)
    face = aligned(rig.mesh, other.mesh, marks)
    model = coarse.load_model(inputs)
    ways = ways_onto(rig.mesh, face, model, refined.load_model(inputs))
    means = _other_means(context, rig, other, model, face, ways)
    (context.out / MEANS).write_text(json.dumps([asdict(mean) for mean in means], indent=1) + "\n", encoding="utf-8")
    params = artefacts.load_samples(inputs).test_params[[artefacts.load_shown_pose(inputs)]]
    known = bool(_shared(rig, other))
    shown = _poses(rig, model, _with_shared(rig, other, params) if known else params)
    answer = other(_answers(rig, other, shown.params)) if known else other.mesh.neutral[None]
    posed = {name: np.asarray(move(shown)[0], np.float32) for name, move in ways.items()}
    facts = {
        "faces": face.new.mesh.faces,
        "own": np.asarray(answer[0, face.vertices], np.float32),
        "source": shown.truth[0],
        "head": other.mesh.neutral,
    }
    np.savez(context.out / POSE, allow_pickle=False, **facts, **posed)
    about = {"landmarks": len(marks.names), "scale": face.scale, "controls": len(_shared(rig, other))}
    context.note(**about, vertices=len(face.vertices))
    (context.out / ALIGNMENT).write_text(json.dumps(about) + "\n", encoding="utf-8")


def _other_means(
    context: StageContext, rig: Rig, other: Rig, model: "SegmentedModel", face: "AlignedFace", ways: Mapping
) -> list[Mean]:
    """Return the mean errors against the other rig at the same controls; none if the two share no control."""
    from replicate.transfer.new_mesh_poses import pose_means

    settings, test = context.config, artefacts.load_samples(context.inputs).test_params
    rows = measurement.measured_poses(test, settings.test_poses, settings.seed)
    if not _shared(rig, other):
        return []
    errors = {name: [] for name in ways}
    with context.progress(len(rows), f"onto {settings.other}") as bar:
        for start in range(0, len(rows), settings.batch):
            params = _with_shared(rig, other, test[rows[start : start + settings.batch]])
            poses = _poses(rig, model, params)
            truth = np.asarray(other(_answers(rig, other, params))[:, face.vertices], np.float32)
            for name, move in ways.items():
                errors[name].append(pose_means(move(poses), truth, face.new.mesh.faces))
            bar.update(len(params))
    return [_mean(settings.other, name, "", parts, len(rows)) for name, parts in errors.items()]


def _rig(inputs: Mapping[str, Path], character: str) -> Rig:
    return landmark_rig.load_landmark_rig({landmark_rig.NAME: inputs[f"{landmark_rig.NAME}-{character}"]})


def _poses(rig: Rig, model: "SegmentedModel", params: np.ndarray) -> "SourcePoses":
    from replicate.transfer.new_mesh_poses import SourcePoses

    neutral = rig.mesh.neutral
    return SourcePoses(params, np.asarray(rig(params), np.float32), neutral + model.offsets(params))


def _shared(rig: Rig, other: Rig) -> list[tuple[int, int]]:
    """Return the controls that both rigs name, as pairs of their indices."""
    theirs = {control.name: k for k, control in enumerate(other.controls)}
    return [(j, theirs[control.name]) for j, control in enumerate(rig.controls) if control.name in theirs]


def _with_shared(rig: Rig, other: Rig, params: Float32[np.ndarray, "b m"]) -> Float32[np.ndarray, "b m"]:
    """Return the parameters, with defaults for the controls that the other rig lacks."""
    kept = [j for j, _ in _shared(rig, other)]
    out = np.tile(rig.default, (len(params), 1)).astype(np.float32)
    out[:, kept] = params[:, kept]
    return out


def _answers(rig: Rig, other: Rig, params: Float32[np.ndarray, "b m"]) -> Float32[np.ndarray, "b k"]:
    """Return the other rig's parameters: the same values for the same controls, within its limits."""
    ours, theirs = np.array(_shared(rig, other)).T
    out = np.tile(other.default, (len(params), 1)).astype(np.float32)
    out[:, theirs] = params[:, ours]
    return np.clip(out, other.lower, other.upper)


def load_other_means(folder: Path) -> list[Mean]:
    """Return all mean errors of one other face."""
    return [Mean(**entry) for entry in json.loads((folder / MEANS).read_text(encoding="utf-8"))]


def load_alignment(folder: Path) -> dict[str, float]:
    """Return the numbers of landmarks and controls that both characters have, and the scale of offsets."""
    return json.loads((folder / ALIGNMENT).read_text(encoding="utf-8"))


def load_other_pose(folder: Path) -> dict[str, np.ndarray]:
    """Return the shown pose, mm, as arrays: the other face by every way to move it, and five more.

    own: as the other rig poses it, neutral without shared controls. faces: its triangles. source: the original, posed
    by its rig. head: the whole other character, neutral.
    """
    with np.load(folder / POSE, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


# The errors of Figure 13 as rows of results: every way to move every new mesh, with aligned charts and others.

TABLE = "figure13"


def rows_of(character: str, profile: str, inputs: Mapping[str, Path], means: Sequence[Mean]) -> list[Row]:
    """Return two rows for each `Mean`: vertex_error_mean[mesh] in mm and normal_error_mean[mesh] in degrees.

    For charts that are off a second bracket follows: [shift 2 px], in pixels of the coarse maps, or [turn 5 deg].
    """
    rows, run = [], run_name(inputs)
    for mean in means:
        where = f"[{mean.mesh}]" + (f"[{mean.charts}]" if mean.charts else "")
        for kind, unit, value in (("vertex", "mm", mean.distance_mm), ("normal", "deg", mean.normal_deg)):
            facts = (unit, value, None, 1, mean.poses, profile, run)
            rows.append(Row(TABLE, character, mean.method, f"{kind}_error_mean{where}", *facts))
    return rows
