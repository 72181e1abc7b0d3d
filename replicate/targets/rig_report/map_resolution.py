"""The stage "rig_maps": what deformation maps of several sizes can hold of held-out poses, by least squares."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.artefacts import built_rig, control_influence, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext

if TYPE_CHECKING:
    import replicate.approximation.evaluation


def stage(plan: Plan) -> Stage:
    """Return the stage that projects test poses onto maps of several sizes."""
    modules = (built_rig, drawn_samples, control_influence, rigid_segments)
    inputs = (module.stage(plan) for module in modules)
    return plan.stage("rig_maps", make, plan.numbers(plan.config.rig_report.maps), *inputs)


def make(context: StageContext) -> None:
    """Measure the floor of each map size on test poses; rigid segments follow by their attachments, as in Table 2."""
    from replicate.approximation.deformation_map import Floor
    from replicate.approximation.evaluation import evaluate, unique_poses
    from replicate.approximation.rigid import attach

    section, inputs = context.config.section, context.inputs
    mesh, samples, attachments = built_rig.load_mesh(inputs), drawn_samples.load(inputs), rigid_segments.load(inputs)
    segments = rigid_segments.load_coarse_segments(inputs, mesh)
    poses = unique_poses(samples.test_params)
    poses = poses[:: -(-len(poses) // section.poses)]
    truth, rigid = (samples.test_params[poses], samples.test_offsets[poses]), attachments.segment.tolist()
    with context.progress(len(section.sizes) * len(poses), "rig report, maps") as bar:
        for size in section.sizes:
            floor = Floor(segments, size)

            def on_maps(params: np.ndarray, vertices: np.ndarray, floor: Floor = floor) -> np.ndarray:
                return attach(mesh, attachments, mesh.neutral + floor(vertices - mesh.neutral))

            evaluate(mesh, *truth, {"maps": on_maps}, rigid, progress=bar)["maps"].save(context.out / f"{size}.npz")


def load(inputs: Mapping[str, Path]) -> "dict[int, replicate.approximation.evaluation.Errors]":
    """Return the errors of each map size, in pixels."""
    from replicate.approximation.evaluation import load_errors

    files = sorted(inputs["rig_maps"].glob("*.npz"), key=lambda file: int(file.stem))
    return {int(file.stem): load_errors(file) for file in files}
