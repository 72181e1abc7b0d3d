"""The joints of a glTF file: where they are at rest, and which vertices they move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from data_recipes.gltf.document import Document, matrices, name_of, read_floats, reference, references
from data_recipes.gltf.scene import Part, Tree, attribute, unique
from replicate.base.exceptions import InputError

MOST_SETS = 8  # of four joints a vertex
LEAST_SIZE = 1e-24  # of a joint at rest, its volume: it has an inverse


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


def read_skin(
    document: Document, tree: Tree, parts: list[Part], n: int
) -> tuple[GltfSkin | None, list[Float[np.ndarray, "k 4 4"]]]:
    """Return the joints of all parts, and how each part's vertices are placed: (count or 1, 4, 4)."""
    placements, entries = [], []
    for part in parts:
        skin = reference(document, document.tree["nodes"][part.node], "skin", f"nodes[{part.node}]", "skins")
        bones, bound = [], None
        if skin is not None:
            bones = references(document, document.tree["skins"][skin], "joints", f"skins[{skin}]", "nodes")
            bound = _bound_to(document, part, len(bones))
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


def _skin(document: Document, tree: Tree, bones: list[int], entries: list[tuple], n: int) -> GltfSkin:
    place_of, parents, locals_ = {bone: k for k, bone in enumerate(bones)}, [], []
    for bone in bones:
        local, above = tree.local[bone], tree.parents[bone]
        while above >= 0 and above not in place_of:
            local, above = tree.local[above] @ local, tree.parents[above]
        parents.append(place_of.get(above, -1))
        locals_.append(local)
    sizes = np.abs(np.linalg.det(tree.world[bones]))
    odd = np.flatnonzero(~((sizes > LEAST_SIZE) & (sizes < np.inf)))
    if len(odd):
        raise InputError(f"nodes[{bones[odd[0]]}]: expected a joint of some size at rest, got none")
    columns = np.zeros(len(tree.parents), np.int64)
    columns[bones] = np.arange(len(bones))
    values, rows, nodes = (np.concatenate(list(column)) for column in zip(*entries, strict=True))
    weights = csr_array((values, (rows, columns[nodes])), shape=(n, len(bones)))
    weights.eliminate_zeros()
    taken: set[str] = set()
    names = tuple(unique(name_of(document.tree["nodes"][bone], f"node_{bone}"), taken) for bone in bones)
    return GltfSkin(names, np.array(parents), np.stack(locals_), np.linalg.inv(tree.world[bones]), weights)


def _bound_to(document: Document, part: Part, joints: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the joints of a part's vertices and their weights, four columns a set, None if it has none."""
    found = []
    for k in range(MOST_SETS):
        indices = attribute(document, part, f"JOINTS_{k}", "VEC4")
        weights = attribute(document, part, f"WEIGHTS_{k}", "VEC4")
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
