"""Performance capture (§5.3.2): a recording of landmarks drives a character."""

import argparse
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from data_recipes.catalogue import FACE_LANDMARKS
from replicate.base.exceptions import InputError
from replicate.base.files import check_writable, copy_file
from replicate.base.paths import display_path, run_folder, with_home
from replicate.base.schema import naming
from replicate.base.user_files import shown_path
from replicate.capture import landmark_rig
from replicate.capture.capture_config import CaptureConfig, CaptureSettings
from replicate.capture.capture_config import default_section as capture_section
from replicate.capture.landmark_file import read_landmarks
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


def stages(plan: Plan, methods: Sequence[Method] = (), landmarks: Path | None = None) -> list[Stage]:
    """Return the stages of one character's capture, the slow ones that train first.

    landmarks: the file of the recording; without it the last stage can't be run.
    """
    method = METHOD
    trained = landmark_rig.ik_stage_of(plan, method)
    settings = CaptureSettings(
        plan.character, section(plan.config), measurement.measurement_settings(method, plan.config)
    )
    shared = (artefacts.rig_stage(plan), artefacts.rigid_stage(plan), landmark_rig.stage(plan))
    inputs = {stage.title: stage for stage in (*shared, *method.stages(plan), trained)}
    functions = ", ".join(map(reference, (drive, *reading(method, plan.config).sources)))
    files = (landmarks,) if landmarks else ()
    return [*method.stages(plan), trained, plan.stage("capture", functions, settings, *inputs.values(), files=files)]


def section(config: Config) -> CaptureConfig:
    """Return a configuration's section `[capture]`."""
    return getattr(config, "capture", None) or capture_section(config.profile)


def drive(context: StageContext) -> None:
    """Drive the character by the recording and write the results."""
    from replicate.capture.capture_files import write_all

    context.note(**write_all(context.config, context.inputs, context.files[0], context.out))


def run(options: argparse.Namespace) -> None:
    """Drive every character by the recording, publish the files and print what they are."""
    landmarks = checked(options)
    publish(make(options, partial(stages, landmarks=landmarks), partial(plan_of, options)), landmarks.stem)


def plan_of(options: argparse.Namespace, config: Config) -> Plan:
    """Return a character's plan, where it can be with the models that come with the repository."""
    return plan_with_trained(options, config, [METHOD], [METHOD.name, landmark_rig.stage_name(METHOD.name), "rigid"])


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
            print(f"{facts['in_words']} Landmarks end {facts['landmark_error_mm']:.2f} mm from their targets.")


def checked(options: argparse.Namespace) -> Path:
    """Return the recording's file. Raises InputError for a missing or a bad one, before anything is trained."""
    from replicate.capture.landmark_motion import check_face, check_recording

    if not options.landmarks:
        raise InputError("no recording is named: add LANDMARKS=file.csv, a file as REPRODUCING.md describes it")
    file = Path(os.path.abspath(with_home(options.landmarks, "LANDMARKS")))
    for config in configurations(options):
        settings = section(config)
        names = tuple(FACE_LANDMARKS)
        recording = read_landmarks(file, names, settings.longest_gap)
        with naming(shown_path(file)):
            check_recording(recording, settings)
            check_face(recording, names, settings)
    return file
