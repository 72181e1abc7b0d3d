"""Performance capture (§5.3.2): a recording of landmarks drives a character."""

import argparse
import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from data_recipes.catalogue import FACE_LANDMARKS, character_parts, control_names, sampled_parts, without_counterpart
from data_recipes.recipe_paths import character_label, sample_folder
from replicate.base.exceptions import InputError
from replicate.base.files import check_writable, copy_file
from replicate.base.paths import display_path, run_folder, with_home
from replicate.base.schema import naming
from replicate.base.user_files import shown_path
from replicate.capture import landmark_rig
from replicate.capture.capture_config import CaptureConfig, CaptureSettings
from replicate.capture.capture_config import default_section as capture_section
from replicate.cli.options import configurations
from replicate.cli.running import make, plan_with_trained
from replicate.config import Config
from replicate.engine.stage import Stage, StageContext
from replicate.engine.store import read_manifest
from replicate.methods import artefacts, measurement, regional
from replicate.methods.measurement import reading
from replicate.methods.method import Method
from replicate.methods.plan import Plan, reference
from replicate.report.publication import CharacterResult, alone, by_character

METHOD = regional.METHOD  # gives the mesh; the IK networks are trained through it


def stages(
    plan: Plan, methods: Sequence[Method] = (), landmarks: Path | None = None, weights: bool = False
) -> list[Stage]:
    """Return the stages of one character's capture, the slow ones that train first.

    landmarks: the file of the recording; without it the last stage can't be run.
    weights: whether it gives weights and no landmarks, so that nothing has to be solved for unless an actor plays them.
    """
    method = METHOD
    plays = section(plan.config).actor if weights else ""
    actor = Plan(replace(plan.config, character=plays)) if plays else None
    settings = CaptureSettings(
        plan.character,
        section(plan.config),
        measurement.measurement_settings(method, plan.config),
        actor.character if actor else "",
    )
    made, shared = list(method.stages(plan)), [artefacts.rig_stage(plan), artefacts.rigid_stage(plan)]
    if actor or not weights:
        made.append(landmark_rig.ik_stage_of(plan, method))
        shared.append(landmark_rig.stage(plan))
    if actor:
        shared.append(landmark_rig.stage(actor))
    inputs = {stage.title: stage for stage in (*shared, *made)}
    functions = ", ".join(map(reference, (drive, *reading(method, plan.config).sources)))
    files = (landmarks,) if landmarks else ()
    return [*made, plan.stage("capture", functions, settings, *inputs.values(), files=files)]


def section(config: Config) -> CaptureConfig:
    """Return a configuration's section `[capture]`."""
    return getattr(config, "capture", None) or capture_section(config.profile)


def drive(context: StageContext) -> None:
    """Drive the character by the recording and write the results."""
    from replicate.capture.capture_files import write_all

    context.note(**write_all(context.config, context.inputs, context.files[0], context.out))


def run(options: argparse.Namespace) -> None:
    """Drive every character by the recording, publish the files and print what they are."""
    file, weights = checked(options)
    publish(
        make(options, partial(stages, landmarks=file, weights=weights), partial(plan_of, options, weights)), file.stem
    )


def plan_of(options: argparse.Namespace, weights: bool, config: Config) -> Plan:
    """Return a character's plan, where it can be with the models that come with the repository.

    weights: whether the recording gives them, so that no IK networks are needed.
    """
    networks = [] if weights else [landmark_rig.stage_name(METHOD.name)]
    return plan_with_trained(options, config, [METHOD], [METHOD.name, *networks, "rigid"])


def publish(results: Sequence[CharacterResult], recording: str) -> None:
    """Copy the files of some characters to results/runs/capture, with the recording's name in theirs.

    Of several seeds the first is taken. The folder isn't a profile's, since a recording belongs to no table.
    """
    folder = run_folder("capture")
    check_writable(folder, "REPLICATE_RESULTS")
    with alone(folder):
        for character, (first, *_) in by_character(results).items():
            names = []
            for file in sorted(first.folder.glob("capture*")):
                names.append(f"{character}_{recording}{file.name.removeprefix('capture')}")
                copy_file(file, folder / names[-1])
            facts = read_manifest(first.folder)["notes"]
            print(f"written to {display_path(folder)}: {', '.join(names)}")
            print("\n".join(filter(None, (facts["in_words"], facts["lacking"]))))


def checked(options: argparse.Namespace) -> tuple[Path, bool]:
    """Return the recording's file, and whether it gives weights.

    Raises InputError for a missing or a bad one, and for a character that it can't drive, before anything is trained.
    """
    from replicate.capture.landmark_motion import check_face, check_recording
    from replicate.capture.tracker_files import Weights, read_recording

    if not options.landmarks:
        raise InputError(
            "no recording is named: add LANDMARKS=file.csv, a file as “Your own face drives a character” in "
            "REPRODUCING.md describes it"
        )
    file, weights = Path(os.path.abspath(with_home(options.landmarks, "LANDMARKS"))), False
    for config in configurations(options):
        settings = section(config)
        recording = read_recording(file, settings)
        weights = isinstance(recording, Weights)
        with naming(shown_path(file)):
            if isinstance(recording, Weights):
                check_controls(recording.names, settings.actor or config.character, bool(settings.actor))
            else:
                check_recording(recording, settings)
                check_face(recording, tuple(FACE_LANDMARKS), settings)
    return file, weights


def check_controls(names: Sequence[str], character: str, plays: bool) -> None:
    """Raise InputError for a character none of whose controls has one of these names of ARKit's.

    plays: whether it only plays the weights so that its landmarks drive another one, for which it needs a function.
    """
    folder, label = sample_folder(character), character_label(character)
    if folder and plays:
        raise InputError(f"[capture] actor: {label} is known by its samples alone: choose a face that has a function")
    parts = sampled_parts(folder) if folder else character_parts(character)
    if len(without_counterpart(names, control_names(*parts))) == len(names):
        raise InputError(
            f"it gives weights of ARKit's shapes, and {label} has no control of such a name: record landmarks, or let "
            'a face with these names play them, whose landmarks drive this one, by [capture] actor = "head.glb" in a '
            "CONFIG file"
        )
