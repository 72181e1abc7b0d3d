"""Put together the test poses that figures show from the artefacts of a run, and list the stages that make those."""

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
    """The settings of a figure of poses; limit_deg: the upper end of the colours; titles: the methods' titles."""

    character: str
    profile: str
    limit_deg: float
    titles: tuple[str, ...]


def picture_settings(plan: Plan, methods: Sequence[Method]) -> PosePicture:
    """Return the settings of a stage that draws the poses of a plan's character."""
    titles = tuple(method.title for method in methods)
    return PosePicture(plan.character, plan.config.profile, plan.config.evaluation.heatmap_deg, titles)


def input_stages(plan: Plan, methods: Sequence[Method], typical: bool = True) -> list[Stage]:
    """Return the stages whose artefacts `load_records` reads.

    typical: with the median and the worst pose. If `methods` lack the one that ranks poses, the committed results say
    which these are.
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
    """Return the stages of a figure or table that needs `load_records`, those of the methods, the slow ones, first.

    methods: the methods whose predictions are shown
    name: of the last stage
    function: of the last stage
    settings: of the last stage, as for `Plan.stage`
    typical: as for `input_stages`
    """
    inputs = input_stages(plan, methods, typical)
    last = plan.stage(name, function, settings, *inputs)
    return [*(stage for method in methods for stage in method.stages(plan)), *inputs, last]


def committed_poses(plan: Plan) -> KnownPoses | None:
    """Return the median and the worst pose of the committed results, if those have the plan's samples, or None."""
    samples, character = artefacts.samples_stage(plan), plan.character
    entry = manifest.entries(paths.REFERENCE, manifest.TOP).get(character, {})
    is_first = plan.config.seed == min(entry.get("seeds", ()), default=None)  # committed poses are of the first seed
    if not is_first or entry.get("stages", {}).get(samples.title, {}).get("key") != samples.key:
        return None
    try:
        median, worst = (load_pose(pose_file(paths.REFERENCE, character, choice)) for choice in typical_poses.CHOICES)
    except InputError:  # no poses are committed of a face from elsewhere
        return None
    return KnownPoses(median.ranked_by, median.pose, worst.pose)


def load_records(character: str, inputs: Mapping[str, Path]) -> dict[str, PoseRecord]:
    """Return the test poses in the artefacts of `input_stages`, by the rule that chose them.

    The pose with the most folds has the vertices of every method, the others only of the methods that figures show.
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


# The last stage of Table 4 and Figure 11, which reads methods, IK networks and a character's drags.


def posing_stage(
    plan: Plan, name: str, function: Callable, settings: object, methods: Sequence[Method], inputs: Iterable[Stage]
) -> Stage:
    """Return a stage that poses a character by its drags; an edit of the code that reads its methods runs it anew.

    name: of the stage
    function: of the stage
    settings: of the stage, as for `Plan.stage`
    methods: the methods that it evaluates
    inputs: the stages that it needs; repeated ones are dropped
    """
    readers = [source for method in methods for source in reading(method, plan.config).sources]
    functions = ", ".join(dict.fromkeys(map(reference, (function, *readers))))
    once = {stage.title: stage for stage in inputs}
    return plan.stage(name, functions, settings, *once.values(), files=files_of(plan.config.character))


# The settings of stages that draw figures.


@dataclass(frozen=True)
class Picture:
    """The character of a figure, and the seed that picks its examples."""

    character: str
    seed: int
