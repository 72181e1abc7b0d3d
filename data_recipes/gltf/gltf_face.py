"""A face as a glTF file has it: the triangles of its scene in file order, its morph targets and its joints."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from data_recipes.gltf.document import (
    Document,
    name_of,
    read_document,
    read_floats,
    read_view,
    read_whole,
    reals,
    reference,
    table_of,
)
from data_recipes.gltf.gltf_skin import GltfSkin, read_skin
from data_recipes.gltf.scene import STRIP, TRIANGLES, Part, attribute, find_parts, read_tree
from replicate.base.exceptions import InputError
from replicate.base.schema import naming, shown
from replicate.base.user_files import shown_path

MOST_CORNERS = 100_000_000
MOST_OFFSETS = 400_000_000  # numbers of all morph targets, 8 bytes each
MOST_SETS = 8  # of texture coordinates


@dataclass(frozen=True)
class GltfFace:
    """All triangles of a file's scene, in file order: depth first through its nodes, vertices of primitives in turn.

    Primitives of a mesh that share their vertices, as those of many avatars do, have them once.

    vertices: in metres, in the scene's axes (y up, z forwards), placed by their nodes or, where they are skinned, by
        their joints at rest; without morph targets.
    faces: vertex indices; mirrored parts are turned so that their normals still point outwards.
    uv: the first set of texture coordinates that every primitive has, or else that any has; v grows upwards.
    has_uv: which vertices have texture coordinates; uv is 0 at the others.
    nodes: of each face, the unique name of its node: "head", "head_2".
    materials: of each face, "" for none.
    targets: morph target → the offsets of all vertices in metres, in the scene's axes; one for all meshes that have it.
    weights: morph target → its default weight, which the first mesh that has the target says.
    base_colour: red, green and blue of the material's factor and texture, 1 without; None if no material has any.
    looks_back: the face looks along −z, as those of VRM 0.x do; all above is as the file has it nevertheless.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "n 2"] | None
    has_uv: Bool[np.ndarray, " n"]
    nodes: tuple[str, ...]
    materials: tuple[str, ...]
    targets: dict[str, Float[np.ndarray, "n 3"]]
    weights: dict[str, float]
    skin: GltfSkin | None
    base_colour: Float[np.ndarray, "n 3"] | None
    looks_back: bool


def read_gltf(file: Path) -> GltfFace:
    """Return the face of a GLB, glTF or VRM file; a glTF's buffers must lie beside it.

    Compressed files need the optional packages `meshoptimizer` or `DracoPy`. Raises InputError, in one sentence that
    names the file, for whatever is damaged, too large or out of range.
    """
    with naming(shown_path(file)), np.errstate(all="ignore"):
        document = read_document(file)
        tree = read_tree(document)
        parts, weights = find_parts(document, tree)
        n = sum(part.count for part in parts)
        if n * 3 * len(weights) > MOST_OFFSETS:
            raise InputError(f"expected at most {MOST_OFFSETS:,} offsets, got {len(weights)} targets of {n} vertices")
        skin, placements = read_skin(document, tree, parts, n)
        vertices, mirrored = np.zeros((n, 3)), np.zeros(n, bool)
        targets = {name: np.zeros((n, 3)) for name in weights}
        for part, placement in zip(parts, placements, strict=True):
            turn = placement[:, :3, :3]
            points = attribute(document, part, "POSITION", "VEC3")
            vertices[part.rows] = (turn @ points[:, :, None])[:, :, 0] + placement[:, :3, 3]
            mirrored[part.rows] = np.linalg.det(turn) < 0
            for k, (name, target) in enumerate(zip(part.targets, part.primitive.get("targets", []), strict=True)):
                index = reference(document, target, "POSITION", f"{part.place}.targets[{k}]", "accessors")
                if index is not None:
                    offsets = read_floats(document, index, "VEC3", part.count)
                    targets[name][part.rows] = (turn @ offsets[:, :, None])[:, :, 0]
        for name, array in {"vertices": vertices, **targets}.items():
            if not np.isfinite(array).all():
                raise InputError(f"{shown(name)}: expected transforms that keep numbers finite, got larger ones")
        faces, nodes, materials = _read_faces(document, parts, mirrored)
        uv, has_uv = _read_uv(document, parts, n)
        colour = read_colours(document, parts, n)
        kinds = table_of(document.tree, "extensions", "glTF")
        looks_back = "VRM" in kinds and "VRMC_vrm" not in kinds  # version 1.0 has turned round
        return GltfFace(vertices, faces, uv, has_uv, nodes, materials, targets, weights, skin, colour, looks_back)


