"""Poses by the thousand: which are broken, and how badly; the skin in all of them, mouth and lids where asked."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from data_recipes.rig import Rig
from replicate.approximation.samples import evaluate
from replicate.engine.progress import progress
from replicate.rig_health.eyelids import Eyes, Lids, measure_lids
from replicate.rig_health.mouth_contents import Mouth, deepest, depths
from replicate.rig_health.skin_folds import Skin


@dataclass(frozen=True)
class Health:
    """What is broken in some poses, (b,) each.

    params (b, m). bad: vertices that are NaN or infinite; such poses have no other numbers. flipped: the share of
    the skin's triangles; furthest: in head sizes. through: kind of mouth part → depth in mm; empty if not
    asked for. lids: (pose, side, Lids) for each eye that blinks fully.
    """

    params: Float[np.ndarray, "b m"]
    bad: np.ndarray
    flipped: np.ndarray
    furthest: np.ndarray
    through: dict[str, np.ndarray] = field(default_factory=dict)
    lids: tuple[tuple[int, str, Lids], ...] = ()


def measure(
    rig: Rig,
    params: Float[np.ndarray, "b m"],
    skin: Skin,
    mouth: Mouth | None = None,
    eyes: Eyes | None = None,
    label: str = "poses",
) -> Health:
    """Evaluate a rig at many poses and return what is broken in them; `mouth` and `eyes` None: leave these out."""
    count = len(params)
    bad, flipped, furthest = np.zeros(count, int), np.zeros(count), np.zeros(count)
    kinds = mouth.kinds if mouth is not None else ()
    through = {kind: np.zeros(count) for kind in kinds}
    lids = []
    with progress(count, label) as bar:
        for rows, vertices in evaluate(rig, np.asarray(params, np.float32)):
            finite = np.isfinite(vertices).all(-1)
            bad[rows] = (~finite).sum(-1)
            sound = np.flatnonzero(finite.all(-1))
            at = sound + rows.start
            flipped[at] = skin.flipped(vertices[sound]).mean(-1)
            furthest[at] = skin.furthest(vertices[sound])
            for k, pose in zip(sound, at, strict=True):
                if mouth is not None:
                    for kind, value in deepest(mouth, depths(mouth, vertices[k])).items():
                        through[kind][pose] = value
                if eyes is not None:
                    by_side = measure_lids(rig, eyes, params[pose], vertices[k])
                    lids += [(int(pose), side, lid) for side, lid in by_side.items()]
            bar.update(len(vertices))
    return Health(np.asarray(params), bad, flipped, furthest, through, tuple(lids))


def worst(values: np.ndarray, count: int) -> np.ndarray:
    """Return the indices of the largest values above 0, largest first."""
    order = np.argsort(-values, kind="stable")[:count]
    return order[values[order] > 0]


def strongest(controls: Sequence, params: Float[np.ndarray, " m"], count: int = 5) -> str:
    """Return the controls that a pose uses most, in units of their limits, in words."""
    reach = np.array([max(abs(c.upper - c.default), abs(c.lower - c.default)) for c in controls])
    used = (params - np.array([c.default for c in controls])) / reach
    order = np.argsort(-np.abs(used), kind="stable")[:count]
    return ", ".join(f"{controls[k].name} {used[k]:+.2f}" for k in order if used[k])


def each_alone(rig: Rig) -> tuple[list[str], Float[np.ndarray, "b m"]]:
    """Return poses of one control each, at its ends: names as "jaw_open 1", and parameters (b, m)."""
    names, poses = [], []
    for k, control in enumerate(rig.controls):
        for value in (control.lower, control.upper):
            if value != control.default:
                pose = rig.default.copy()
                pose[k] = value
                names.append(f"{control.name} {value:g}")
                poses.append(pose)
    return names, np.stack(poses)
