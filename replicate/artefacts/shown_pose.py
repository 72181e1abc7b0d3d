"""The artefact "wrinkled": the test pose that figures show, the one that folds the forehead most."""

import json
from collections.abc import Mapping
from pathlib import Path

from replicate.artefacts import built_rig, drawn_samples
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext

FILE = "pose.json"


def stage(plan: Plan) -> Stage:
    """Return the stage that chooses the pose."""
    return plan.stage("wrinkled", make, None, built_rig.stage(plan), drawn_samples.stage(plan))


def make(context: StageContext) -> None:
    """Choose the pose, from the truth alone."""
    from replicate.approximation.evaluation import unique_poses
    from replicate.drawing.scene import forehead_faces
    from replicate.geometry.folds import most_folded

    mesh, samples = built_rig.load_mesh(context.inputs), drawn_samples.load(context.inputs)
    forehead = forehead_faces(mesh.neutral, mesh.faces)
    pose = most_folded(mesh, unique_poses(samples.test_params), samples.test_offsets, forehead)
    (context.out / FILE).write_text(json.dumps({"pose": pose}) + "\n", encoding="utf-8")


def load(inputs: Mapping[str, Path]) -> int:
    """Return the pose's index among the test poses."""
    return json.loads((inputs["wrinkled"] / FILE).read_text(encoding="utf-8"))["pose"]
