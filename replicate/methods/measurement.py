"""The artefacts "errors_…": a method's errors on the test poses, and the pose that figures show as it predicts it."""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32, Int

from replicate.base.exceptions import RunError
from replicate.base.schema import cut
from replicate.config import Config
from replicate.engine.stage import Stage, StageContext, stage_function, stream_rng
from replicate.engine.store import read_manifest
from replicate.methods import artefacts
from replicate.methods.method import Method, Metric, Model
from replicate.methods.plan import Plan, reference
from replicate.methods.training_stage import LOG

if TYPE_CHECKING:
    import replicate.approximation.metrics


PREFIX = "errors_"
ERRORS, POSE, NUMBERS = "errors.npz", "pose.npy", "numbers.json"


@dataclass(frozen=True)
class MeasurementSettings:
    """Which method is measured, how its predictor is read, and on how many test poses (0: all).

    load, facts, multiplications: "module:function", or "".
    settings: what `load` needs beside the artefacts.
    """

    method: str
    load: str
    facts: str
    settings: object
    oracle: bool
    rigid_step: bool
    test_poses: int
    batch: int
    seed: int
    multiplications: str = ""


def measurement_settings(method: Method, config: Config) -> MeasurementSettings:
    """Return how a method is read and measured under a configuration."""
    read = reading(method, config)
    facts, multiplications = (reference(f) if f else "" for f in (method.facts, read.multiplications))
    return MeasurementSettings(
        method.name,
        reference(read.load),
        facts,
        read.settings,
        method.oracle,
        method.rigid_step,
        method.poses(config),
        config.evaluation.batch,
        config.seed,
        multiplications,
    )


def stage(plan: Plan, method: Method) -> Stage:
    """Return the stage that measures a method; the method's artefacts are among its inputs."""
    settings = measurement_settings(method, plan.config)
    read = reading(method, plan.config)
    shared = (
        artefacts.rig_stage(plan),
        artefacts.samples_stage(plan),
        artefacts.shown_pose_stage(plan),
        artefacts.rigid_stage(plan),
        artefacts.waves_stage(plan),
    )
    inputs = {stage.title: stage for stage in (*shared, *method.stages(plan))}
    called = (*map(reference, (measure, *read.sources)), settings.facts, settings.multiplications)
    return plan.stage(f"{PREFIX}{method.name}", ", ".join(filter(None, called)), settings, *inputs.values())


def predictor(settings: MeasurementSettings, inputs: Mapping[str, Path]) -> Callable:
    """Return (parameters (b, m), truth (b, n, 3)) → vertices (b, n, 3) mm of one method, rigid segments placed.

    Only an oracle gets the truth. The function raises RunError if the method predicts anything but real, finite
    vertices.
    """
    from replicate.approximation.rigid import attach

    predict = stage_function(settings.load)(inputs, settings.settings)
    mesh, attachments = artefacts.load_mesh(inputs), artefacts.load_attachments(inputs)

    def vertices(params: np.ndarray, truth: np.ndarray) -> np.ndarray:
        answer = predict(params, truth) if settings.oracle else predict(params)
        predicted = checked(answer, (len(params), *mesh.neutral.shape), settings.method)
        return attach(mesh, attachments, predicted) if settings.rigid_step else predicted

    return vertices


def measured_poses(params: Float[np.ndarray, "t m"], count: int, seed: int) -> Int[np.ndarray, " u"]:
    """Return the indices of the unique test poses that a method is measured on.

    params: those of all test poses.
    count: how many of them, drawn by the seed; 0 for all.
    """
    from replicate.approximation.metrics import unique_poses

    poses = unique_poses(params)
    if count and count < len(poses):
        order = stream_rng(seed, "errors", "poses").permutation(len(poses))
        poses = poses[np.sort(order[:count])]  # a smaller count gives a subset
    return poses


def measure(context: StageContext) -> None:
    """Measure a method on the unique test poses (§5.1, Eq. 11), and predict the pose that figures show.

    The errors are also taken apart by frequency (`approximation.spectrum`).
    """
    from replicate.approximation.metrics import evaluate
    from replicate.approximation.spectrum import FILE, Spectrum, Waves

    settings, inputs = context.config, context.inputs
    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
    predict = predictor(settings, inputs)
    spectrum = Spectrum(Waves.load(inputs["waves"] / FILE))

    def taken_apart(params: np.ndarray, truth: np.ndarray) -> np.ndarray:
        predicted = predict(params, truth)
        spectrum.add(predicted - truth)
        return predicted

    poses = measured_poses(samples.test_params, settings.test_poses, settings.seed)
    with context.progress(len(poses), f"errors, {settings.method}") as bar:
        errors = evaluate(
            mesh,
            samples.test_params[poses],
            samples.test_offsets[poses],
            {settings.method: taken_apart},
            artefacts.load_attachments(inputs).segment.tolist(),
            settings.batch,
            bar,
        )[settings.method]
    errors.save(context.out / ERRORS)
    row = artefacts.load_shown_pose(inputs)
    truth = mesh.neutral + samples.test_offsets[row : row + 1]
    np.save(context.out / POSE, predict(samples.test_params[row : row + 1], truth)[0].astype(np.float32))
    metrics = [*stage_function(settings.facts)(inputs, mesh)] if settings.facts else []
    metrics += spectrum.metrics()
    if settings.multiplications:
        count = stage_function(settings.multiplications)(inputs, settings.settings)
        metrics.append(("multiplications", "count", count))
    artefact = inputs.get(settings.method)
    if artefact and (size := read_manifest(artefact)["notes"].get("size_mb")) is not None:
        metrics.append(("model_size", "MB", size))
    (context.out / NUMBERS).write_text(json.dumps(metrics) + "\n", encoding="utf-8")
    if artefact and (artefact / LOG).is_file():
        shutil.copyfile(artefact / LOG, context.out / LOG)


