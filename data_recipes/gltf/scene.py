"""The scene of a glTF file: its nodes, where they are, and what they show, depth first."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from data_recipes.gltf.compression import DRACO, decode_draco, is_installed
from data_recipes.gltf.document import (
    Document,
    accessor_count,
    component_type,
    matrices,
    name_of,
    normalised,
    read_floats,
    read_view,
    reals,
    reference,
    references,
    table_of,
    tables_of,
    whole,
)
from replicate.base.exceptions import InputError

MOST_VERTICES = 5_000_000  # of all parts, as often as nodes show them
TRIANGLES, STRIP, FAN = 4, 5, 6


@dataclass(frozen=True)
class Tree:
    """Nodes of a file. order: depth first, parents before children; local, world: transforms (k, 4, 4)."""

    parents: list[int]
    children: list[list[int]]
    order: list[int]
    local: np.ndarray
    world: np.ndarray


@dataclass(frozen=True)
class Part:
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


def read_tree(document: Document) -> Tree:
    """Return a file's nodes. Raises InputError for a node with two parents or among its own children."""
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
    return Tree(parents, children, order, local, world)


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


def find_parts(document: Document, tree: Tree) -> tuple[list[Part], dict[str, float]]:
    """Return the parts of the scene in order, and the default weights of all morph targets that they have."""
    scene = reference(document, document.tree, "scene", "glTF", "scenes")
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
        name = unique(name_of(entry, name_of(mesh, f"node_{node}")), taken)
        shared: dict[str, Part] = {}
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
                shared[key] = Part(node, name, first, count, targets, where, primitive, draco)
                parts.append(shared[key])
                first += count
            shared[key].uses.append((primitive, where))
        owner, where = (entry, f"nodes[{node}]") if "weights" in entry else (mesh, place)
        stated = reals(owner, "weights", where, [], exactly=False)
        for part in shared.values():
            for k, target in enumerate(part.targets):
                weights.setdefault(target, stated[k] if k < len(stated) else 0.0)
    return parts, weights


def unique(name: str, taken: set[str]) -> str:
    """Return a name that isn't taken, with a number behind it if need be, and take it."""
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
    return [unique((names[k : k + 1] or [""])[0] or f"target_{k:02d}", taken) for k in range(len(targets))]


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


def attribute(document: Document, part: Part, name: str, kind: str) -> Float[np.ndarray, "k w"] | None:
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
