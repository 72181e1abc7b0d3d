"""Parts as bytes of OBJ and GLB, by trimesh; and bytes as files that appear whole or not at all."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from replicate.engine.atomic_files import write_bytes
from replicate.engine.exceptions import InputError
from replicate.engine.full_disk import shortage_number
from replicate.engine.user_files import check_output_file
from replicate.export.parts import Part

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
            return list(self.geometry.values())  # trimesh's own are copies, which lose the normals shared at borders

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
    """Write a file beside and rename it into place; whatever goes wrong, the old one, if there is one, still stands.

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
