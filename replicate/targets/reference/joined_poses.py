"""What a run's first seed brings of poses and curves to characters whose other methods are committed already."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from replicate.engine import paths
from replicate.report import manifest
from replicate.report.pose_record import CHOICES, TRUTH, PoseRecord, load_pose, pose_file, save_pose
from replicate.report.training_curves import read_curves, write_curves
from replicate.targets.reference.committed_seeds import TARGET
from replicate.targets.table2.character_part import CURVES

TOLERANCE_MM = 0.02  # within which two records show the same face: both are rounded


def put_first_seed(run: Path, shared: Collection[str]) -> list[Path]:
    """Put a run's methods into the committed poses and curves of the shared characters; return the files.

    Pictures are of a character's first seed, so that a run of other seeds changes nothing. A pose that was chosen by
    another method, as in a run without the one that ranks them, stays as it is. Pictures are not drawn:
    `redrawn_pictures` does that.
    """
    before, own = (manifest.entries(folder, TARGET) for folder in (paths.REFERENCE, run))
    names = [name for name in shared if min(own[name]["seeds"]) == min(before[name]["seeds"])]
    files = [file for name in names for choice in CHOICES for file in _put_pose(run, name, choice)]
    into = paths.REFERENCE / CURVES
    if names and (run / CURVES).is_file() and into.is_file():
        new = {key: curve for key, curve in read_curves(run / CURVES).items() if key[0] in names}
        write_curves(into, read_curves(into) | new)
        files.append(into)
    return files


def _put_pose(run: Path, character: str, choice: str) -> list[Path]:
    there, new = (pose_file(folder, character, choice) for folder in (paths.REFERENCE, run))
    if not (there.is_file() and new.is_file()):
        return []
    committed, record = load_pose(there), load_pose(new)
    if not _is_same(committed, record):
        return []
    labels = (committed.vertices.keys() & record.vertices.keys()) - {TRUTH}
    save_pose(there, replace(committed, vertices=committed.vertices | {name: record.vertices[name] for name in labels}))
    return [there]


def _is_same(one: PoseRecord, other: PoseRecord) -> bool:
    """Return whether two records show the same pose of the same rig, chosen by the same rule."""
    rules = [(record.pose, record.choice, record.ranked_by, record.neutral.shape) for record in (one, other)]
    return rules[0] == rules[1] and np.allclose(one.vertices[TRUTH], other.vertices[TRUTH], atol=TOLERANCE_MM)