def _read_faces(
    document: Document, parts: list[Part], mirrored: Bool[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, "f 3"], tuple[str, ...], tuple[str, ...]]:
    """Return all faces, and the node and the material of each."""
    faces, nodes, materials, corners = [], [], [], 0
    for part in parts:
        for primitive, place in part.uses:
            found = part.draco[1] if part.draco else _triangles(document, primitive, part.count, place)
            if len(found) and not 0 <= found.min() <= found.max() < part.count:
                raise InputError(f"{place}: expected vertices from 0 to {part.count - 1}, got {found.max()}")
            corners += found.size
            if corners > MOST_CORNERS:
                raise InputError(f"{place}: expected at most {MOST_CORNERS // 3:,} triangles in all, got more")
            faces.append(found + part.first)
            material = reference(document, primitive, "material", place, "materials")
            name = "" if material is None else name_of(document.tree["materials"][material], f"material_{material}")
            nodes += [part.name] * len(found)
            materials += [name] * len(found)
    every = np.concatenate([np.empty((0, 3), np.int64), *faces])
    if not len(every):
        raise InputError("expected a scene with triangles, got none")
    turned = mirrored[every[:, 0]]
    every[turned] = every[turned][:, [0, 2, 1]]
    return every, tuple(nodes), tuple(materials)


def _triangles(document: Document, primitive: dict[str, Any], count: int, place: str) -> Int[np.ndarray, "f 3"]:
    """Return a primitive's triangles; strips and fans are cut into theirs, without those of no area."""
    mode, index = primitive.get("mode", TRIANGLES), reference(document, primitive, "indices", place, "accessors")
    corners = np.arange(count) if index is None else read_whole(document, index, "SCALAR")[:, 0]
    if mode == TRIANGLES:
        if len(corners) % 3:
            raise InputError(f"{place}: expected three corners a triangle, got {len(corners)} in all")
        return corners.reshape(-1, 3)
    k = np.arange(max(len(corners) - 2, 0))
    if mode == STRIP:
        odd = k % 2
        faces = np.stack([corners[k], corners[k + 1 + odd], corners[k + 2 - odd]], axis=1)
    else:
        faces = np.stack([corners[k + 1], corners[k + 2], np.broadcast_to(corners[:1], k.shape)], axis=1)
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]


def _read_uv(
    document: Document, parts: list[Part], n: int
) -> tuple[Float[np.ndarray, "n 2"] | None, Bool[np.ndarray, " n"]]:
    having = [[f"TEXCOORD_{k}" in part.primitive["attributes"] for k in range(MOST_SETS)] for part in parts]
    counts = np.sum(having, axis=0)
    chosen = f"TEXCOORD_{np.argmax(counts == counts.max() if counts.max() == len(parts) else counts > 0)}"
    uv, has_uv = np.zeros((n, 2)), np.zeros(n, bool)
    for part in parts:
        found = attribute(document, part, chosen, "VEC2")
        if found is not None:
            uv[part.rows], has_uv[part.rows] = found * [1, -1] + [0, 1], True
    return uv if has_uv.any() else None, has_uv


# The colours of a glTF's vertices, for pictures: its materials' factors and textures of base colour.


TEXELS = 256  # a side: a texture is made so small first, so that a vertex has the mean colour around it
MOST_PIXELS = 70_000_000
WEBP, TRANSFORM = "EXT_texture_webp", "KHR_texture_transform"


def read_colours(document: Document, parts: list[Part], n: int) -> Float[np.ndarray, "n 3"] | None:
    """Return each vertex's red, green and blue, from 0 to 1; None where no material says any.

    Textures count where they are in the file itself, in a format that Pillow reads.
    """
    colours, any_colour = np.ones((n, 3)), False
    for part in parts:
        index = reference(document, part.primitive, "material", part.place, "materials")
        if index is None:
            continue
        place = f"materials[{index}].pbrMetallicRoughness"
        table = table_of(document.tree["materials"][index], "pbrMetallicRoughness", f"materials[{index}]")
        colours[part.rows] = reals(table, "baseColorFactor", place, [1.0] * 4)[:3]
        any_colour |= "baseColorFactor" in table
        info = table_of(table, "baseColorTexture", place)
        uv = attribute(document, part, f"TEXCOORD_{info.get('texCoord', 0)}", "VEC2") if info else None
        texels = None if uv is None else _texels(document, info, f"{place}.baseColorTexture")
        if texels is not None:
            column, row = np.floor(uv % 1.0 * TEXELS).astype(int).clip(0, TEXELS - 1).T
            colours[part.rows] *= texels[row, column]
            any_colour = True
    return colours if any_colour else None


def _texels(document: Document, info: dict[str, Any], place: str) -> Float[np.ndarray, "t t 3"] | None:
    """Return a texture made small, row by row from the top, None if it can't be read or is moved about."""
    from PIL import Image

    texture = reference(document, info, "index", place, "textures")
    if texture is None or TRANSFORM in table_of(info, "extensions", place):
        return None
    entry, place = document.tree["textures"][texture], f"textures[{texture}]"
    webp = table_of(table_of(entry, "extensions", place), WEBP, f"{place}.extensions")
    image = reference(document, webp or entry, "source", place, "images")
    view = None if image is None else document.tree["images"][image].get("bufferView")
    if view is None:
        return None
    try:
        view = reference(document, document.tree["images"][image], "bufferView", f"images[{image}]", "bufferViews")
        with Image.open(io.BytesIO(bytes(read_view(document, view)[0]))) as picture:
            if picture.width * picture.height > MOST_PIXELS:
                return None
            small = picture.convert("RGB").resize((TEXELS, TEXELS), Image.Resampling.BOX)
    except InputError:
        raise
    except Exception:  # whatever Pillow stumbles over: only pictures are less colourful
        return None
    return np.asarray(small, np.float64) / 255
