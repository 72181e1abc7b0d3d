"""A character in a pose as plain coloured meshes: the head first, then each prop that it has."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from data_recipes.rig import BATCH, Rig
from replicate.drawing.characters import COLOURS, colours_by_segment
from replicate.engine.progress import progress
from replicate.geometry.normals import vertex_normals


@dataclass(frozen=True)
class Part:
    """One mesh of a file.

    name: of its node or object. vertices (n, 3) mm; normals (n, 3), unit vectors. faces (f, 3). colours: (n, 3) uint8,
    sRGB, one a vertex. uv: (n, 2) in [0, 1], each vertex in its own segment's chart, or None.
    """

    name: str
    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    colours: np.ndarray
    uv: np.ndarray | None = None


def unit_normals(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "*b n 3"]:
    """Return vertex normals of length 1 throughout: where there is none, in a part that is flat to a line, forwards."""
    normals = vertex_normals(vertices, faces)
    normals[(normals == 0).all(-1)] = (0, 0, 1)
    return normals


def posed_parts(rig: Rig, params: Float[np.ndarray, " m"]) -> list[Part]:
    """Return the head, its vertices those of the rig in their order, and the props, in one pose.

    Vertices of props that are in no face are left out: a sphere's pole is many vertices in one place.
    """
    mesh = rig.mesh
    vertices = rig(params)
    colours = colours_by_segment(mesh)[mesh.segment] if rig.paint is None else rig.paint
    head = Part(rig.name, vertices, unit_normals(vertices, mesh.faces), mesh.faces, colours, mesh.uv)
    parts = [head]
    for name, vertices, faces, colours in rig.pose_props(params):
        used, faces = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used], faces.reshape(-1, 3).astype(np.int32)
        parts.append(Part(name, vertices, unit_normals(vertices, faces), faces, np.asarray(colours, np.uint8)[used]))
    return parts


def moving_parts(rig: Rig, poses: Float[np.ndarray, "t m"]) -> tuple[list[Part], list[Float32[np.ndarray, "t n 3"]]]:
    """Return the parts in the rig's neutral pose, and where the vertices of each are in every frame, in mm."""
    rest = posed_parts(rig, rig.default)
    used = [np.unique(faces) for _, _, faces, _ in rig.pose_props(rig.default)]
    frames = [np.empty((len(poses), *part.vertices.shape), np.float32) for part in rest]
    with progress(len(poses), "frames") as bar:
        for first in range(0, len(poses), BATCH):
            batch = poses[first : first + BATCH]
            frames[0][first : first + BATCH] = rig(batch)
            for t, params in enumerate(batch, start=first):
                for track, (_, vertices, _, _), rows in zip(frames[1:], rig.pose_props(params), used, strict=True):
                    track[t] = vertices[rows]
                bar.update(1)
    return rest, frames


def by_material(rig: Rig, head: Part) -> list[Part]:
    """Return a head's skin, teeth, gums, tongue and mouth as parts of their own, for files with a colour a part.

    Vertices keep their order; those on a border are in both parts, with the same normals.
    """
    starts = [next((s for s in COLOURS if name.startswith(s)), "skin") for name in rig.mesh.segment_names]
    of_face = np.array(starts)[rig.mesh.face_segment]
    parts = []
    for start in ("skin", *COLOURS):
        faces = head.faces[of_face == start]
        if len(faces):
            used, faces = np.unique(faces, return_inverse=True)
            arrays = (array[used] for array in (head.vertices, head.normals))
            parts.append(
                Part(
                    f"{head.name}_{start}",
                    *arrays,
                    faces.reshape(-1, 3).astype(np.int32),
                    head.colours[used],
                    head.uv[used],
                )
            )
    return parts
