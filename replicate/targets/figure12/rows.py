"""Figure 12 as rows of results: every driver, performance, noise and smoothing for one character."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32

from data_recipes.catalogue import performance
from data_recipes.rig import Rig
from replicate.capture import landmark_rig
from replicate.capture.capture_config import CaptureConfig
from replicate.capture.driven_face import ApproximatedRig, face_picture, head_camera
from replicate.capture.landmark_file import MM, Recording
from replicate.capture.landmark_motion import FRAMES_PER_SECOND, control_motion, jitter_mm, telling_frames
from replicate.drawing.face_sheet import cell_width
from replicate.drawing.marks import balls
from replicate.engine.stage import Stage, StageContext, stream_rng
from replicate.inverse import ik_stage
from replicate.inverse.control_points import InverseConfig, control_points
from replicate.inverse.ik_network import Truth, parameter_ranges, read_truth
from replicate.methods import artefacts
from replicate.methods.measurement import MeasurementSettings, predictor
from replicate.methods.plan import Plan
from replicate.report.results import Row, run_name

# The settings of Figure 12's stage.


@dataclass(frozen=True)
class ThroughMethod:
    """A method that IK networks are trained through: how it predicts, and "module:function" of its model."""

    measured: MeasurementSettings
    model: str

    @property
    def name(self) -> str:
        """The method's name."""
        return self.measured.method


@dataclass(frozen=True)
class CaptureTrial:
    """The settings of Figure 12's stage.

    character: the character that is driven
    actors: the characters that perform, itself first
    profile, seed: the profile of the rows, and the seed of the noise
    section: the configuration of capture
    inverse: the configuration of inverse kinematics
    methods: what IK networks are trained through
    """

    character: str
    actors: tuple[str, ...]
    profile: str
    seed: int
    section: CaptureConfig
    inverse: InverseConfig
    methods: tuple[ThroughMethod, ...]

    @property
    def noises_mm(self) -> tuple[float, ...]:
        """The standard deviations of the noise on each coordinate of the actors' landmarks, rising."""
        return tuple(sorted(set(self.section.noises_mm)))


# The artefacts "performance": a character's rig performs, so that its landmarks are known exactly (Fig. 12).

NAME, ARRAYS = "performance", "performance.npz"
FRAMES, TALL = 5, 1.2  # frames that are drawn; a picture's height over its width
MARK = 0.007  # the radius of a landmark's mark, as a share of the picture's height


@dataclass(frozen=True)
class Performance:
    """A rig's performance.

    params: (t, m). landmarks: (t, l, 3) mm. shown: the frames that are drawn, (f,). pictures: the rig in these frames
    with its landmarks, (f, h, w, 3) uint8.
    """

    params: np.ndarray
    landmarks: np.ndarray
    shown: np.ndarray
    pictures: np.ndarray


def stage(plan: Plan) -> Stage:
    """Return the stage in which the plan's character performs."""
    return plan.stage(NAME, make, None, landmark_rig.stage(plan), per_seed=False)


def make(context: StageContext) -> None:
    """Let the character perform, and draw some frames."""
    rig = landmark_rig.load_landmark_rig(context.inputs)
    params = performance(rig)
    landmarks = rig(params)[:, rig.control_points]
    shown = telling_frames(landmarks, FRAMES)
    (height, width), pictures = picture_size(), []
    camera = head_camera(rig, width / height)
    with context.progress(len(shown), "actor") as bar:
        for k in shown:
            marks = balls(landmarks[k], MARK * camera.height_mm)
            pictures.append(face_picture(rig, params[k], camera, width, height, marks=marks))
            bar.update(1)
    arrays = {"params": params, "landmarks": landmarks, "shown": np.array(shown), "pictures": np.stack(pictures)}
    np.savez_compressed(context.out / ARRAYS, **arrays)
    context.note(frames=len(params))


def picture_size() -> tuple[int, int]:
    """Return the height and width of the pictures, pixels."""
    width = cell_width(FRAMES)
    return round(TALL * width), width


def load(inputs: Mapping[str, Path], character: str) -> Performance:
    """Return a character's performance."""
    with np.load(inputs[f"{NAME}-{character}"] / ARRAYS, allow_pickle=False) as stored:
        return Performance(*(stored[name] for name in ("params", "landmarks", "shown", "pictures")))


# What drives a character in Figure 12, IK networks and baselines, and how near each comes.

NEUTRAL, RIDGE = "neutral", "landmark_ridge"
EVERY = 4  # the whole mesh is compared in every fourth frame
Solve = Callable[[np.ndarray], np.ndarray]  # targets (t, l, 3) → rig parameters (t, m)


@dataclass(frozen=True)
class Driver:
    """A way from landmarks to a face.

    solve: landmarks → parameters, not clipped to their limits. positions: parameters → landmarks of an approximation.
    face: the rig with that approximation as its skin.
    """

    name: str
    solve: Solve
    positions: Callable[[torch.Tensor], torch.Tensor]
    face: ApproximatedRig


