"""A face as a glTF file has it: the triangles of its scene in file order, its morph targets and its joints."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from data_recipes.gltf.compression import DRACO, decode_draco, is_installed
from data_recipes.gltf.document import (
    Document,
    accessor_count,
    component_type,
    matrices,
    name_of,
    normalised,
    read_document,
    read_floats,
    read_view,
    read_whole,
    reals,
    reference,
    references,
    table_of,
    tables_of,
    whole,
)
from replicate.base.exceptions import InputError
from replicate.base.schema import naming, shown
from replicate.base.user_files import shown_path

MOST_VERTICES = 5_000_000  # of all parts, as often as nodes show them
MOST_CORNERS = 100_000_000
MOST_OFFSETS = 400_000_000  # numbers of all morph targets, 8 bytes each
MOST_SETS = 8  # of texture coordinates, and of four joints a vertex
TRIANGLES, STRIP, FAN = 4, 5, 6


@dataclass(frozen=True)
class GltfSkin:
    """The joints of all skinned nodes, each once, parents before children.

    parents: of each joint, −1 for roots.
    local: transform of each joint at rest from its parent, for roots from the scene.
    bind: inverse bind matrices, from the scene to each joint, for `GltfFace.vertices` as they are: at rest the joints'
        transforms times these are identities. Where a file's rest isn't the pose that its skin was bound in, the
        vertices at rest are what is bound.
    weights: of each vertex and joint; rows of skinned vertices sum to one, others are zero.
    """

    names: tuple[str, ...]
    parents: Int[np.ndarray, " j"]
    local: Float[np.ndarray, "j 4 4"]
    bind: Float[np.ndarray, "j 4 4"]
    weights: csr_array


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
    base_colour: red, green and blue of the material's factor, 1 without; None if no material has one.
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


@dataclass(frozen=True)
class _Tree:
    """Nodes of a file. order: depth first, parents before children; local, world: transforms (k, 4, 4)."""

    parents: list[int]
    children: list[list[int]]
    order: list[int]
    local: np.ndarray
    world: np.ndarray


@dataclass(frozen=True)
class _Part:
    """Vertices of a node that one or more primitives share.

    first, count: which of all vertices. targets: names of its morph targets. primitive, place: the first of these
    primitives, and where it is. uses: all of them.
    """

    node: int
    name: str
    first: int
    count: int
    targets: list[str]
    place: str
    primitive: dict[str, Any]
    draco: tuple[dict[int, np.ndarray], np.ndarray] | None
    uses: list[tuple[dict[str, Any], str]] = field(default_factory=list)

    @property
    def rows(self) -> slice:
        return slice(self.first, self.first + self.count)


def read_gltf(file: Path) -> GltfFace:
    """Return the face of a GLB, glTF or VRM file; a glTF's buffers must lie beside it.

    Compressed files need the optional packages `meshoptimizer` or `DracoPy`. Raises InputError, in one sentence that
    names the file, for whatever is damaged, too large or out of range.
    """
    with naming(shown_path(file)), np.errstate(all="ignore"):
        document = read_document(file)
        tree = _read_tree(document)
        parts, weights = _find_parts(document, tree)
        n = sum(part.count for part in parts)
        if n * 3 * len(weights) > MOST_OFFSETS:
            raise InputError(f"expected at most {MOST_OFFSETS:,} offsets, got {len(weights)} targets of {n} vertices")
        skin, placements = _read_skin(document, tree, parts, n)
        vertices, mirrored = np.zeros((n, 3)), np.zeros(n, bool)
        targets = {name: np.zeros((n, 3)) for name in weights}
        for part, placement in zip(parts, placements, strict=True):
            turn = placement[:, :3, :3]
            points = _attribute(document, part, "POSITION", "VEC3")
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
        colour = _read_colour(document, parts, n)
        return GltfFace(vertices, faces, uv, has_uv, nodes, materials, targets, weights, skin, colour)


def _read_tree(document: Document) -> _Tree:
    entries = document.tree["nodes"]
    children = [references(document, node, "children", f"nodes[{k}]", "nodes") for k, node in enumerate(entries)]
    parents = [-1] * len(entries)
    for node, below in enumerate(children):
        for child in below:
            if parents[child] >= 0:
                raise InputError(f"nodes[{child}]: expected one parent, got nodes[{parents[child]}] and nodes[{node}]")
            parents[child] = node
    order = _depth_first((node for node, parent in enumerate(parents) if parent < 0), children)
    if len(order) < len(entries):
        raise InputError(f"nodes[{min(set(range(len(entries))) - set(order))}]: it is among its own children")
    local = np.stack([np.eye(4), *(_transform(node, f"nodes[{k}]") for k, node in enumerate(entries))])[1:]
    world = local.copy()
    for node in order:
        if parents[node] >= 0:
            world[node] = world[parents[node]] @ local[node]
    return _Tree(parents, children, order, local, world)


def _depth_first(roots: Iterable[int], children: list[list[int]]) -> list[int]:
    stack, order = [*roots][::-1], []
    while stack:
        order.append(stack.pop())
        stack += children[order[-1]][::-1]
    return order


def _transform(node: dict[str, Any], place: str) -> np.ndarray:
    """Return a node's transform (4, 4) from its parent."""
    if "matrix" in node:
        return matrices(np.array([reals(node, "matrix", place, [0.0] * 16)]), f"{place}.matrix")[0]
    scale = reals(node, "scale", place, [1.0] * 3)
    x, y, z, w = rotation = reals(node, "rotation", place, [0.0, 0.0, 0.0, 1.0])
    length = float(np.linalg.norm(rotation))
    if length == 0:
        raise InputError(f"{place}.rotation: expected a quaternion other than zero")
    x, y, z, w = x / length, y / length, z / length, w / length
    transform = np.eye(4)
    transform[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    transform[:3, :3] *= scale
    transform[:3, 3] = reals(node, "translation", place, [0.0] * 3)
    return transform


def _find_parts(document: Document, tree: _Tree) -> tuple[list[_Part], dict[str, float]]:
    """Return the parts of the scene in order, and the default weights of all morph targets that they have."""
    scene = reference(document, document.tree, "scene", "the file", "scenes")
    scenes = document.tree["scenes"]
    roots = [node for node, parent in enumerate(tree.parents) if parent < 0]
    if scenes:
        roots = references(document, scenes[scene or 0], "nodes", f"scenes[{scene or 0}]", "nodes")
    order = _depth_first(roots, tree.children) if len(set(roots)) == len(roots) else [0, 0]
    if len(set(order)) < len(order):
        raise InputError("the scene has a node twice: expected every node once")
    parts, weights, taken, first = [], {}, set(), 0
    for node in order:
        entry = document.tree["nodes"][node]
        index = reference(document, entry, "mesh", f"nodes[{node}]", "meshes")
        if index is None:
            continue
        mesh, place = document.tree["meshes"][index], f"meshes[{index}]"
        name = _unique(name_of(entry, name_of(mesh, f"node_{node}")), taken)
        shared: dict[str, _Part] = {}
        for k, primitive in enumerate(tables_of(mesh, "primitives", place)):
            where = f"{place}.primitives[{k}]"
            if whole(primitive, "mode", where, TRIANGLES, upper=FAN) < TRIANGLES:
                continue  # points and lines
            packed = _packed(document, primitive, where)
            key = json.dumps([primitive.get("attributes"), primitive.get("targets"), packed], sort_keys=True)
            if key not in shared:
                count, targets = _count(document, primitive, where), _target_names(mesh, primitive, where)
                if first + count > MOST_VERTICES:
                    raise InputError(f"{where}: expected at most {MOST_VERTICES:,} vertices in all, got more")
                draco = _unpack(document, packed, where) if packed else None
                shared[key] = _Part(node, name, first, count, targets, where, primitive, draco)
                parts.append(shared[key])
                first += count
            shared[key].uses.append((primitive, where))
        owner, where = (entry, f"nodes[{node}]") if "weights" in entry else (mesh, place)
        stated = reals(owner, "weights", where, [], exactly=False)
        for part in shared.values():
            for k, target in enumerate(part.targets):
                weights.setdefault(target, stated[k] if k < len(stated) else 0.0)
    return parts, weights


def _unique(name: str, taken: set[str]) -> str:
    unique, k = name, 1
    while unique in taken:
        k += 1
        unique = f"{name}_{k}"
    taken.add(unique)
    return unique


def _count(document: Document, primitive: dict[str, Any], place: str) -> int:
    """Return how many vertices a primitive has."""
    attributes = table_of(primitive, "attributes", place)
    index = reference(document, attributes, "POSITION", f"{place}.attributes", "accessors")
    if index is None:
        raise InputError(f"{place}.attributes: POSITION is missing")
    return accessor_count(document, index)


def _target_names(mesh: dict[str, Any], primitive: dict[str, Any], place: str) -> list[str]:
    """Return the names of a primitive's morph targets, each once; target_00 and so on where the file has none."""
    stated = []
    for owner in (mesh, primitive):
        extras = owner.get("extras")
        names = extras.get("targetNames") if isinstance(extras, dict) else None
        stated = stated or (names if isinstance(names, list) else [])
    names, taken = [name_of({"name": name}, "") for name in stated], set()
    targets = tables_of(primitive, "targets", place)
    return [_unique((names[k : k + 1] or [""])[0] or f"target_{k:02d}", taken) for k in range(len(targets))]


def _packed(document: Document, primitive: dict[str, Any], place: str) -> dict[str, Any] | None:
    """Return what Draco's extension says of a primitive, if it is to be decoded."""
    extensions = table_of(primitive, "extensions", place)
    if DRACO not in extensions:
        return None
    if DRACO not in document.tree["extensionsRequired"] and not is_installed(DRACO):
        return None  # the file has the same without compression
    return table_of(extensions, DRACO, f"{place}.extensions")


def _unpack(
    document: Document, packed: dict[str, Any], place: str
) -> tuple[dict[int, np.ndarray], Int[np.ndarray, "f 3"]]:
    place = f"{place}.extensions.{DRACO}"
    view = reference(document, packed, "bufferView", place, "bufferViews")
    if view is None:
        raise InputError(f"{place}: a bufferView is missing")
    return decode_draco(bytes(read_view(document, view)[0]), place)


def _attribute(document: Document, part: _Part, name: str, kind: str) -> Float[np.ndarray, "k w"] | None:
    """Return an attribute of a part's vertices, None if it has none of this name. kind: as `read_floats` takes it."""
    attributes = table_of(part.primitive, "attributes", part.place)
    index = reference(document, attributes, name, f"{part.place}.attributes", "accessors")
    if part.draco and index is not None:
        place = f"{part.place}.extensions.{DRACO}"
        extension = table_of(table_of(part.primitive, "extensions", part.place), DRACO, place)
        ids = table_of(extension, "attributes", place)
        if name in ids:
            values, entry = part.draco[0].get(whole(ids, name, place)), document.tree["accessors"][index]
            if values is None or values.shape != (part.count, int(kind[-1])) or not np.isfinite(values).all():
                raise InputError(f"{place}.{name}: expected {part.count} {kind} of finite numbers")
            component_type(entry, f"accessors[{index}]")
            return normalised(values) if entry.get("normalized") is True else values.astype(np.float64)
    return None if index is None else read_floats(document, index, kind, part.count)


def _read_skin(
    document: Document, tree: _Tree, parts: list[_Part], n: int
) -> tuple[GltfSkin | None, list[Float[np.ndarray, "k 4 4"]]]:
    """Return the joints of all parts, and how each part's vertices are placed: (count or 1, 4, 4)."""
    placements, entries = [], []
    for part in parts:
        skin = reference(document, document.tree["nodes"][part.node], "skin", f"nodes[{part.node}]", "skins")
        bones = (
            None
            if skin is None
            else references(document, document.tree["skins"][skin], "joints", f"skins[{skin}]", "nodes")
        )
        bound = None if bones is None else _bound_to(document, part, len(bones))
        if bound is None:
            placements.append(tree.world[part.node][None])
            continue
        joints, weights = bound
        rows = np.repeat(np.arange(part.count), joints.shape[1])
        blend = csr_array((weights.ravel(), (rows, joints.ravel())), shape=(part.count, len(bones)))
        rest = tree.world[bones] @ _inverse_binds(document, skin, len(bones))
        placements.append((blend @ rest.reshape(-1, 16)).reshape(-1, 4, 4))
        entries.append((weights.ravel(), rows + part.first, np.array(bones)[joints.ravel()]))
    if not entries:
        return None, placements
    used = {
        bone
        for part in parts
        if (skin := document.tree["nodes"][part.node].get("skin")) is not None
        for bone in document.tree["skins"][skin]["joints"]
    }
    return _skin(document, tree, [node for node in tree.order if node in used], entries, n), placements


def _skin(document: Document, tree: _Tree, bones: list[int], entries: list[tuple], n: int) -> GltfSkin:
    place_of, parents, locals_ = {bone: k for k, bone in enumerate(bones)}, [], []
    for bone in bones:
        local, above = tree.local[bone], tree.parents[bone]
        while above >= 0 and above not in place_of:
            local, above = tree.local[above] @ local, tree.parents[above]
        parents.append(place_of.get(above, -1))
        locals_.append(local)
    flat = np.flatnonzero(~(np.abs(np.linalg.det(tree.world[bones])) > 0))
    if len(flat):
        raise InputError(f"nodes[{bones[flat[0]]}]: expected a joint of some size at rest, got a scale of zero")
    columns = np.zeros(len(tree.parents), np.int64)
    columns[bones] = np.arange(len(bones))
    values, rows, nodes = (np.concatenate(list(column)) for column in zip(*entries, strict=True))
    weights = csr_array((values, (rows, columns[nodes])), shape=(n, len(bones)))
    weights.eliminate_zeros()
    taken: set[str] = set()
    names = tuple(_unique(name_of(document.tree["nodes"][bone], f"node_{bone}"), taken) for bone in bones)
    return GltfSkin(names, np.array(parents), np.stack(locals_), np.linalg.inv(tree.world[bones]), weights)


def _bound_to(document: Document, part: _Part, joints: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the joints of a part's vertices and their weights, four columns a set, None if it has none."""
    found = []
    for k in range(MOST_SETS):
        indices = _attribute(document, part, f"JOINTS_{k}", "VEC4")
        weights = _attribute(document, part, f"WEIGHTS_{k}", "VEC4")
        if indices is None or weights is None:
            break
        found.append((indices, weights))
    if not found:
        return None
    indices, weights = (np.concatenate(column, axis=1) for column in zip(*found, strict=True))
    if (weights < 0).any():
        raise InputError(f"{part.place}.attributes: expected weights of at least 0, got {weights.min():g}")
    weights[weights.sum(axis=1) == 0, 0] = 1  # as viewers do it
    indices[weights == 0] = 0
    bad = indices[~((indices >= 0) & (indices < joints) & (indices % 1 == 0))]
    if len(bad):
        raise InputError(f"{part.place}.attributes: expected joints from 0 to {joints - 1}, got {bad[0]:g}")
    return indices.astype(np.int64), weights / weights.sum(axis=1, keepdims=True)


def _inverse_binds(document: Document, skin: int, joints: int) -> Float[np.ndarray, "j 4 4"]:
    place = f"skins[{skin}].inverseBindMatrices"
    index = reference(document, document.tree["skins"][skin], "inverseBindMatrices", f"skins[{skin}]", "accessors")
    if index is None:
        return np.tile(np.eye(4), (joints, 1, 1))
    values = read_floats(document, index, "MAT4")
    if len(values) < joints:
        raise InputError(f"{place}: expected {joints} matrices, got {len(values)}")
    return matrices(values[:joints], place)


def _read_faces(
    document: Document, parts: list[_Part], mirrored: Bool[np.ndarray, " n"]
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
    document: Document, parts: list[_Part], n: int
) -> tuple[Float[np.ndarray, "n 2"] | None, Bool[np.ndarray, " n"]]:
    having = [[f"TEXCOORD_{k}" in part.primitive["attributes"] for k in range(MOST_SETS)] for part in parts]
    counts = np.sum(having, axis=0)
    chosen = f"TEXCOORD_{np.argmax(counts == counts.max() if counts.max() == len(parts) else counts > 0)}"
    uv, has_uv = np.zeros((n, 2)), np.zeros(n, bool)
    for part in parts:
        found = _attribute(document, part, chosen, "VEC2")
        if found is not None:
            uv[part.rows], has_uv[part.rows] = found * [1, -1] + [0, 1], True
    return uv if has_uv.any() else None, has_uv


def _read_colour(document: Document, parts: list[_Part], n: int) -> Float[np.ndarray, "n 3"] | None:
    colours, any_factor = np.ones((n, 3)), False
    for part in parts:
        index = reference(document, part.primitive, "material", part.place, "materials")
        if index is None:
            continue
        place = f"materials[{index}].pbrMetallicRoughness"
        table = table_of(document.tree["materials"][index], "pbrMetallicRoughness", f"materials[{index}]")
        any_factor |= "baseColorFactor" in table
        colours[part.rows] = reals(table, "baseColorFactor", place, [1.0] * 4)[:3]
    return colours if any_factor else None
