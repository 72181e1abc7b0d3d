"""The stage "moved_meshes": every way to move the new meshes against the truth, on test poses, and one pose to show."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32, Int

from replicate.capture import landmark_rig
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts, coarse, measurement, refined
from replicate.methods.plan import Plan
from replicate.report.results import Row, run_name

if TYPE_CHECKING:
    import replicate.transfer.remeshing
    from data_recipes.rig import Rig
    from replicate.approximation.model import SegmentedModel
    from replicate.transfer.landmark_alignment import AlignedFace
    from replicate.transfer.new_mesh_poses import SourcePoses


MEANS = "means.json"
ORIGINAL = "original"


@dataclass(frozen=True)
class MovedNumbers:
    """What is measured: on how many test poses (0: all), and how far charts are moved off, on how many of the poses.

    shifts: in pixels of the coarse maps. turns_deg: about the middle of each chart. draws: random directions of each.
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
    """A method's two mean errors on one mesh; charts: how far its charts are off, as "shift 2 px", "" for not."""

    mesh: str
    method: str
    charts: str
    distance_mm: float
    normal_deg: float
    poses: int


def moved_stage(plan: Plan) -> Stage:
    """Return the stage that moves the new meshes; the networks' are among its inputs."""
    numbers = MovedNumbers(plan.config.evaluation.test_poses, plan.config.evaluation.batch, plan.config.seed)
    modules = (
        artefacts.rig_stage,
        artefacts.samples_stage,
        artefacts.rigid_stage,
        artefacts.shown_pose_stage,
        meshes_stage,
    )
    networks = (coarse.stage(plan), refined.stage(plan))
    return plan.stage("moved_meshes", move_meshes, numbers, *networks, *(stage(plan) for stage in modules))