@dataclass(frozen=True)
class Closeness:
    """How near a driven character comes to the performance, in means over all frames.

    landmark_mm: the landmarks' error in the image plane
    jitter: the landmarks' mean second difference in time, over the actor's
    outside: the share of driven parameters that were brought back within their limits
    parameters: the driven parameters' error in shares of their ranges; None where no truth is known
    vertex_mm: the error of the whole mesh; None where no truth is known
    """

    landmark_mm: float
    jitter: float
    outside: float
    parameters: float | None = None
    vertex_mm: float | None = None


def drivers(trial: CaptureTrial, inputs: Mapping[str, Path]) -> list[Driver]:
    """Return the IK networks through each method, then the baselines: a ridge regression and the neutral pose.

    The baselines have the first method's mesh.
    """
    rig, found = landmark_rig.load_landmark_rig(inputs), []
    for method in trial.methods:
        positions = ik_stage.positions(inputs, method.model, rig.control_points)
        face = ApproximatedRig(rig, predictor(method.measured, inputs))
        found.append(Driver(method.name, landmark_rig.load_networks(inputs, method.name).solve, positions, face))
    samples, points = artefacts.load_samples(inputs), control_points(rig, artefacts.load_influence(inputs))
    truth = read_truth(samples, rig.mesh.neutral, points)
    ridge = fit_ridge(
        truth,
        np.asarray(samples.params, float),
        np.asarray(samples.validation_params, float),
        rig.mesh.neutral[rig.control_points].astype(float),
        parameter_ranges(rig).astype(float),
        trial.inverse.noise_mm,
        stream_rng(trial.seed, "figure12", "ridge"),
    )
    first = found[0]
    found.append(replace(first, name=RIDGE, solve=ridge.solve))
    found.append(replace(first, name=NEUTRAL, solve=lambda targets: np.tile(rig.default, (len(targets), 1))))
    return found


def exact(performance: Performance) -> Recording:
    """Return the recording of a performance by a tracker without noise."""
    return Recording(performance.landmarks[..., :2].astype(float), MM, 0)


def recordings(trial: CaptureTrial, performance: Performance, actor: str) -> dict[float, Recording]:
    """Return recordings of a performance with noise, by its standard deviation in mm.

    One draw of noise is scaled to all of them, so that a curve over the noise is smooth.
    """
    places = exact(performance).positions
    noise = stream_rng(trial.seed, "figure12", f"noise of {actor}").normal(size=places.shape)
    return {size: Recording(places + size * noise, MM, 0) for size in trial.noises_mm}


def windows(trial: CaptureTrial) -> tuple[int, ...]:
    """Return the windows of smoothing to try, in frames: 1, which smooths nothing, and the configuration's."""
    return tuple(dict.fromkeys((1, trial.section.smoothing_frames)))


def targets_of(
    trial: CaptureTrial, recording: Recording, rig: Rig, window: int
) -> tuple[Float[np.ndarray, "t l 3"], float]:
    """Return the targets of the character's landmarks for a recording, mm, and the scale of the movement.

    recording: a performance of ours, at the frame rate of our clips, whatever rate the configuration has for a user's
    window: frames of smoothing
    """
    section = replace(trial.section, smoothing_frames=window, frames_per_second=FRAMES_PER_SECOND)
    motion = control_motion(recording, rig.mesh.neutral[rig.control_points], section)
    return motion.targets, motion.scale


def closeness(
    driver: Driver,
    rig: Rig,
    targets: Float[np.ndarray, "t l 3"],
    goal: Float[np.ndarray, "t l 3"],
    performed: Float[np.ndarray, "t m"] | None,
    driven: np.ndarray,
) -> Closeness:
    """Measure how near a driver comes to the performance.

    targets: the landmarks that the driver is given, (t, l, 3), mm
    goal: the true targets of the landmarks, (t, l, 3), mm
    performed: the actor's parameters, (t, m), if the character is its own actor
    driven: indices of the parameters that the networks drive
    """
    raw = driver.solve(targets)
    params = np.clip(raw, rig.lower, rig.upper).astype(np.float32)
    with torch.no_grad():
        reached = driver.positions(torch.from_numpy(params)).numpy()[..., :2]
    apart, slack = np.linalg.norm(reached - goal[..., :2], axis=-1), 1e-5 * (rig.upper - rig.lower)
    outside = float((np.abs(raw - params) > slack)[:, driven].mean())
    common = float(apart.mean()), jitter_mm(reached) / max(jitter_mm(goal[..., :2]), 1e-9), outside
    if performed is None:
        return Closeness(*common)
    shares = np.abs(params - performed)[:, driven] / parameter_ranges(rig)[driven]
    some = slice(None, None, EVERY)
    vertices = np.linalg.norm(driver.face(params[some]) - rig(performed[some]), axis=-1)
    return Closeness(*common, float(shares.mean()), float(vertices.mean()))


