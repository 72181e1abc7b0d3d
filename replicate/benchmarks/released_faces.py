"""The released recipe and ours as faces: one pose as dense networks and CNNs of either recipe predict it."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.rigid import attach
from replicate.artefacts import built_rig, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.benchmarks.variants import Variant
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.heatmap import normal_bar, normal_heat
from replicate.drawing.panels import Words
from replicate.drawing.render import render
from replicate.drawing.split_face import middle_line, split_face
from replicate.engine.store import artefact_folder
from replicate.methods.method_registry import method_named
from replicate.report.clay_surfaces import clay_surfaces, view_of
from replicate.report.pose_record import TRUTH, PoseRecord

if TYPE_CHECKING:
    import matplotlib.figure

SHOWN = (
    ("dense", "released"),
    ("dense", "released, but controls, unit and normal weight as ours"),
    ("dense", "ours"),
    ("coarse", "released"),
    ("coarse", "ours"),
)
COLUMNS, TALL, LIMIT_DEG = 3, 1.2, 30.0  # faces in a row; a picture's height over its width; the end of the colours
LINES = ("mm", "degrees")


def faces_of(variants: Sequence[Variant]) -> PoseRecord:
    """Return a validation pose as the trained variants of `SHOWN` predict it.

    It is the one with the median motion: half of the validation poses are farther from the neutral one, by the mean
    over the vertices. Predictions are called "dense: released", ….
    """
    vertices, chosen = {}, {(variant.method, variant.change): variant for variant in variants}
    for method, change in SHOWN:
        plan = Plan(chosen[method, change].config)
        (stage,) = method_named(method).stages(plan)
        inputs = {one.name: artefact_folder(one.identifier) for one in (stage, *stage.inputs)}
        mesh, samples = built_rig.load_mesh(inputs), drawn_samples.load(inputs)
        row = median_pose(samples.validation_offsets)
        params = np.asarray(samples.validation_params[row : row + 1])
        predicted = mesh.neutral + method_named(method).model(inputs).offsets(params)
        predicted = attach(mesh, rigid_segments.load(inputs), predicted)[0]
        vertices[f"{method_named(method).label}: {change}"] = predicted.astype(np.float32)
    vertices[TRUTH] = (mesh.neutral + samples.validation_offsets[row]).astype(np.float32)
    props = tuple(built_rig.load(inputs).pose_props(params[0]))
    return PoseRecord(plan.character, row, mesh.neutral, mesh.faces, vertices, props)


def median_pose(offsets: Float[np.ndarray, "p n 3"]) -> int:
    """Return the index of the pose whose mean distance from the neutral one is the median."""
    motion = [float(np.linalg.norm(pose, axis=1).mean()) for pose in offsets]
    return int(np.argsort(motion, kind="stable")[(len(motion) - 1) // 2])


def released_faces(record: PoseRecord, renderer: str | None = None) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the rig's pose, and each prediction as half surface, half normal errors."""
    width = cell_width(COLUMNS, LINES)
    height = round(TALL * width)
    view = view_of(record, "front", width / height)
    draw = partial(render, camera=view, width=width, height=height, renderer=renderer)
    truth = record.vertices[TRUTH]
    cells, phrases = [Cell("the rig", (draw(clay_surfaces(record, TRUTH)),))], []
    for name, vertices in record.vertices.items():
        if name == TRUTH:
            continue
        heat = draw([normal_heat(vertices, truth, record.faces, LIMIT_DEG)])
        line = middle_line(record.neutral, truth, record.faces, view, width, height)
        distance = f"{vertex_error(vertices, truth).mean():.2f}"
        angle = f"{np.nanmean(normal_error(vertices, truth, record.faces)):.2f}"
        cells.append(Cell(name, (split_face(draw(clay_surfaces(record, name)), heat, line),), (distance, angle)))
        phrases.append(f"{name}, {distance} mm and {angle} degrees")
    bar = partial(normal_bar, limit_deg=LIMIT_DEG, orientation="horizontal")
    figure = face_sheet(cells, COLUMNS, LINES, bar)
    return figure, Words(
        f"Six heads in one pose: the rig, then five networks', left half clay, right half normal errors. "
        f"Mean errors: {'; '.join(phrases)}.",
        f"A validation pose of {record.character}, the median by how far it is from the neutral one. Left half of each "
        f"face: the surface; right half: the angle between predicted and true normals, 0° to {LIMIT_DEG:g}°. Below: "
        "the pose's mean errors.",
    )
