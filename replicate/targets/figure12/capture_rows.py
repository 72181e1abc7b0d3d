"""Figure 12 as rows of results: every driver, performance, noise and smoothing of one character."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from replicate.artefacts import control_influence
from replicate.capture import landmark_rig
from replicate.inverse.control_points import control_points
from replicate.report.results import Row
from replicate.report.run_name import run_name
from replicate.targets.figure12 import acted_landmarks
from replicate.targets.figure12.capture_trial import CaptureTrial
from replicate.targets.figure12.driven_motions import (
    EVERY,
    NEUTRAL,
    Closeness,
    Driver,
    closeness,
    exact,
    recordings,
    targets_of,
    windows,
)

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
    """Return a number's name: "jitter[toon][noise 0.5 mm][smoothed]"; the first bracket names the actor."""
    return f"{metric}[{actor}][noise {noise_mm:g} mm]{SMOOTHED if smoothed else ''}"


def capture_rows(
    trial: CaptureTrial, inputs: Mapping[str, Path], every: Sequence[Driver], progress: Callable
) -> list[Row]:
    """Return one character's rows. every: its drivers. progress: (total, label) → a context manager with update(k)."""
    rig = landmark_rig.load(inputs)
    driven = control_points(rig, control_influence.load(inputs)).driven()
    facts = trial.profile, run_name(inputs)
    rows: list[Row] = []
    steps = len(trial.actors) * len(trial.noises_mm) * len(windows(trial)) * len(every)
    with progress(steps, "capture") as bar:
        for actor in trial.actors:
            acted = acted_landmarks.load(inputs, actor)
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