TABLE = "figure12"
SMOOTHED = "[smoothed]"
METRICS = {  # → the unit, and the field of `Closeness`
    "parameter_error_mean": ("ratio", "parameters"),
    "landmark_error_mean": ("mm", "landmark_mm"),
    "vertex_error_mean": ("mm", "vertex_mm"),
    "jitter": ("ratio", "jitter"),
    "outside_limits": ("ratio", "outside"),
}


def metric_name(metric: str, actor: str, noise_mm: float, smoothed: bool) -> str:
    """Return the name of a metric: "jitter[toon][noise 0.5 mm][smoothed]"; the first bracket names the actor."""
    return f"{metric}[{actor}][noise {noise_mm:g} mm]{SMOOTHED if smoothed else ''}"


def capture_rows(
    trial: CaptureTrial, inputs: Mapping[str, Path], every: Sequence[Driver], progress: Callable
) -> list[Row]:
    """Return one character's rows.

    every: all of its drivers. progress: (total, label) → a context manager with update(k).
    """
    rig = landmark_rig.load_landmark_rig(inputs)
    driven = control_points(rig, artefacts.load_influence(inputs)).driven()
    facts = trial.profile, run_name(inputs)
    rows: list[Row] = []
    steps = len(trial.actors) * len(trial.noises_mm) * len(windows(trial)) * len(every)
    with progress(steps, "capture") as bar:
        for actor in trial.actors:
            acted = load(inputs, actor)
            seen = recordings(trial, acted, actor)
            goal, scale = targets_of(trial, exact(acted), rig, 1)
            performed = acted.params if actor == trial.character else None
            count = len(goal)
            rows.append(Row(TABLE, trial.character, "scale", f"scale[{actor}]", "ratio", scale, None, 1, count, *facts))
            for noise, recording in seen.items():
                for window in windows(trial):
                    targets, _ = targets_of(trial, recording, rig, window)
                    for driver in every:
                        found = closeness(driver, rig, targets, goal, performed, driven)
                        common = trial.character, actor, noise, window > 1, count
                        rows += _rows(driver, found, *common, facts)
                        bar.update(1)
    return rows


def _rows(
    driver: Driver,
    found: Closeness,
    character: str,
    actor: str,
    noise: float,
    smoothed: bool,
    count: int,
    facts: tuple[str, str],
) -> list[Row]:
    rows = []
    for metric, (unit, field) in METRICS.items():
        value = getattr(found, field)
        if value is not None and not (driver.name == NEUTRAL and metric in ("jitter", "outside_limits")):
            name = metric_name(metric, actor, noise, smoothed)
            poses = -(-count // EVERY) if metric == "vertex_error_mean" else count
            rows.append(Row(TABLE, character, driver.name, name, unit, value, None, 1, poses, *facts))
    return rows


# A baseline of performance capture: ridge regression from landmarks straight to rig parameters, without a model.

STRENGTHS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # values to try for the penalty's λ over the number of samples


@dataclass(frozen=True)
class LandmarkRidge:
    """Parameters as a linear function of the landmarks' moves.

    weights: (2l, m). constant: (m,). rest: the landmarks of the neutral face, (l, 2) mm.
    """

    weights: np.ndarray
    constant: np.ndarray
    rest: np.ndarray

    def solve(self, targets: Float[np.ndarray, "t l 3"]) -> Float32[np.ndarray, "t m"]:
        """Return rig parameters for the landmarks' targets, mm."""
        moves = (targets[..., :2] - self.rest).reshape(len(targets), -1)
        return (moves @ self.weights + self.constant).astype(np.float32)


def fit_ridge(
    truth: Truth,
    params: Float[np.ndarray, "a m"],
    held_out: Float[np.ndarray, "b m"],
    rest: Float[np.ndarray, "l 3"],
    ranges: Float[np.ndarray, " m"],
    noise_mm: float,
    generator: np.random.Generator,
) -> LandmarkRidge:
    """Fit the ridge regression to the samples and the noise that the IK networks are trained on.

    The penalty is the one with the smallest error on the validation poses, in shares of the parameters' ranges.

    truth: the landmarks in training and validation poses
    params: the parameters of the training poses, (a, m)
    held_out: the parameters of the validation poses, (b, m)
    rest: the landmarks of the neutral face, (l, 3), mm
    ranges: of the parameters, (m,)
    noise_mm: each coordinate of a landmark moves by U(−noise_mm, noise_mm)
    """
    from sklearn.linear_model import Ridge

    def moves(places: np.ndarray) -> np.ndarray:
        noisy = places + generator.uniform(-noise_mm, noise_mm, places.shape)
        return (noisy - rest)[..., :2].reshape(len(places), -1)

    training, validation = moves(truth.training), moves(truth.validation)
    fits = [Ridge(alpha=strength * len(training)).fit(training, params / ranges) for strength in STRENGTHS]
    best = min(fits, key=lambda fit: float(np.square(fit.predict(validation) - held_out / ranges).mean()))
    return LandmarkRidge((best.coef_.T * ranges), best.intercept_ * ranges, np.asarray(rest[:, :2], float))
