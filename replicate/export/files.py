"""Parts as bytes of OBJ and GLB, by trimesh; and bytes as files that appear whole or not at all."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from data_recipes.rig import BATCH, Rig
from replicate.base.exceptions import InputError
from replicate.base.files import shortage_number, write_bytes
from replicate.base.progress import progress
from replicate.base.user_files import check_output_file
from replicate.drawing.characters import COLOURS, colours_by_segment
from replicate.geometry.mesh import vertex_normals

# A character in a pose as plain coloured meshes: the head first, then each prop that it has.


@dataclass(frozen=True)
class Part:
    """One mesh of a file.

    name: of its node or object
    vertices: (n, 3), mm
    normals: (n, 3), unit vectors
    faces: (f, 3)
    colours: of the vertices, (n, 3) uint8, sRGB
    uv: (n, 2) in [0, 1], each vertex in the chart of its segment, or None
    """

    name: str
    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    colours: np.ndarray
    uv: np.ndarray | None = None


def unit_normals(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "*b n 3"]:
    """Return vertex normals of length 1; a vertex that has none, in a part as thin as a line, gets (0, 0, 1)."""
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
    """Return a head's skin, teeth, gums, tongue and mouth as separate parts, for files with one colour a part.

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


MM_PER_M = 1000.0
ROUGHNESS, WET_ROUGHNESS = 0.6, 0.15
OBJ_DIGITS = 5  # after the point: 10 nanometres
AXES = "x to the character's left, y up, z forward"


def glb(parts: Sequence[Part], about: dict, finish: Callable | None = None) -> bytes:
    """Return a GLB in metres, a node a part, with normals, vertex colours and, where there are any, UVs.

    about: words for the scene's extras. finish: called with trimesh's buffers and glTF tree before they are joined.
    """
    import trimesh

    scene = trimesh.Scene(metadata=about)
    for part in parts:
        wet = part.name.startswith("eye")
        rgba = np.column_stack([linear(part.colours), np.full(len(part.colours), 255, np.uint8)])
        material = trimesh.visual.material.PBRMaterial(
            name="wet" if wet else "matt",
            baseColorFactor=(255, 255, 255, 255),
            metallicFactor=0.0,
            roughnessFactor=WET_ROUGHNESS if wet else ROUGHNESS,
            doubleSided=True,
        )
        visual = trimesh.visual.TextureVisuals(uv=part.uv, material=material)
        visual.vertex_attributes["color"] = rgba
        mesh = _mesh(trimesh, part, visual, part.vertices.astype(np.float64) / MM_PER_M)
        scene.add_geometry(mesh, node_name=part.name, geom_name=part.name)
    return trimesh.exchange.gltf.export_glb(scene, include_normals=True, buffer_postprocessor=finish)


def obj(parts: Sequence[Part], about: str, material_file: str) -> tuple[str, str]:
    """Return the texts of an OBJ in millimetres, an object and a material a part, and of its MTL file.

    An OBJ has no colours at vertices that all programs read, so each material has the median one of its part. Parts
    with UVs come first (trimesh counts texture coordinates by vertices). about: one line for the head of the OBJ.
    """
    import trimesh

    class PoseScene(trimesh.Scene):
        def dump(self, *_) -> list:
            return list(self.geometry.values())  # trimesh returns copies, which lose the normals shared at borders

    scene = PoseScene()
    for part in sorted(parts, key=lambda part: part.uv is None):
        material = trimesh.visual.material.SimpleMaterial(
            name=part.name.removesuffix("_left").removesuffix("_right"),
            diffuse=(*np.median(part.colours, axis=0).astype(int).tolist(), 255),
            ambient=(0, 0, 0, 255),
            specular=(25, 25, 25, 255),
        )
        visual = trimesh.visual.TextureVisuals(uv=part.uv, material=material)
        scene.add_geometry(_mesh(trimesh, part, visual, part.vertices), node_name=part.name, geom_name=part.name)
    text, beside = trimesh.exchange.obj.export_obj(
        scene,
        include_normals=True,
        return_texture=True,
        digits=OBJ_DIGITS,
        mtl_name=material_file,
        header=f"{about}; millimetres, {AXES}",
    )
    return text, beside[material_file].decode("utf-8")


def linear(colours: UInt8[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Return sRGB colours as the linear ones that glTF wants at vertices."""
    value = colours / 255.0
    value = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return np.rint(255 * value).astype(np.uint8)


def write_whole(file: Path, data: bytes) -> None:
    """Write a file beside its place and rename it; whatever goes wrong, an old file stays as it was.

    Raises InputError where nothing may be written, and OSError when the disk is full.
    """
    check_output_file(file)
    try:
        write_bytes(file, data)
    except OSError as error:
        if shortage_number(error, file.parent):
            raise
        raise InputError(f"{file} can't be written ({error.strerror}): name another file") from None


def _mesh(trimesh, part: Part, visual, vertices: np.ndarray):
    return trimesh.Trimesh(
        vertices=vertices,
        faces=part.faces,
        vertex_normals=part.normals,
        visual=visual,
        process=False,
        metadata={"name": part.name},
    )
