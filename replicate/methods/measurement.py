"""The artefacts "errors_…": a method's errors on the test poses, and its prediction of the pose that figures show."""

import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, Int

from replicate.artefacts import built_rig, drawn_samples, rigid_segments, shown_pose
from replicate.artefacts.plan import Plan, reference
from replicate.config import Config
from replicate.engine.stage import Stage, StageContext, stage_function, stream_rng
from replicate.engine.store import read_manifest
from replicate.methods.method import Method, Number
from replicate.methods.prediction import checked, reading
from replicate.methods.training_stage import LOG

if TYPE_CHECKING:
    import replicate.approximation.evaluation

PREFIX = "errors_"
ERRORS, POSE, NUMBERS = "errors.npz", "pose.npy", "numbers.json"


@dataclass(frozen=True)
class MeasurementNumbers:
    """Which method is measured, on how many test poses (0: all), and what its predictor is read with."""

    method: str
    load: str
    facts: str
    numbers: object
    oracle: bool
    rigid_step: bool
    test_poses: int
    batch: int
    seed: int
    multiplications: str = ""


def numbers_of(method: Method, config: Config) -> MeasurementNumbers:
    """Return what a method's predictor is read with under a configuration, and how it is measured."""
    read = reading(method, config)
    facts, multiplications = (reference(f) if f else "" for f in (method.facts, read.multiplications))
    return MeasurementNumbers(
        method.name,
        reference(read.load),
        facts,
        read.numbers,
        method.oracle,
        method.rigid_step,
        method.poses(config),
        config.evaluation.batch,
        config.seed,
        multiplications,
    )


def stage(plan: Plan, method: Method) -> Stage:
    """Return the stage that measures a method; what its predictor is read from is among the stage's inputs."""
    numbers = numbers_of(method, plan.config)
    read = reading(method, plan.config)
    shared = (built_rig.stage(plan), drawn_samples.stage(plan), shown_pose.stage(plan), rigid_segments.stage(plan))
    inputs = {stage.title: stage for stage in (*shared, *method.stages(plan))}
    further = (numbers.facts, numbers.multiplications)
    functions = ", ".join(filter(None, (*map(reference, (measure, *read.sources)), *further)))
    return plan.stage(f"{PREFIX}{method.name}", functions, numbers, *inputs.values())


def predictor(numbers: MeasurementNumbers, inputs: Mapping[str, Path]) -> Callable:
    """Return (parameters (b, m), truth (b, n, 3)) → vertices (b, n, 3) mm of one method, rigid segments placed.

    Only an oracle is handed the truth. It raises RunError where the method predicts anything but real, finite vertices.
    """
    from replicate.approximation.rigid import attach

    predict = stage_function(numbers.load)(inputs, numbers.numbers)
    mesh, attachments = built_rig.load_mesh(inputs), rigid_segments.load(inputs)

    def vertices(params: np.ndarray, truth: np.ndarray) -> np.ndarray:
        answer = predict(params, truth) if numbers.oracle else predict(params)
        predicted = checked(answer, (len(params), *mesh.neutral.shape), numbers.method)
        return attach(mesh, attachments, predicted) if numbers.rigid_step else predicted

    return vertices


def measured_poses(params: Float[np.ndarray, "t m"], count: int, seed: int) -> Int[np.ndarray, " u"]:
    """Return the indices of the unique test poses that a method is measured on.

    params: of all test poses. count: how many of them, drawn by the seed; 0 for all.
    """
    from replicate.approximation.evaluation import unique_poses

    poses = unique_poses(params)
    if count and count < len(poses):
        order = stream_rng(seed, "errors", "poses").permutation(len(poses))
        poses = poses[np.sort(order[:count])]  # fewer poses are some of the more
    return poses


def measure(context: StageContext) -> None:
    """Measure a method on the unique test poses (§5.1, Eq. 11), and predict the pose that figures show."""
    from replicate.approximation.evaluation import evaluate

    numbers, inputs = context.config, context.inputs
    mesh, samples = built_rig.load_mesh(inputs), drawn_samples.load(inputs)
    predict = predictor(numbers, inputs)
    poses = measured_poses(samples.test_params, numbers.test_poses, numbers.seed)
    with context.progress(len(poses), f"errors, {numbers.method}") as bar:
        errors = evaluate(
            mesh,
            samples.test_params[poses],
            samples.test_offsets[poses],
            {numbers.method: predict},
            rigid_segments.load(inputs).segment.tolist(),
            numbers.batch,
            bar,
        )[numbers.method]
    errors.save(context.out / ERRORS)
    row = shown_pose.load(inputs)
    truth = mesh.neutral + samples.test_offsets[row : row + 1]
    np.save(context.out / POSE, predict(samples.test_params[row : row + 1], truth)[0].astype(np.float32))
    entries = stage_function(numbers.facts)(inputs, mesh) if numbers.facts else []
    if numbers.multiplications:
        count = stage_function(numbers.multiplications)(inputs, numbers.numbers)
        entries = [*entries, ("multiplications", "count", count)]
    own = inputs.get(numbers.method)
    size = read_manifest(own)["notes"].get("size_mb") if own else None
    entries = [*entries, *([("model_size", "MB", size)] if size is not None else [])]
    (context.out / NUMBERS).write_text(json.dumps(entries) + "\n", encoding="utf-8")
    if own and (own / LOG).is_file():
        shutil.copyfile(own / LOG, context.out / LOG)


def error_folders(inputs: Mapping[str, Path]) -> dict[str, Path]:
    """Return the artefact of every measured method among some inputs, by the method's name.

    An input goes by its stage's name and by its title, name-character; only names count here.
    """
    names = (name for name in inputs if name.startswith(PREFIX) and "-" not in name)
    return {name.removeprefix(PREFIX): inputs[name] for name in names}


def load_errors(folder: Path) -> "replicate.approximation.evaluation.Errors":
    """Return the `Errors` of a measured method."""
    from replicate.approximation.evaluation import load_errors

    return load_errors(folder / ERRORS)


def load_pose(folder: Path) -> Float32[np.ndarray, "n 3"]:
    """Return the pose that figures show, as the method predicts it; mm."""
    return np.load(folder / POSE, allow_pickle=False)


def load_numbers(folder: Path) -> list[Number]:
    """Return the method's further numbers: metric, unit, value."""
    return [tuple(entry) for entry in json.loads((folder / NUMBERS).read_text(encoding="utf-8"))]


def load_curve(folder: Path) -> Path | None:
    """Return the file of the method's training curve, if it was trained step by step."""
    return folder / LOG if (folder / LOG).is_file() else None
