"""What drives a character in Figure 12, and how near it comes: IK networks and baselines."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from data_recipes.rig import Rig
from replicate.artefacts import control_influence, drawn_samples
from replicate.capture import landmark_ik, landmark_rig
from replicate.capture.driven_face import ApproximatedRig
from replicate.capture.landmark_file import MM, Recording
from replicate.capture.landmark_motion import FRAMES_PER_SECOND, control_motion, jitter_mm
from replicate.engine.stage import stream_rng
from replicate.inverse import ik_stage
from replicate.inverse.control_points import control_points
from replicate.inverse.ik_training import parameter_ranges, read_truth
from replicate.methods.measurement import predictor
from replicate.targets.figure12.acted_landmarks import Performance
from replicate.targets.figure12.capture_trial import CaptureTrial
from replicate.targets.figure12.landmark_ridge import fit_ridge

NEUTRAL, RIDGE = "neutral", "landmark_ridge"
EVERY = 4  # of the frames, the whole mesh is compared in one of so many
Solve = Callable[[np.ndarray], np.ndarray]  # targets (t, l, 3) → rig parameters (t, m)


@dataclass(frozen=True)
class Driver:
    """A way from landmarks to a face. solve: without limits. positions: parameters → landmarks, of an approximation.

    face: the rig with that approximation as its skin.
    """

    name: str
    solve: Solve
    positions: Callable[[torch.Tensor], torch.Tensor]
    face: ApproximatedRig


@dataclass(frozen=True)
class Closeness:
    """How near a driven character comes to what was acted, means over all frames; None where no truth is known.

    parameters: in shares of their ranges, over those that the networks drive. landmark_mm: in the image plane.
    vertex_mm: of the whole mesh. jitter: the mean second difference of the landmarks in time over the actor's.
    outside: the share of driven parameters that were brought back within their limits.
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
    rig, found = landmark_rig.load(inputs), []
    for method in trial.methods:
        positions = ik_stage.positions(inputs, method.model, rig.control_points)
        face = ApproximatedRig(rig, predictor(method.measured, inputs))
        found.append(Driver(method.name, landmark_ik.load(inputs, method.name).solve, positions, face))
    samples, points = drawn_samples.load(inputs), control_points(rig, control_influence.load(inputs))
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
    """Return what a tracker without any noise would see of a performance."""
    return Recording(performance.landmarks[..., :2].astype(float), MM, 0)


def recordings(trial: CaptureTrial, performance: Performance, actor: str) -> dict[float, Recording]:
    """Return what a tracker with noise would see of a performance, by the noise's standard deviation in mm.

    The same noise is scaled, so that a curve over it isn't another draw at each place.
    """
    places = exact(performance).positions
    noise = stream_rng(trial.seed, "figure12", f"noise of {actor}").normal(size=places.shape)
    return {size: Recording(places + size * noise, MM, 0) for size in trial.noises_mm}


def windows(trial: CaptureTrial) -> tuple[int, ...]:
    """Return the windows of smoothing that are tried: none, and the section's, where that is another."""
    return tuple(dict.fromkeys((1, trial.section.smoothing_frames)))


def targets_of(
    trial: CaptureTrial, recording: Recording, rig: Rig, window: int
) -> tuple[Float[np.ndarray, "t l 3"], float]:
    """Return where the character's landmarks shall go for a recording, mm, and the scale of the movement.

    recording: of a performance of ours, whose rate is that of all clips, whatever the section says of a user's.
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
    """Return how near a driver comes.

    targets: what it is given. goal: where the landmarks truly shall go. performed: the actor's parameters, where the
    actor is the character itself. driven: the parameters that the networks drive.
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