def error_folders(inputs: Mapping[str, Path]) -> dict[str, Path]:
    """Return the artefact of every measured method among some inputs, by the method's name.

    An input is listed by its stage's name and by its title, name-character; only names are looked at.
    """
    names = (name for name in inputs if name.startswith(PREFIX) and "-" not in name)
    return {name.removeprefix(PREFIX): inputs[name] for name in names}


def load_errors(folder: Path) -> "replicate.approximation.metrics.Errors":
    """Return the errors of a measured method."""
    from replicate.approximation.metrics import load_errors

    return load_errors(folder / ERRORS)


def load_pose(folder: Path) -> Float32[np.ndarray, "n 3"]:
    """Return the pose that figures show as the method predicts it, in mm."""
    return np.load(folder / POSE, allow_pickle=False)


def load_metrics(folder: Path) -> list[Metric]:
    """Return the method's other metrics: name, unit, value."""
    return [tuple(entry) for entry in json.loads((folder / NUMBERS).read_text(encoding="utf-8"))]


def load_curve(folder: Path) -> Path | None:
    """Return the file of the method's training curve, None if it has none."""
    return folder / LOG if (folder / LOG).is_file() else None


# How a method is read from its artefacts: what it predicts, and how many multiplications that takes.

FAR_MM = 1e15  # farther than any vertex; its square fits a float32


@dataclass(frozen=True)
class ModelSettings:
    """Which model is read: "module:function" of the method's `model`."""

    model: str


@dataclass(frozen=True)
class Reading:
    """The functions that a method is read with; they stand at the top of modules, where other processes find them.

    load: (inputs, settings) → predict, as in `Method`.
    multiplications: (inputs, settings) → how many a pose needs; None if they are not counted.
    settings: what both need beside the artefacts.
    sources: the functions whose code decides what is predicted.
    """

    load: Callable[[Mapping[str, Path], Any], Callable]
    multiplications: Callable[[Mapping[str, Path], Any], int] | None
    settings: object
    sources: tuple[Callable, ...]


def reading(method: Method, config: Config) -> Reading:
    """Return how a method is read under a configuration."""
    if method.model is not None:
        return Reading(load, multiplications, ModelSettings(reference(method.model)), (load, method.model))
    assert method.load is not None, "a method has one of the two"
    return Reading(method.load, method.multiplications, method.settings(config), (method.load,))


def load(inputs: Mapping[str, Path], settings: ModelSettings) -> Callable:
    """Return parameters (b, m) → vertices (b, n, 3), mm, of a method that has a model."""
    return vertices_of(inputs, stage_function(settings.model)(inputs), settings.model)


def multiplications(inputs: Mapping[str, Path], settings: ModelSettings) -> int:
    """Return how many multiplications a method with a model needs for one pose."""
    from replicate.baselines.multiplications import of_model

    return of_model(stage_function(settings.model)(inputs))


def vertices_of(inputs: Mapping[str, Path], model: Model, name: str) -> Callable:
    """Return parameters (b, m) → vertices (b, n, 3), mm, of a model that predicts offsets; on the CPU, one thread.

    name: the model's, for messages.

    The function raises RunError for offsets of another shape, which NumPy might broadcast.
    """
    from replicate.approximation.training import prepare

    prepare("cpu")
    mesh = artefacts.load_mesh(inputs)

    def vertices(params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        offsets, shape = model.offsets(params), (len(params), *mesh.neutral.shape)
        if getattr(offsets, "shape", None) != shape:
            raise RunError(f"model {name}: expected offsets {shape}, got {_in_words(offsets)}")
        return mesh.neutral + offsets

    return vertices


def checked(predicted: object, shape: tuple[int, int, int], method: str) -> Float[np.ndarray, "b n 3"]:
    """Return a method's prediction as an array of real and finite vertices; raise RunError for anything else.

    predicted: what the method's function returned.
    shape: the expected (b, n, 3).
    method: its name, for messages.
    """
    demand = f"method {method}: expected vertices {shape}, real and finite, got"
    try:
        array = np.asarray(predicted)
    except Exception as error:  # a user's object may raise anything
        raise RunError(f"{demand} {_in_words(predicted)} ({cut(' '.join(str(error).split()))})") from None
    if array.shape != shape or array.dtype.kind not in "fiu":
        raise RunError(f"{demand} {_in_words(predicted if predicted is None else array)}")
    if array.dtype.kind != "f":
        array = array.astype(np.float32)
    flat = array.reshape(-1)
    with np.errstate(over="ignore", invalid="ignore"):
        square = flat @ flat  # ten times as fast as a look at each number
    if not square < FAR_MM**2 and not (near := np.abs(flat) < FAR_MM).all():  # NaN is not near either
        pose, vertex, axis = np.unravel_index(np.argmin(near), shape)
        raise RunError(f"{demand} {flat[np.argmin(near)]:g} at [{pose}, {vertex}, {axis}]")
    return array


def _in_words(found: object) -> str:
    """Return a phrase for a value that is no prediction."""
    if found is None:
        return "None"
    kind = type(found).__name__
    return f"{kind} {found.shape} of {found.dtype}" if isinstance(found, np.ndarray) else f"a value of the type {kind}"
