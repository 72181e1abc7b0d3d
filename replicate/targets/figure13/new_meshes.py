"""The stage "new_meshes": the surface of the coarse networks' segments with half and a quarter of its vertices."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from replicate.artefacts import built_rig, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh

if TYPE_CHECKING:
    import replicate.transfer.remeshing

SHARES = {"half": 0.5, "quarter": 0.25}
POSES = 256  # of the training, whose mean is the pose that is decimated


@dataclass(frozen=True)
class NewMeshNumbers:
    """Which shares of the vertices the new meshes have, and of how many training poses the mean is decimated."""

    shares: tuple[float, ...]
    poses: int = POSES


def stage(plan: Plan) -> Stage:
    """Return the stage that makes the new meshes."""
    inputs = (built_rig.stage(plan), drawn_samples.stage(plan), rigid_segments.stage(plan))
    return plan.stage("new_meshes", make, NewMeshNumbers(tuple(SHARES.values())), *inputs)


def make(context: StageContext) -> None:
    """Make the new meshes, and find the original's face that each of their faces follows."""
    from replicate.transfer.deformation_transfer import counterparts
    from replicate.transfer.remeshing import reach_of, remeshed
    from replicate.transfer.surface_ways import Nearby, surface_ways

    mesh, sizes = built_rig.load_mesh(context.inputs), {}
    segments = deforming(context.inputs, mesh)
    faces = faces_of(mesh, segments)
    samples = drawn_samples.load(context.inputs)
    some = np.linspace(0, len(samples) - 1, min(context.config.poses, len(samples))).astype(int)
    shape = mesh.neutral + samples.offsets(some).mean(0)
    ways, reach = surface_ways(mesh.neutral, faces), reach_of(mesh.neutral, faces)
    with context.progress(len(SHARES), "new meshes") as bar:
        for name, share in zip(SHARES, context.config.shares, strict=True):
            new = remeshed(mesh, segments, share, shape)
            new.save(context.out / f"{name}.npz")
            nearby = Nearby(new.places.mix(ways), ways, reach)
            own = counterparts(new.mesh.neutral, new.mesh.faces, mesh.neutral, faces, nearby)
            np.save(context.out / f"{name}_counterparts.npy", own.astype(np.int32))
            sizes[name] = len(new.mesh.neutral)
            bar.update(1)
    context.note(vertices=sizes)


def deforming(inputs: Mapping[str, Path], mesh: Mesh) -> list[int]:
    """Return the segments that coarse networks deform, as indices."""
    rigid = set(rigid_segments.load(inputs).segment.tolist())
    return [k for k in range(len(mesh.segment_names)) if k not in rigid]


def faces_of(mesh: Mesh, segments: list[int]) -> Int[np.ndarray, "f 3"]:
    """Return the mesh's faces all of whose corners lie in some segments."""
    return mesh.faces[np.isin(mesh.segment[mesh.faces], segments).all(1)]


def load(inputs: Mapping[str, Path]) -> "dict[str, replicate.transfer.remeshing.NewMesh]":
    """Return the new meshes by the names of `SHARES`."""
    from replicate.transfer.remeshing import NewMesh

    return {name: NewMesh.load(inputs["new_meshes"] / f"{name}.npz") for name in SHARES}


def load_counterparts(inputs: Mapping[str, Path], name: str) -> Int[np.ndarray, " g"]:
    """Return the face that each face of a new mesh follows, as an index into `faces_of`."""
    return np.load(inputs["new_meshes"] / f"{name}_counterparts.npy", allow_pickle=False)
