"""The stage "moved_meshes": every way to move the new meshes against the truth, on test poses, and one pose to show."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from replicate.artefacts import built_rig, drawn_samples, rigid_segments, shown_pose
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.methods import coarse, measurement, refined
from replicate.targets.figure13 import new_meshes

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


def stage(plan: Plan) -> Stage:
    """Return the stage that moves the new meshes; the networks' are among its inputs."""
    numbers = MovedNumbers(plan.config.evaluation.test_poses, plan.config.evaluation.batch, plan.config.seed)
    modules = (built_rig, drawn_samples, rigid_segments, shown_pose, new_meshes)
    networks = (coarse.stage(plan), refined.stage(plan))
    return plan.stage("moved_meshes", make, numbers, *networks, *(module.stage(plan) for module in modules))


def make(context: StageContext) -> None:
    """Measure how far the new meshes are from the truth, with charts that are aligned and charts that are not (§6)."""
    from replicate.approximation.training import prepare

    prepare("cpu")
    numbers, inputs = context.config, context.inputs
    rows = measurement.measured_poses(drawn_samples.load(inputs).test_params, numbers.test_poses, numbers.seed)
    few = rows[:: -(-len(rows) // numbers.moved_poses)]
    passes = len(new_meshes.SHARES) * (len(rows) + len(few) * (len(numbers.shifts) + len(numbers.turns_deg)))
    with context.progress(passes + len(rows), "moved meshes") as bar:
        means = [*_on_the_original(inputs, rows, numbers.batch, bar)]
        for name in new_meshes.SHARES:
            means += _aligned(inputs, name, rows, numbers.batch, context.out, bar)
            means += _misaligned(inputs, name, few, numbers, context.rng, bar)
    text = json.dumps([vars(mean) for mean in means], indent=1)
    (context.out / MEANS).write_text(text + "\n", encoding="utf-8")


def source_poses(inputs: Mapping[str, Path], rows: np.ndarray, batch: int) -> Iterator:
    """Yield test poses of the original mesh, so many at a time, as `SourcePoses`."""
    from replicate.transfer.new_mesh_poses import SourcePoses

    mesh, samples, model = built_rig.load_mesh(inputs), drawn_samples.load(inputs), coarse.load_model(inputs)
    for start in range(0, len(rows), batch):
        own = rows[start : start + batch]
        params, truth = samples.test_params[own], mesh.neutral + np.asarray(samples.test_offsets[own], np.float32)
        yield SourcePoses(params, truth, mesh.neutral + model.offsets(params))


def _on_the_original(inputs: Mapping[str, Path], rows: np.ndarray, batch: int, bar) -> Iterator[Mean]:
    """Yield the errors of the models on the mesh that they were trained on, on the same segments."""
    from replicate.approximation.segments import faces_within
    from replicate.transfer.new_mesh_poses import pose_means

    mesh, model = built_rig.load_mesh(inputs), refined.load_model(inputs)
    vertices = np.flatnonzero(np.isin(mesh.segment, new_meshes.deforming(inputs, mesh)))
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

    mesh, new = built_rig.load_mesh(inputs), new_meshes.load(inputs)[name]
    faces = new_meshes.faces_of(mesh, new_meshes.deforming(inputs, mesh))
    counterpart = new_meshes.load_counterparts(inputs, name)
    ways = ways_to_move(mesh, faces, new, counterpart, coarse.load_model(inputs), refined.load_model(inputs))
    errors = {method: [] for method in ways}
    for poses in source_poses(inputs, rows, batch):
        for method, own in errors_of_ways(ways, new, poses).items():
            errors[method].append(own)
        bar.update(len(poses.params))
    (shown,) = source_poses(inputs, np.array([shown_pose.load(inputs)]), 1)
    posed = {method: np.float32(move(shown)[0]) for method, move in ways.items()}
    np.savez(_pose_file(out, name), truth=new.places.mix(shown.truth)[0], **posed)
    np.savez(_pose_file(out, ORIGINAL), truth=shown.truth[0], coarse=shown.predicted[0])
    yield from (_mean(name, method, "", own) for method, own in errors.items())


def _misaligned(
    inputs: Mapping[str, Path], name: str, rows: np.ndarray, numbers: MovedNumbers, stream: Callable, bar
) -> Iterator[Mean]:
    """Yield the errors of the coarse model, read at texture coordinates that are off.

    stream: name → generator. Every shift has the same directions.
    """
    from replicate.transfer.misaligned_charts import shifted, turned
    from replicate.transfer.new_mesh_poses import pose_means
    from replicate.transfer.transferred_model import transferred

    model, new = coarse.load_model(inputs), new_meshes.load(inputs)[name]
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
    return Mean(mesh, method, charts, *every.mean(0).tolist(), poses or len(every))


def load_means(inputs: Mapping[str, Path]) -> list[Mean]:
    """Return all mean errors."""
    return [Mean(**entry) for entry in json.loads((inputs["moved_meshes"] / MEANS).read_text(encoding="utf-8"))]


def load_pose(inputs: Mapping[str, Path], name: str) -> dict[str, Float32[np.ndarray, "k 3"]]:
    """Return a mesh in the pose that figures show: the truth, and every way to move it; mm.

    name: of a new mesh, or `ORIGINAL`, which has the truth and the coarse model's prediction.
    """
    with np.load(_pose_file(inputs["moved_meshes"], name), allow_pickle=False) as stored:
        return {method: stored[method] for method in stored.files}


def _pose_file(folder: Path, name: str) -> Path:
    return folder / f"{name}_pose.npz"
