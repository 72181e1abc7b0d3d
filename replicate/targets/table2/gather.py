"""One character's part of Table 2, gathered from the artefacts of its stages."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from replicate.approximation.cnn import load_coarse
from replicate.approximation.evaluation import error_rows, load_errors, texel_rows
from replicate.approximation.rigid import Attachments
from replicate.approximation.segments import load_segments
from replicate.engine.store import read_manifest
from replicate.geometry.mesh import Mesh
from replicate.report.pose_record import TRUTH, PoseRecord
from replicate.report.results import Row
from replicate.report.training_curves import Curve, read_log

TRAINED = ("coarse", "refined", "dense", "driven")
PREFIX = "errors_"


def run_name(inputs: Mapping[str, Path]) -> str:
    """Return the name of a run: a hash of the keys of the artefacts that its numbers come from."""
    return hashlib.sha256("\n".join(sorted(path.name for path in inputs.values())).encode()).hexdigest()[:12]


def measured(inputs: Mapping[str, Path]) -> dict[str, Path]:
    """Return, for every measured method, the artefact that holds its errors.

    An input goes by its stage's name and by its title, name-character; the names alone are wanted.
    """
    names = (name for name in inputs if name.startswith(PREFIX) and "-" not in name)
    return {name.removeprefix(PREFIX): inputs[name] for name in names}


def rows_of(settings, inputs: Mapping[str, Path], mesh: Mesh) -> list[Row]:
    """Return a character's rows: errors, texels per vertex, model sizes, and what §3.4 found.

    settings: `character` and `profile` label the rows. inputs: the folders of the stages that `pipeline` names.
    """
    run = run_name(inputs)
    rows = []
    for method, folder in measured(inputs).items():
        errors = load_errors(folder / "errors.npz")
        rows += error_rows(settings.character, {method: errors}, settings.profile, run)

    def row(method: str, metric: str, unit: str, value: float, poses: int | None = None) -> Row:
        return Row("table2", settings.character, method, metric, unit, value, None, 1, poses, settings.profile, run)

    coarse = load_coarse(inputs["coarse"])
    size = coarse.networks[0].map_size
    maps = {segment.name: (size, len(segment.vertices)) for segment in coarse.segments}
    squares = load_segments(inputs["selection"] / "segments.npz")
    finer = read_manifest(inputs["refined"])["config"]["fields"]["section"]["fields"]["map_size"]
    refined = maps | {segment.name: (finer, len(segment.vertices)) for segment in squares}
    rows += texel_rows(settings.character, {"coarse": maps, "refined": refined}, settings.profile, run)
    for method in TRAINED:
        rows.append(row(method, "model_size", "MB", read_manifest(inputs[method])["notes"]["size_mb"]))
    rows.append(row("refined", "refinement_segments", "count", len(squares)))
    attachments = Attachments.load(inputs["rigid"] / "attachments.npz")
    rows.append(row("attachment", "rigid_segments", "count", len(attachments.segment)))
    if len(attachments.segment):
        rows.append(row("attachment", "rigid_error_max", "mm", float(attachments.rigid_error_mm.max())))
        spread = float(attachments.spread_mm[:, 1].min())
        rows.append(row("attachment", "least_second_spread", "mm", spread))
    return rows


def curves_of(character: str, inputs: Mapping[str, Path]) -> dict[tuple[str, str], Curve]:
    """Return the held-out errors of a character's trainings, step by step."""
    return {(character, method): read_log(inputs[method] / "log.csv") for method in TRAINED}


def pose_of(
    character: str, inputs: Mapping[str, Path], mesh: Mesh, pose: int, offsets: np.ndarray, props
) -> PoseRecord:
    """Return the test pose that figures show, as it is and as every method predicts it.

    offsets: (n, 3) mm, its true ones. props: from `rig.pose_props`.
    """
    vertices = {TRUTH: mesh.neutral + np.asarray(offsets)}
    vertices |= {method: np.load(folder / "pose.npy") for method, folder in measured(inputs).items()}
    return PoseRecord(character, pose, mesh.neutral, mesh.faces, vertices, tuple(props))
