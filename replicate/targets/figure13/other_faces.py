"""The stages "onto_…": every way to move another character's face by the networks of ours, and one pose to show.

Between two people nobody knows the truth. Where the other one's rig has controls of the same names, its own answer to
the same numbers is what all are measured against: another person's expression, with other folds and proportions.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from replicate.artefacts import built_rig, drawn_samples, shown_pose
from replicate.artefacts.plan import Plan
from replicate.capture import landmark_rig
from replicate.engine.stage import Stage, StageContext
from replicate.methods import coarse, measurement, refined
from replicate.targets.figure13.moved_meshes import MEANS, Mean

if TYPE_CHECKING:
    from data_recipes.rig import Rig
    from replicate.approximation.model import SegmentedModel

ALIGNMENT, POSE = "alignment.json", "pose.npz"


@dataclass(frozen=True)
class OtherNumbers:
    """Whose networks move whose face, and on how many test poses they are measured (0: all)."""

    source: str
    other: str
    test_poses: int
    batch: int
    seed: int


def stages(plan: Plan, others: Sequence[str]) -> dict[str, Stage]:
    """Return the stage that moves each of some other characters' faces, by that character's name."""
    own = (coarse, refined, built_rig, drawn_samples, shown_pose)
    made = {}
    for name in others:
        other = Plan(replace(plan.config, character=name))
        numbers = plan.config.evaluation.test_poses, plan.config.evaluation.batch, plan.config.seed
        inputs = [*(module.stage(plan) for module in own), landmark_rig.stage(plan), landmark_rig.stage(other)]
        facts = OtherNumbers(plan.character, other.character, *numbers)
        made[other.character] = plan.stage(f"onto_{other.character}", make, facts, *inputs)
    return made


def make(context: StageContext) -> None:
    """Align the two faces, measure every way to move the other one, and write the pose that the figure shows."""
    from replicate.approximation.training import prepare
    from replicate.transfer.landmark_alignment import aligned, shared_marks
    from replicate.transfer.other_face_poses import ways_onto

    prepare("cpu")
    numbers, inputs = context.config, context.inputs
    rig, other = (_rig(inputs, name) for name in (numbers.source, numbers.other))
    marks = shared_marks(rig, other)
    face = aligned(rig.mesh, other.mesh, marks)
    model = coarse.load_model(inputs)
    ways = ways_onto(rig.mesh, face, model, refined.load_model(inputs))
    means = _means(context, rig, other, model, face, ways)
    (context.out / MEANS).write_text(json.dumps([asdict(mean) for mean in means], indent=1) + "\n", encoding="utf-8")
    params = drawn_samples.load(inputs).test_params[[shown_pose.load(inputs)]]
    known = bool(_shared(rig, other))
    shown = _poses(rig, model, _with_shared(rig, other, params) if known else params)
    own = other(_answers(rig, other, shown.params)) if known else other.mesh.neutral[None]
    posed = {name: np.float32(move(shown)[0]) for name, move in ways.items()}
    facts = {
        "faces": face.new.mesh.faces,
        "own": np.float32(own[0, face.vertices]),
        "source": shown.truth[0],
        "head": other.mesh.neutral,
    }
    np.savez(context.out / POSE, **facts, **posed)
    about = {"landmarks": len(marks.names), "scale": face.scale, "controls": len(_shared(rig, other))}
    context.note(**about, vertices=len(face.vertices))
    (context.out / ALIGNMENT).write_text(json.dumps(about) + "\n", encoding="utf-8")


def _means(
    context: StageContext, rig: "Rig", other: "Rig", model: "SegmentedModel", face: object, ways: Mapping
) -> list[Mean]:
    """Return the mean errors against the other rig at the same controls; none where no control has the same name."""
    from replicate.transfer.new_mesh_poses import pose_means

    numbers, test = context.config, drawn_samples.load(context.inputs).test_params
    rows = measurement.measured_poses(test, numbers.test_poses, numbers.seed)
    if not _shared(rig, other):
        return []
    errors = {name: [] for name in ways}
    with context.progress(len(rows), f"onto {numbers.other}") as bar:
        for start in range(0, len(rows), numbers.batch):
            params = _with_shared(rig, other, test[rows[start : start + numbers.batch]])
            poses = _poses(rig, model, params)
            truth = np.float32(other(_answers(rig, other, params))[:, face.vertices])
            for name, move in ways.items():
                errors[name].append(pose_means(move(poses), truth, face.new.mesh.faces))
            bar.update(len(params))
    return [
        Mean(numbers.other, name, "", *np.concatenate(own).mean(0).tolist(), len(rows)) for name, own in errors.items()
    ]


def _rig(inputs: Mapping[str, Path], character: str) -> "Rig":
    return landmark_rig.load({landmark_rig.NAME: inputs[f"{landmark_rig.NAME}-{character}"]})


def _poses(rig: "Rig", model: "SegmentedModel", params: np.ndarray) -> object:
    from replicate.transfer.new_mesh_poses import SourcePoses

    neutral = rig.mesh.neutral
    return SourcePoses(params, np.float32(rig(params)), neutral + model.offsets(params))


def _shared(rig: "Rig", other: "Rig") -> list[tuple[int, int]]:
    """Return the controls that both rigs name, as indices into the one's and the other's."""
    theirs = {control.name: k for k, control in enumerate(other.controls)}
    return [(j, theirs[control.name]) for j, control in enumerate(rig.controls) if control.name in theirs]


def _with_shared(rig: "Rig", other: "Rig", params: Float32[np.ndarray, "b m"]) -> Float32[np.ndarray, "b m"]:
    """Return parameters with defaults for the controls that the other rig doesn't have."""
    kept = [j for j, _ in _shared(rig, other)]
    out = np.tile(rig.default, (len(params), 1)).astype(np.float32)
    out[:, kept] = params[:, kept]
    return out


def _answers(rig: "Rig", other: "Rig", params: Float32[np.ndarray, "b m"]) -> Float32[np.ndarray, "b k"]:
    """Return the other rig's parameters: the same numbers under the same names, within its limits."""
    ours, theirs = np.array(_shared(rig, other)).T
    out = np.tile(other.default, (len(params), 1)).astype(np.float32)
    out[:, theirs] = params[:, ours]
    return np.clip(out, other.lower, other.upper)


def load_means(folder: Path) -> list[Mean]:
    """Return all mean errors of one other face."""
    return [Mean(**entry) for entry in json.loads((folder / MEANS).read_text(encoding="utf-8"))]


def load_alignment(folder: Path) -> dict[str, float]:
    """Return how many landmarks and controls both characters have, and the scale of offsets."""
    return json.loads((folder / ALIGNMENT).read_text(encoding="utf-8"))


def load_pose(folder: Path) -> dict[str, np.ndarray]:
    """Return the shown pose, mm: the other face as its own rig has it (neutral without shared controls), and moved.

    faces: its triangles. source: the original as its rig has it. head: all of the other character, neutral.
    """
    with np.load(folder / POSE, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}
