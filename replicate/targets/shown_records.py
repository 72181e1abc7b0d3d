"""The test poses that figures show, put together from the artefacts of a run; and the stages that make those."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.face_regions import face_regions
from replicate.inverse.configurations import files_of
from replicate.methods import artefacts, measurement, typical_poses
from replicate.methods.measurement import reading
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference
from replicate.methods.typical_poses import KnownPoses
from replicate.report import manifest
from replicate.report.pose_record import CHOICES, FOLDED, TRUTH, PoseRecord, load_pose, pose_file


@dataclass(frozen=True)
class PosePicture:
    """Whose poses are drawn as results of which profile, up to which normal error the colours go, and what the methods
    are called.
    """

    character: str
    profile: str
    limit_deg: float
    titles: tuple[str, ...]


def picture_settings(plan: Plan, methods: Sequence[Method]) -> PosePicture:
    """Return the settings of a stage that draws the poses of a plan's character."""
    titles = tuple(method.title for method in methods)
    return PosePicture(plan.character, plan.config.profile, plan.config.evaluation.heatmap_deg, titles)


def input_stages(plan: Plan, methods: Sequence[Method], typical: bool = True) -> list[Stage]:
    """Return the stages whose artefacts `load_records` reads. typical: with the median and the worst pose.

    Without the method that ranks them, these are the poses that the committed results show.
    """
    shared = [
        stage(plan)
        for stage in (artefacts.rig_stage, artefacts.samples_stage, artefacts.shown_pose_stage, artefacts.rigid_stage)
    ]
    errors = [measurement.stage(plan, method) for method in methods]
    typical_stages = typical_poses.stages(plan, methods, committed_poses(plan)) if typical else []
    return [*shared, *errors, *typical_stages]


def record_stages(
    plan: Plan,
    methods: Sequence[Method],
    name: str,
    function: Callable[[StageContext], None],
    settings: object,
    typical: bool = True,
) -> list[Stage]:
    """Return the stages that end with one that reads `load_records`; those of the methods, the slow ones, come first.

    name, function, settings: of the last stage, as for `Plan.stage`. typical: as for `input_stages`.
    """
    inputs = input_stages(plan, methods, typical)
    last = plan.stage(name, function, settings, *inputs)
    return [*(stage for method in methods for stage in method.stages(plan)), *inputs, last]


def committed_poses(plan: Plan) -> KnownPoses | None:
    """Return the median and the worst pose that the committed results show, if they are of the plan's samples."""
    samples, character = artefacts.samples_stage(plan), plan.character
    entry = manifest.entries(paths.REFERENCE, manifest.TOP).get(character, {})
    is_first = plan.config.seed == min(entry.get("seeds", ()), default=None)  # poses are of a character's first seed
    if not is_first or entry.get("stages", {}).get(samples.title, {}).get("key") != samples.key:
        return None
    try:
        median, worst = (load_pose(pose_file(paths.REFERENCE, character, choice)) for choice in typical_poses.CHOICES)
    except InputError:  # of a face from elsewhere there are no poses
        return None
    return KnownPoses(median.ranked_by, median.pose, worst.pose)


def load_records(character: str, inputs: Mapping[str, Path]) -> dict[str, PoseRecord]:
    """Return the test poses that the artefacts of `input_stages` hold, by the rule that chose them.

    The pose with the most folds has the vertices of every method, the others those of the methods that figures show.
    """
    rig, samples = artefacts.load_rig(inputs), artefacts.load_samples(inputs)
    mesh, regions = rig.mesh, face_regions(rig.mesh, rig.face_marks, rig.face_mark_regions)
    ranked_by, chosen = typical_poses.load_chosen(inputs) if "ranked" in inputs else ("", {})
    records = {}
    for choice in CHOICES:
        if choice == FOLDED:
            pose, folders = artefacts.load_shown_pose(inputs), measurement.error_folders(inputs)
            predicted = {method: measurement.load_pose(folder) for method, folder in folders.items()}
        elif choice in chosen:
            pose, predicted = chosen[choice], typical_poses.load_predictions(inputs, choice)
        else:
            continue
        truth = mesh.neutral + np.asarray(samples.test_offsets[pose], np.float32)
        props = tuple(rig.pose_props(samples.test_params[pose]))
        rule = choice, "" if choice == FOLDED else ranked_by
        vertices = {TRUTH: truth} | predicted
        records[choice] = PoseRecord(character, pose, mesh.neutral, mesh.faces, vertices, props, *rule, *regions)
    return records


# What Table 4 and Figure 11 end with: a stage that sees methods, IK networks and a character's drags.


def posing_stage(
    plan: Plan, name: str, function: Callable, settings: object, methods: Sequence[Method], inputs: Iterable[Stage]
) -> Stage:
    """Return a stage that poses a character by its drags; the code that its methods are read with counts as its own.

    function, settings: as for `Plan.stage`. inputs: what it needs; a stage that is named twice counts once.
    """
    readers = [source for method in methods for source in reading(method, plan.config).sources]
    functions = ", ".join(dict.fromkeys(map(reference, (function, *readers))))
    once = {stage.title: stage for stage in inputs}
    return plan.stage(name, functions, settings, *once.values(), files=files_of(plan.config.character))


# The settings of stages that draw figures.


@dataclass(frozen=True)
class Picture:
    """Whose figure is drawn, and the seed that decides its examples."""

    character: str
    seed: int