def move_meshes(context: StageContext) -> None:
    """Measure how far the new meshes are from the truth, with charts that are aligned and charts that are not (§6)."""
    from replicate.approximation.training import prepare

    prepare("cpu")
    numbers, inputs = context.config, context.inputs
    rows = measurement.measured_poses(artefacts.load_samples(inputs).test_params, numbers.test_poses, numbers.seed)
    few = rows[:: -(-len(rows) // numbers.moved_poses)]
    passes = len(SHARES) * (len(rows) + len(few) * (len(numbers.shifts) + len(numbers.turns_deg)))
    with context.progress(passes + len(rows), "moved meshes") as bar:
        means = [*_on_the_original(inputs, rows, numbers.batch, bar)]
        for name in SHARES:
            means += _aligned(inputs, name, rows, numbers.batch, context.out, bar)
            means += _misaligned(inputs, name, few, numbers, context.rng, bar)
    text = json.dumps([vars(mean) for mean in means], indent=1)
    (context.out / MEANS).write_text(text + "\n", encoding="utf-8")


def source_poses(inputs: Mapping[str, Path], rows: np.ndarray, batch: int) -> Iterator:
    """Yield test poses of the original mesh, so many at a time, as `SourcePoses`."""
    from replicate.transfer.new_mesh_poses import SourcePoses

    mesh, samples, model = artefacts.load_mesh(inputs), artefacts.load_samples(inputs), coarse.load_model(inputs)
    for start in range(0, len(rows), batch):
        own = rows[start : start + batch]
        params, truth = samples.test_params[own], mesh.neutral + np.asarray(samples.test_offsets[own], np.float32)
        yield SourcePoses(params, truth, mesh.neutral + model.offsets(params))


def _on_the_original(inputs: Mapping[str, Path], rows: np.ndarray, batch: int, bar) -> Iterator[Mean]:
    """Yield the errors of the models on the mesh that they were trained on, on the same segments."""
    from replicate.approximation.segments import faces_within
    from replicate.transfer.new_mesh_poses import pose_means

    mesh, model = artefacts.load_mesh(inputs), refined.load_model(inputs)
    vertices = np.flatnonzero(np.isin(mesh.segment, deforming(inputs, mesh)))
    faces, errors = faces_within(mesh.faces, vertices, len(mesh.neutral)), {}
    for poses in source_poses(inputs, rows, batch):
        predicted = {"coarse": poses.predicted, "refined": mesh.neutral + model.offsets(poses.params)}
        predicted["neutral"] = np.broadcast_to(mesh.neutral, poses.truth.shape)
        for method, moved in predicted.items():
            own = pose_means(moved[:, vertices], poses.truth[:, vertices], faces)
            errors.setdefault(method, []).append(own)
        bar.update(len(poses.params))
    yield from (_mean(ORIGINAL, method, "", own) for method, own in errors.items())


def _aligned(inputs: Mapping[str, Path], name: str, rows: np.ndarray, batch: int, out: Path, bar) -> Iterator[Mean]:
    """Yield the errors of every way to move a new mesh, and write the pose that the figure shows."""
    from replicate.transfer.new_mesh_poses import errors_of_ways, ways_to_move

    mesh, new = artefacts.load_mesh(inputs), load_meshes(inputs)[name]
    faces = faces_of(mesh, deforming(inputs, mesh))
    counterpart = load_counterparts(inputs, name)
    ways = ways_to_move(mesh, faces, new, counterpart, coarse.load_model(inputs), refined.load_model(inputs))
    errors = {method: [] for method in ways}
    for poses in source_poses(inputs, rows, batch):
        for method, own in errors_of_ways(ways, new, poses).items():
            errors[method].append(own)
        bar.update(len(poses.params))
    (shown,) = source_poses(inputs, np.array([artefacts.load_shown_pose(inputs)]), 1)
    posed = {method: np.asarray(move(shown)[0], np.float32) for method, move in ways.items()}
    np.savez(_pose_file(out, name), allow_pickle=False, truth=new.places.mix(shown.truth)[0], **posed)
    np.savez(_pose_file(out, ORIGINAL), truth=shown.truth[0], coarse=shown.predicted[0])
    yield from (_mean(name, method, "", own) for method, own in errors.items())


def _misaligned(
    inputs: Mapping[str, Path], name: str, rows: np.ndarray, numbers: MovedNumbers, stream: Callable, bar
) -> Iterator[Mean]:
    """Yield the errors of the coarse model, read at texture coordinates that are off.

    stream: name → generator. Every shift has the same directions.
    """
    from replicate.transfer.new_mesh_poses import pose_means
    from replicate.transfer.transferred_model import shifted, transferred, turned

    model, new = coarse.load_model(inputs), load_meshes(inputs)[name]
    pixel = 1 / (model.networks[0].map_size - 1)
    moves = {f"shift {shift:g} px": partial(shifted, shift=shift * pixel) for shift in numbers.shifts}
    moves |= {f"turn {angle:g} deg": partial(turned, angle_deg=angle) for angle in numbers.turns_deg}
    batches = [(p.params, new.places.mix(p.truth)) for p in source_poses(inputs, rows, numbers.batch)]
    for charts, move in moves.items():
        errors = []
        for draw in range(numbers.draws):
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
    """Return a mesh in the pose that figures show: the truth, and every way to move it; mm.

    name: of a new mesh, or `ORIGINAL`, which has the truth and the coarse model's prediction.
    """
    with np.load(_pose_file(inputs["moved_meshes"], name), allow_pickle=False) as stored:
        return {method: stored[method] for method in stored.files}


def _pose_file(folder: Path, name: str) -> Path:
    return folder / f"{name}_pose.npz"


# The stage "new_meshes": the surface of the coarse networks' segments with half and a quarter of its vertices.

SHARES = {"half": 0.5, "quarter": 0.25}
POSES = 256  # of the training, whose mean is the pose that is decimated


@dataclass(frozen=True)
class NewMeshNumbers:
    """Which shares of the vertices the new meshes have, and of how many training poses the mean is decimated."""

    shares: tuple[float, ...]
    poses: int = POSES


def meshes_stage(plan: Plan) -> Stage:
    """Return the stage that makes the new meshes."""
    inputs = (artefacts.rig_stage(plan), artefacts.samples_stage(plan), artefacts.rigid_stage(plan))
    return plan.stage("new_meshes", make_meshes, NewMeshNumbers(tuple(SHARES.values())), *inputs)


def make_meshes(context: StageContext) -> None:
    """Make the new meshes, and find the original's face that each of their faces follows."""
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
            own = counterparts(new.mesh.neutral, new.mesh.faces, mesh.neutral, faces, nearby)
            np.save(context.out / f"{name}_counterparts.npy", own.astype(np.int32))
            sizes[name] = len(new.mesh.neutral)
            bar.update(1)
    context.note(vertices=sizes)


def deforming(inputs: Mapping[str, Path], mesh: Mesh) -> list[int]:
    """Return the segments that coarse networks deform, as indices."""
    rigid = set(artefacts.load_attachments(inputs).segment.tolist())
    return [k for k in range(len(mesh.segment_names)) if k not in rigid]


def faces_of(mesh: Mesh, segments: list[int]) -> Int[np.ndarray, "f 3"]:
    """Return the mesh's faces all of whose corners lie in some segments."""
    return mesh.faces[np.isin(mesh.segment[mesh.faces], segments).all(1)]


def load_meshes(inputs: Mapping[str, Path]) -> "dict[str, replicate.transfer.remeshing.NewMesh]":
    """Return the new meshes by the names of `SHARES`."""
    from replicate.transfer.remeshing import NewMesh

    return {name: NewMesh.load(inputs["new_meshes"] / f"{name}.npz") for name in SHARES}


def load_counterparts(inputs: Mapping[str, Path], name: str) -> Int[np.ndarray, " g"]:
    """Return the face that each face of a new mesh follows, as an index into `faces_of`."""
    return np.load(inputs["new_meshes"] / f"{name}_counterparts.npy", allow_pickle=False)


# The stages "onto_…": every way to move another character's face by the networks of ours, and one pose to show.

ALIGNMENT, POSE = "alignment.json", "pose.npz"


@dataclass(frozen=True)
class OtherNumbers:
    """Whose networks move whose face, and on how many test poses they are measured (0: all)."""

    source: str
    other: str
    test_poses: int
    batch: int
    seed: int


def other_stages(plan: Plan, others: Sequence[str]) -> dict[str, Stage]:
    """Return the stage that moves each of some other characters' faces, by that character's name."""
    own = (coarse.stage, refined.stage, artefacts.rig_stage, artefacts.samples_stage, artefacts.shown_pose_stage)
    made = {}
    for name in others:
        other = Plan(replace(plan.config, character=name))
        numbers = plan.config.evaluation.test_poses, plan.config.evaluation.batch, plan.config.seed
        inputs = [*(stage(plan) for stage in own), landmark_rig.stage(plan), landmark_rig.stage(other)]
        facts = OtherNumbers(plan.character, other.character, *numbers)
        made[other.character] = plan.stage(f"onto_{other.character}", move_others, facts, *inputs)
    return made


def move_others(context: StageContext) -> None:
    """Align the two faces, measure every way to move the other one, and write the pose that the figure shows."""
    from replicate.approximation.training import prepare
    from replicate.transfer.landmark_alignment import aligned, shared_marks
    from replicate.transfer.new_mesh_poses import ways_onto

    prepare("cpu")
    numbers, inputs = context.config, context.inputs
    rig, other = (_rig(inputs, name) for name in (numbers.source, numbers.other))
    marks = shared_marks(rig, other)
    face = aligned(rig.mesh, other.mesh, marks)
    model = coarse.load_model(inputs)
    ways = ways_onto(rig.mesh, face, model, refined.load_model(inputs))
    means = _other_means(context, rig, other, model, face, ways)
    (context.out / MEANS).write_text(json.dumps([asdict(mean) for mean in means], indent=1) + "\n", encoding="utf-8")
    params = artefacts.load_samples(inputs).test_params[[artefacts.load_shown_pose(inputs)]]
    known = bool(_shared(rig, other))
    shown = _poses(rig, model, _with_shared(rig, other, params) if known else params)
    own = other(_answers(rig, other, shown.params)) if known else other.mesh.neutral[None]
    posed = {name: np.asarray(move(shown)[0], np.float32) for name, move in ways.items()}
    facts = {
        "faces": face.new.mesh.faces,
        "own": np.asarray(own[0, face.vertices], np.float32),
        "source": shown.truth[0],
        "head": other.mesh.neutral,
    }
    np.savez(context.out / POSE, allow_pickle=False, **facts, **posed)
    about = {"landmarks": len(marks.names), "scale": face.scale, "controls": len(_shared(rig, other))}
    context.note(**about, vertices=len(face.vertices))
    (context.out / ALIGNMENT).write_text(json.dumps(about) + "\n", encoding="utf-8")


def _other_means(
    context: StageContext, rig: "Rig", other: "Rig", model: "SegmentedModel", face: "AlignedFace", ways: Mapping
) -> list[Mean]:
    """Return the mean errors against the other rig at the same controls; none where no control has the same name."""
    from replicate.transfer.new_mesh_poses import pose_means

    numbers, test = context.config, artefacts.load_samples(context.inputs).test_params
    rows = measurement.measured_poses(test, numbers.test_poses, numbers.seed)
    if not _shared(rig, other):
        return []
    errors = {name: [] for name in ways}
    with context.progress(len(rows), f"onto {numbers.other}") as bar:
        for start in range(0, len(rows), numbers.batch):
            params = _with_shared(rig, other, test[rows[start : start + numbers.batch]])
            poses = _poses(rig, model, params)
            truth = np.asarray(other(_answers(rig, other, params))[:, face.vertices], np.float32)
            for name, move in ways.items():
                errors[name].append(pose_means(move(poses), truth, face.new.mesh.faces))
            bar.update(len(params))
    return [_mean(numbers.other, name, "", own, len(rows)) for name, own in errors.items()]


def _rig(inputs: Mapping[str, Path], character: str) -> "Rig":
    return landmark_rig.load_landmark_rig({landmark_rig.NAME: inputs[f"{landmark_rig.NAME}-{character}"]})


def _poses(rig: "Rig", model: "SegmentedModel", params: np.ndarray) -> "SourcePoses":
    from replicate.transfer.new_mesh_poses import SourcePoses

    neutral = rig.mesh.neutral
    return SourcePoses(params, np.asarray(rig(params), np.float32), neutral + model.offsets(params))


def _shared(rig: "Rig", other: "Rig") -> list[tuple[int, int]]:
    """Return the controls that both rigs name, as indices into the one's and the other's."""
    theirs = {control.name: k for k, control in enumerate(other.controls)}
    return [(j, theirs[control.name]) for j, control in enumerate(rig.controls) if control.name in theirs]


def _with_shared(rig: "Rig", other: "Rig", params: Float32[np.ndarray, "b m"]) -> Float32[np.ndarray, "b m"]:
    """Return parameters with defaults for the controls that the other rig doesn't have."""
    kept = [j for j, _ in _shared(rig, other)]
    out = np.tile(rig.default, (len(params), 1)).astype(np.float32)
    out[:, kept] = params[:, kept]
    return out


def _answers(rig: "Rig", other: "Rig", params: Float32[np.ndarray, "b m"]) -> Float32[np.ndarray, "b k"]:
    """Return the other rig's parameters: the same numbers under the same names, within its limits."""
    ours, theirs = np.array(_shared(rig, other)).T
    out = np.tile(other.default, (len(params), 1)).astype(np.float32)
    out[:, theirs] = params[:, ours]
    return np.clip(out, other.lower, other.upper)


def load_other_means(folder: Path) -> list[Mean]:
    """Return all mean errors of one other face."""
    return [Mean(**entry) for entry in json.loads((folder / MEANS).read_text(encoding="utf-8"))]


def load_alignment(folder: Path) -> dict[str, float]:
    """Return how many landmarks and controls both characters have, and the scale of offsets."""
    return json.loads((folder / ALIGNMENT).read_text(encoding="utf-8"))


def load_other_pose(folder: Path) -> dict[str, np.ndarray]:
    """Return the shown pose, mm: the other face as its own rig has it (neutral without shared controls), and moved.

    faces: its triangles. source: the original as its rig has it. head: all of the other character, neutral.
    """
    with np.load(folder / POSE, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


# The errors of Figure 13 as rows of results: every way to move every new mesh, aligned and not.

TABLE = "figure13"


def rows_of(character: str, profile: str, inputs: Mapping[str, Path], means: Sequence[Mean]) -> list[Row]:
    """Return two rows a mean error: vertex_error_mean[mesh] in mm and normal_error_mean[mesh] in degrees.

    Errors with charts that are off have a second bracket, [shift 2 px] in pixels of the coarse maps or [turn 5 deg].
    """
    rows, run = [], run_name(inputs)
    for mean in means:
        where = f"[{mean.mesh}]" + (f"[{mean.charts}]" if mean.charts else "")
        for kind, unit, value in (("vertex", "mm", mean.distance_mm), ("normal", "deg", mean.normal_deg)):
            facts = (unit, value, None, 1, mean.poses, profile, run)
            rows.append(Row(TABLE, character, mean.method, f"{kind}_error_mean{where}", *facts))
    return rows
