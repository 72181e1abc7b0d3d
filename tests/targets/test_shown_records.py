"""Which test poses pictures show: those of the committed results, where they are of the same samples."""

import json
from dataclasses import replace

import pytest
from bumpy_plate import bumpy_plate

from replicate.base import paths
from replicate.config import resolve
from replicate.engine.stage import Stage
from replicate.methods import artefacts
from replicate.methods.plan import Plan
from replicate.methods.typical_poses import CHOICES, KnownPoses
from replicate.report import manifest
from replicate.report.pose_record import pose_file, save_pose
from replicate.targets.shown_records import committed_poses


@pytest.fixture
def plan(tmp_path, monkeypatch) -> Plan:
    """A plan of the tiny character whose samples are the committed ones, with poses 4 and 9."""
    monkeypatch.setattr(paths, "REFERENCE", tmp_path)
    plan = Plan(resolve("tiny", "quick"))
    write_entry(artefacts.samples_stage(plan))
    for choice, pose in zip(CHOICES, (4, 9), strict=True):
        record = replace(bumpy_plate(), character="tiny", choice=choice, pose=pose, ranked_by="refined")
        save_pose(pose_file(tmp_path, "tiny", choice), record)
    return plan


def write_entry(*samples: Stage) -> None:
    """Write a manifest of seeds 0 and 1 with the samples of some stages."""
    entry = {"command": "", "seeds": [0, 1], "stages": {stage.title: {"key": stage.key} for stage in samples}}
    (paths.REFERENCE / manifest.NAME).write_text(json.dumps({"characters": {"tiny": entry}}))


def test_the_committed_poses_are_shown_if_they_are_of_the_same_samples(plan):
    assert committed_poses(plan) == KnownPoses("refined", 4, 9)


def test_other_samples_and_missing_poses_have_none(plan):
    other = Plan(replace(plan.config, seed=1))
    write_entry(artefacts.samples_stage(plan), artefacts.samples_stage(other))
    assert committed_poses(plan) and committed_poses(other) is None, "poses are of the first seed"
    pose_file(paths.REFERENCE, "tiny", CHOICES[1]).unlink()
    assert committed_poses(plan) is None
    write_entry(artefacts.samples_stage(other))
    assert committed_poses(plan) is None
