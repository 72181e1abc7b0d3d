"""The artefact "rigid": the segments that move rigidly, and the vertices that carry them (§3.4); and what is left."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.artefacts import built_rig, control_influence, drawn_samples
from replicate.artefacts.plan import Plan
from replicate.config import RigidConfig
from replicate.engine.stage import Stage, StageContext, stream_rng
from replicate.geometry.mesh import Mesh

if TYPE_CHECKING:
    import replicate.approximation.rigid
    import replicate.approximation.segments

FILE = "attachments.npz"


def stage(plan: Plan) -> Stage:
    """Return the stage that looks for rigid segments and for what carries them."""
    inputs = (built_rig.stage(plan), drawn_samples.stage(plan))
    return plan.stage("rigid", make, plan.numbers(plan.config.rigid), *inputs)


def make(context: StageContext) -> None:
    """Look for rigid segments, and for the vertices that carry them, in training poses (Eq. 3 and 4)."""
    from replicate.approximation.rigid import find_attachments

    mesh, samples = built_rig.load_mesh(context.inputs), drawn_samples.load(context.inputs)
    section = context.config.section
    poses = samples.draw(context.rng("poses"), min(section.poses, len(samples)))
    attachments = find_attachments(mesh, mesh.neutral + samples.offsets(poses), section.tau_mm, section.attachments)
    attachments.save(context.out / FILE)
    context.note(rigid_segments=[mesh.segment_names[k] for k in attachments.segment])


def mean_errors(inputs: Mapping[str, Path], section: RigidConfig, seed: int) -> Float[np.ndarray, " s"]:
    """Return each segment's mean residual of Eq. 3 in mm, over the poses that `make` decides on."""
    from replicate.approximation.rigid import segment_errors

    mesh, samples = built_rig.load_mesh(inputs), drawn_samples.load(inputs)
    poses = samples.draw(stream_rng(seed, "rigid", "poses"), min(section.poses, len(samples)))
    return segment_errors(mesh, mesh.neutral + samples.offsets(poses)).mean(0)


def load(inputs: Mapping[str, Path]) -> "replicate.approximation.rigid.Attachments":
    """Return the rigid segments and their attachments."""
    from replicate.approximation.rigid import Attachments

    return Attachments.load(inputs["rigid"] / FILE)


def load_coarse_segments(
    inputs: Mapping[str, Path], mesh: Mesh
) -> "tuple[replicate.approximation.segments.Segment, ...]":
    """Return the segments of the coarse networks: the mesh's own, less the rigid ones."""
    from replicate.approximation.segments import coarse_segments

    return coarse_segments(mesh, load(inputs).segment.tolist(), control_influence.load(inputs))
