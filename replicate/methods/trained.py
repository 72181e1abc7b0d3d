"""Trained models that come with the repository, in results/trained, so that a face can be posed before one trains.

A zip for each character holds the artefacts of some stages as the cache would, `manifest.json` what they are. A plan
for them has those stages' artefacts taken from the zip; tables and figures have no such plan, they train.
"""

import hashlib
import io
import json
import shutil
import zipfile
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_recipes.rig import Rig
from replicate.base.exceptions import RunError
from replicate.base.paths import RESULTS, display_path
from replicate.config import Config
from replicate.engine.stage import StageContext
from replicate.engine.store import artefact_folder
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan

FOLDER, MANIFEST = RESULTS / "trained", "manifest.json"
NEUTRAL, CONTROLS, TEST_POSES = "neutral.npy", "controls.json", "test_poses.npy"  # in a zip, beside the stages' folders
NOTES = MANIFEST  # in a stage's folder there: what its training noted
NEAR_MM = 0.01  # how far neutral vertices may be off: other processors round otherwise


@dataclass(frozen=True)
class Taken:
    """The settings of a stage that is taken from a zip. folder: its folder there. words: which models they are."""

    folder: str
    words: str


class TrainedPlan(Plan):
    """The plan of a character whose trained stages are taken from its zip; facts: its entry in the manifest."""

    def __init__(self, config: Config, facts: dict):
        super().__init__(config)
        self.facts, self.words = facts, f"{facts['profile']}, seed {facts['seed']}, commit {facts['commit'][:7]}"
        rig, file = artefacts.rig_stage(self), FOLDER / facts["file"]
        for name in facts["stages"]:
            self.stage(name, take, Taken(name, self.words), rig, files=(file,))

    def in_words(self) -> str:
        """Return which models these are, and how one gets others, in a sentence."""
        return (
            f"{self.character}: with the trained models that come with the repository ({self.words}); "
            f"`make table2 CHARACTERS={self.character}` trains your own"
        )


def origin(plan: Plan) -> str:
    """Return which models of the repository a plan takes, as a part of a sentence; "" if it takes none."""
    return f", from trained models of the repository ({plan.words})" if isinstance(plan, TrainedPlan) else ""


def plan_for(config: Config, methods: Sequence[Method], stages: Collection[str]) -> Plan:
    """Return a character's plan with the trained models that come with the repository, or else an ordinary one.

    methods: those that are shown.
    stages: names of all trained stages that are needed.

    The plan is an ordinary one if the repository has not all of them with the same profile and seed, or if the cache
    has a model of these methods that was trained here. Raises RunError for a damaged manifest or zip.
    """
    plan, facts = Plan(config), entries().get(config.character)
    if facts is None or (config.profile, config.seed) != (facts["profile"], facts["seed"]):
        return plan
    own = [stage for method in methods for stage in method.stages(plan)]
    if not {*stages} <= {*facts["stages"]} or any(artefact_folder(stage.identifier).exists() for stage in own):
        return plan
    _check_zip(FOLDER / facts["file"], facts["sha256"])
    return TrainedPlan(config, facts)


def entries() -> dict[str, dict]:
    """Return the manifest's entry of each character; none without a manifest. Raises RunError for a damaged one."""
    file = FOLDER / MANIFEST
    try:
        characters = json.loads(file.read_text(encoding="utf-8"))
        return {name: facts for name, facts in characters.items() if facts["stages"] and facts["sha256"]}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
        raise RunError(_damaged(file, f"it can't be read ({error})")) from None


def take(context: StageContext) -> None:
    """Take a stage's files from its character's zip, whose models have to be of the same rig."""
    (file,), settings = context.files, context.config
    try:
        with zipfile.ZipFile(file) as archive:
            _check_rig(context, archive)
            for name in archive.namelist():
                folder, _, rest = name.partition("/")
                if folder == settings.folder and rest not in ("", NOTES):
                    with archive.open(name) as source, open(context.out / rest, "wb") as target:
                        shutil.copyfileobj(source, target)
            notes = json.loads(archive.read(f"{settings.folder}/{NOTES}"))["notes"]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        raise RunError(_damaged(file, f"it can't be read ({error})")) from None
    context.note(**notes, trained=settings.words)


def poses_of_errors(file: Path) -> np.ndarray:
    """Return the rig parameters (b, m) of the poses that a zip's errors in the manifest are of."""
    with zipfile.ZipFile(file) as archive:
        return np.load(io.BytesIO(archive.read(TEST_POSES)), allow_pickle=False)


def controls_of(rig: Rig) -> list[list]:
    """Return name, lower limit, default and upper limit of each control, JSON-ready."""
    return [[control.name, control.lower, control.default, control.upper] for control in rig.controls]


def digest(file: Path) -> str:
    """Return a file's SHA-256."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _check_rig(context: StageContext, archive: zipfile.ZipFile) -> None:
    """Raise RunError unless the rig has the controls and the neutral mesh of the one that the models are trained on."""
    neutral = np.load(io.BytesIO(archive.read(NEUTRAL)), allow_pickle=False)
    rig = artefacts.load_rig(context.inputs)
    own = rig.mesh.neutral
    if json.loads(archive.read(CONTROLS)) != controls_of(rig):
        what = "controls"
    elif own.shape != neutral.shape or not np.abs(own - neutral).max() < NEAR_MM:
        what = "a neutral mesh"
    else:
        return
    (file,) = context.files
    raise RunError(
        f"{display_path(file)}: expected the rig that these models were trained on, got one with {what} of its own; "
        "`make table2 METHODS=regional` of the character trains models of this one"
    )


def _check_zip(file: Path, sha256: str) -> None:
    try:
        damage = "" if digest(file) == sha256 else "its checksum is not the manifest's"
    except OSError as error:
        damage = f"it can't be read ({error.strerror})"
    if damage:
        raise RunError(_damaged(file, damage))


def _damaged(file: Path, damage: str) -> str:
    return f"{display_path(file)}: {damage}; `git checkout {display_path(FOLDER)}` brings back what is committed"
